#!/usr/bin/env bash
# Runs the troubles of tests/plant/franka_run_test.cpp with the maker's library in the place of the stand-in. The
# sources of libfranka are given, with their submodule common; their model, and so Pinocchio, is left out.
#   bench/franka.sh LIBFRANKA
set -euo pipefail
sources=$(readlink -f "${1:?usage: bench/franka.sh LIBFRANKA}")
tree=$(dirname "$(dirname "$(readlink -f "$0")")")
build=$tree/build/franka
cmake -S "$tree/bench/libfranka" -B "$build/client" -G Ninja -DLIBFRANKA="$sources" \
  -DCMAKE_INSTALL_PREFIX="$build/prefix"
cmake --build "$build/client" --target install
cmake -S "$tree" -B "$build/tachless" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$build/prefix" \
  -DCMAKE_COMPILE_WARNING_AS_ERROR=ON
cmake --build "$build/tachless" --target tachless-franka test_plant_franka_run
TACHLESS_FRANKA_DRIVER=$build/tachless/bin/tachless-franka "$build/tachless/tests/plant/test_plant_franka_run" \
  --gtest_repeat=2
