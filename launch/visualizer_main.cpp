#include "launch/visualizer.h"

int main(int argc, char** argv) { return launch::visualizer(argc, argv); }
