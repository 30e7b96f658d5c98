#include "launch/command.h"

int main(int argc, char** argv) { return launch::tachless(argc, argv); }
