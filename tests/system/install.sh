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

# Compiling takes most of the time here, and half of it would be optimisation.
configure=(-G Ninja -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_BUILD_TYPE=None)

# They find tachless without the packages that only the build of tachless needs.
without=()
for package in CLI11 NLopt; do without+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON"); done
for example in own_law own_driver own_simulator iiwa simulate_and_read; do
  rm -rf "$prefix/work/$example"
  mkdir -p "$prefix/work"
  cp -r "$prefix/share/tachless/examples/$example" "$prefix/work/$example"
  cmake -S "$prefix/work/$example" -B "$prefix/work/$example/build" "${configure[@]}" "${without[@]}"
  cmake --build "$prefix/work/$example/build"
done
readelf -d "$prefix/work/own_law/build/own_law" | grep SimTK && fail=1  # of a law's program not loaded

# The law in a loop of the user's own, in C++17, without the packages that the emulated arm and the programs need.
without=()
for package in Simbody nlohmann_json CLI11; do without+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON"); done
rm -rf "$prefix/work/use_law"
cp -r "$prefix/share/tachless/examples/use_law" "$prefix/work/use_law"
cmake -S "$prefix/work/use_law" -B "$prefix/work/use_law/build" "${configure[@]}" "${without[@]}"
cmake --build "$prefix/work/use_law/build"
(cd "$prefix/work/use_law" && build/use_law) | grep 'stable at 1 kHz with 1 tick of delay' || fail=1
sed -i 's/period_s: .*,/period_s: 0.006,/' "$prefix/work/use_law/arm.yaml"  # unstable
(cd "$prefix/work/use_law" && ! build/use_law) | grep 'no certificate: unstable at 166.7 Hz' || fail=1
readelf -d "$prefix/work/use_law/build/use_law" | grep SimTK && fail=1

# The law without its certificate needs neither NLopt nor Clp.
rm -rf "$prefix/work/law_only"
mkdir "$prefix/work/law_only"
cat >"$prefix/work/law_only/CMakeLists.txt" <<'END'
cmake_minimum_required(VERSION 3.25)
project(law_only LANGUAGES CXX)
set(CMAKE_CXX_STANDARD 17)
find_package(tachless REQUIRED COMPONENTS own_loop)
add_executable(law_only main.cpp)
target_link_libraries(law_only PRIVATE tachless::own_loop)
END
cat >"$prefix/work/law_only/main.cpp" <<'END'
#include <tachless/own_loop/own_loop.h>
int main() {
  tachless::own_loop::Loop loop("arm.yaml");
  return loop.torque(0, std::vector<double>{0, 0}).ok() ? 0 : 1;
}
END
cmake -S "$prefix/work/law_only" -B "$prefix/work/law_only/build" "${configure[@]}" "${without[@]}" \
  -DCMAKE_DISABLE_FIND_PACKAGE_NLopt=ON
cmake --build "$prefix/work/law_only/build"
(cd "$prefix/work/use_law" && "$prefix/work/law_only/build/law_only") || fail=1
readelf -d "$prefix/work/law_only/build/law_only" | grep -iE 'SimTK|nlopt|clp' && fail=1

# The controller of ros2_control as a plugin, against stand-ins of ROS 2. Two plugins live in one process.
rm -rf "$prefix/work/ros2_control" "$prefix/work/ros2_stubs"
cp -r "$prefix/share/tachless/examples/ros2_control" "$prefix/work/ros2_control"
stubs=$tree/tests/system/ros2_stubs
for project in "$prefix/work/ros2_control" "$stubs"; do
  built=$prefix/work/$(basename "$project")/build
  cmake -S "$project" -B "$built" "${configure[@]}" -DCMAKE_PREFIX_PATH="$prefix;$stubs/cmake" "${without[@]}"
  cmake --build "$built"
done
plugin=$prefix/work/ros2_control/build/libtachless_controllers.so
cp "$plugin" "$prefix/work/ros2_control/build/libother.so"
"$prefix/work/ros2_stubs/build/manager" "$plugin" "$prefix/work/ros2_control/build/libother.so" \
  "$prefix/share/tachless/examples/use_law/arm.yaml" || fail=1
nm -DC --defined-only "$plugin" | grep -E 'tachless::(base|robot|messages|scenario|controller|plant|reference|numerics|linear|certify)::' && fail=1

# The simulation of the example equals the log of a run.
scenario=$tree/scenarios/regulation.yaml
"$prefix/bin/tachless" run "$scenario" --in-process --quiet --out "$prefix/work/log"
"$prefix/work/simulate_and_read/build/simulate_and_read" "$scenario" >"$prefix/work/simulated"
"$prefix/work/simulate_and_read/build/simulate_and_read" "$prefix/work/log" | diff - "$prefix/work/simulated"

# The documented headers compile in two orders; a header that no documented one includes is not installed.
flags=$(PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name tachless.pc)") pkg-config --cflags tachless)
documented=$(sed -n '/^## /p' "$tree/docs/site/cpp.md" | grep -oE '[a-z_/]+\.h' | sed -E 's,^(core|analysis)/,,' | sort)
[[ $(wc -w <<<"$documented") -ge 17 ]] || fail=1
for order in cat tac; do
  # shellcheck disable=SC2086
  sed 's,.*,#include <tachless/&>,' <<<"$documented" | $order | c++ -std=c++20 -fsyntax-only $flags -x c++ - || fail=1
done
for compiler in g++ clang++; do  # this one in C++17 too
  "$compiler" -std=c++17 -Wall -Wextra -Wpedantic -Werror -fsyntax-only -I "$prefix/include" \
    -include tachless/own_loop/own_loop.h -x c++ /dev/null || fail=1
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
