#include "viewer/visualizer.h"

using namespace tachless;

int main(int argc, char** argv) { return viewer::visualizer(argc, argv); }
