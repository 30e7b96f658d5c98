#include "launch/command.h"

using namespace tachless;

int main(int argc, char** argv) { return launch::tachless(argc, argv); }
