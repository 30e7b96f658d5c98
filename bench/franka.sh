#!/usr/bin/env bash
# Runs the troubles of tests/plant/franka_run_test.cpp with the maker's library in the place of the stand-in. The
# sources of libfranka are given, with their submodule common; their model, and so Pinocchio, is left out.
# An existing build tree of tachless (Ninja, Release) saves its compilation.
#   bench/franka.sh LIBFRANKA [BUILD_TREE]
set -euo pipefail
sources=$(readlink -f "${1:?usage: bench/franka.sh LIBFRANKA [BUILD_TREE]}")
tree=$(dirname "$(dirname "$(readlink -f "$0")")")
build=$tree/build/franka
tachless=${2:-$build/tachless}
cmake -S "$tree/bench/libfranka" -B "$build/client" -G Ninja -DLIBFRANKA="$sources" \
  -DCMAKE_INSTALL_PREFIX="$build/prefix"
cmake --build "$build/client" --target install
cmake -S "$tree" -B "$tachless" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$build/prefix" \
  -DCMAKE_COMPILE_WARNING_AS_ERROR=ON
cmake --build "$tachless" --target tachless-franka test_plant_franka_run
TACHLESS_FRANKA_DRIVER=$tachless/bin/tachless-franka "$tachless/tests/plant/test_plant_franka_run" \
  --gtest_repeat=2
