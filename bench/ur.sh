#!/usr/bin/env bash
# Runs the driver of Universal Robots' arms with the maker's library against the controller of the tests. The sources
# of the library are given.
# An existing build tree of tachless (Ninja, Release) saves its compilation.
#   bench/ur.sh UNIVERSAL_ROBOTS_CLIENT_LIBRARY [BUILD_TREE]
set -euo pipefail
sources=$(readlink -f "${1:?usage: bench/ur.sh UNIVERSAL_ROBOTS_CLIENT_LIBRARY [BUILD_TREE]}")
tree=$(dirname "$(dirname "$(readlink -f "$0")")")
build=$tree/build/ur
tachless=${2:-$build/tachless}
cmake -S "$sources" -B "$build/client" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$build/prefix"
cmake --build "$build/client" --target install
cmake -S "$tree" -B "$tachless" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$build/prefix" \
  -DCMAKE_COMPILE_WARNING_AS_ERROR=ON
cmake --build "$tachless" --target tachless-ur test_plant_ur_network
TACHLESS_UR_SCRIPT=$sources/resources/external_control.urscript "$tachless/tests/plant/test_plant_ur_network" \
  --gtest_repeat=2
