#!/usr/bin/env bash
# Runs the driver of Universal Robots' arms with the maker's library against the controller of the tests. The sources
# of the library are given.
#   bench/ur.sh UNIVERSAL_ROBOTS_CLIENT_LIBRARY
set -euo pipefail
sources=$(readlink -f "${1:?usage: bench/ur.sh UNIVERSAL_ROBOTS_CLIENT_LIBRARY}")
tree=$(dirname "$(dirname "$(readlink -f "$0")")")
build=$tree/build/ur
cmake -S "$sources" -B "$build/client" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$build/prefix"
cmake --build "$build/client" --target install
cmake -S "$tree" -B "$build/tachless" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$build/prefix" \
  -DCMAKE_COMPILE_WARNING_AS_ERROR=ON
cmake --build "$build/tachless" --target tachless-ur test_plant_ur_network
TACHLESS_UR_SCRIPT=$sources/resources/external_control.urscript "$build/tachless/tests/plant/test_plant_ur_network" \
  --gtest_repeat=2
