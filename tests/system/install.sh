#!/usr/bin/env bash
# Installs a build into BUILD/installed, as a user does, and builds the projects of examples/ against
# that, from outside of the tree.
set -euo pipefail
tree=${1:?usage: install.sh SOURCE_DIR BUILD_DIR}
build=${2:?usage: install.sh SOURCE_DIR BUILD_DIR}
prefix=$build/installed
rm -rf "$prefix"
cmake --install "$build" --prefix "$prefix" >/dev/null
cmake --install "$build" --prefix "$prefix" --component python >/dev/null

# No program and no library knows where it was built; no folder is empty.
fail=0
grep -rlF -e "$tree/" -e "$build/" "$prefix" | sed 's/$/: has a path of the build in it/' | grep . && fail=1
find "$prefix" -type d -empty | sed 's/$/: is empty/' | grep . && fail=1

for example in own_law own_driver iiwa; do
  rm -rf "$prefix/work/$example"
  mkdir -p "$prefix/work"
  cp -r "$prefix/share/tachless/examples/$example" "$prefix/work/$example"
  cmake -S "$prefix/work/$example" -B "$prefix/work/$example/build" -G Ninja -DCMAKE_PREFIX_PATH="$prefix"
  cmake --build "$prefix/work/$example/build"
done
exit $fail
