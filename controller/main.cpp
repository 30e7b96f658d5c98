#include "controller/program.h"

int main(int argc, char** argv) {
  return tachless::controller::run_program(argc, argv, tachless::controller::scenario_law);
}
