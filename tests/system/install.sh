#!/usr/bin/env bash
# Installs a build into BUILD/installed, as a user does. Builds the projects of examples/ against it
# from outside of the tree, one of them by pkg-config too. package.xml agrees with REP 149.
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

# They find tachless without the packages that only the build of tachless needs.
without=()
for package in CLI11 NLopt urdfdom_headers; do without+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON"); done
for example in own_law own_driver iiwa simulate_and_read; do
  rm -rf "$prefix/work/$example"
  mkdir -p "$prefix/work"
  cp -r "$prefix/share/tachless/examples/$example" "$prefix/work/$example"
  cmake -S "$prefix/work/$example" -B "$prefix/work/$example/build" -G Ninja -DCMAKE_PREFIX_PATH="$prefix" "${without[@]}"
  cmake --build "$prefix/work/$example/build"
done
readelf -d "$prefix/work/own_law/build/own_law" | grep SimTK && fail=1  # of a law's program not loaded

# The simulation of the example equals the log of a run.
scenario=$tree/scenarios/regulation.yaml
"$prefix/bin/tachless" run "$scenario" --in-process --quiet --out "$prefix/work/log"
"$prefix/work/simulate_and_read/build/simulate_and_read" "$scenario" >"$prefix/work/simulated"
"$prefix/work/simulate_and_read/build/simulate_and_read" "$prefix/work/log" | diff - "$prefix/work/simulated"

# Each documented header compiles alone; a header that no documented one includes is not installed.
flags=$(PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name tachless.pc)") pkg-config --cflags tachless)
documented=$(sed -n '/^## /p' "$tree/docs/site/cpp.md" | grep -oE '[a-z_/]+\.h' | sed -E 's,^(core|analysis)/,,')
[[ $(wc -w <<<"$documented") -ge 16 ]] || fail=1
for header in $documented; do
  echo "#include <tachless/$header>"
  # shellcheck disable=SC2086
  c++ -std=c++20 -fsyntax-only -include "tachless/$header" $flags -x c++ /dev/null || fail=1
done
[[ ! -e $prefix/include/tachless/design && ! -e $prefix/include/tachless/cli ]] || fail=1

PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name tachless.pc)")
export PKG_CONFIG_PATH
read -r -a flags < <(pkg-config --cflags --libs tachless)
c++ -std=c++20 "$prefix/work/own_law/own_law.cpp" -o "$prefix/work/own_law/by_pkg_config" "${flags[@]}"
"$prefix/work/own_law/by_pkg_config" --help | grep -q 'SCENARIO'

/usr/bin/python3 - "$prefix/share/tachless/package.xml" "$(pkg-config --modversion tachless)" <<'END'
import sys
import xml.etree.ElementTree as xml

package = xml.parse(sys.argv[1]).getroot()
assert (package.tag, package.attrib) == ("package", {"format": "3"})
assert [each.tag for each in package][:5] == ["name", "version", "description", "maintainer", "license"]
assert {each.tag for each in package[5:-1]} == {"buildtool_depend", "build_depend", "depend", "exec_depend"}
assert package.findtext("version") == sys.argv[2], "package.xml has another version than CMakeLists.txt"
assert package[-1].tag == "export" and package.findtext("export/build_type") == "cmake"
END
exit $fail
