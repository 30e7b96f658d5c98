#!/usr/bin/env bash
# script_test.sh TREE: the script at the root, in a copy of the tree's skeleton, with stand-ins for
# dpkg-query, apt-get, cmake, ctest and the built command: what it asks of them, and when.
set -euo pipefail
work=$(mktemp -d) failures=0
trap 'rm -rf "$work"' EXIT
root="$work/a tree" tools=$work/tools
mkdir -p "$tools" "$root/"{cmake,lcmtypes,core,plant,reference,controller,logger,analysis,tools,python}
cp "$1/tachless" "$root"
echo 'project(tachless VERSION 1.2.3 LANGUAGES CXX)' >"$root/CMakeLists.txt"
touch "$root/CMakePresets.json" "$root/core/"{a.cpp,page.css}
tool() { printf '#!/bin/bash\necho "%s $*" >>"$CALLS"\n%s\n' "$1" "$2" >"$tools/$1"; chmod +x "$tools/$1"; }
tool dpkg-query 'shift 2; for p in "$@"; do echo -n "installed:$p "; done'
tool apt-get 'exit 0'
tool sudo 'exec "$@"'
tool ip 'exit 0'
tool mount 'exit 0'
tool unshare 'shift; exec "$@"'
tool cpack 'mkdir -p "$ROOT/build/package"; touch "$ROOT/build/package/a.deb"'
tool ctest 'echo "100% tests passed, 0 tests failed out of 25"'
# Configuring leaves a build.ninja and a cache; building leaves a command that prints how it was called.
tool cmake '[[ $1 != --fresh ]] || shift
[[ $1 == --build ]] || { mkdir -p "$ROOT/build/$4"; touch "$ROOT/build/$4/build.ninja"
  printf "%s\n" "${5#-D}" "${6#-D}" | sed s/=/:BOOL=/ >"$ROOT/build/$4/CMakeCache.txt"
  echo "CMAKE_HOME_DIRECTORY:INTERNAL=$ROOT" >>"$ROOT/build/$4/CMakeCache.txt"; exit; }
[[ ! -e $ROOT/broken ]] || { echo "a.cpp:1: error: broken"; exit 1; }
mkdir -p "$2/bin"; name=tachless
printf "#!/bin/sh\necho \"built command: \$*\"\ncase \$* in *--in-process*) exit 0 ;; esac\nexit 7\n" >"$2/bin/$name"; chmod +x "$2/bin/$name"'

ci=
run() {  # ARGUMENTS…: sets code, output, calls
  export ROOT=$root CALLS=$work/calls
  : >"$CALLS"
  code=0
  output=$(cd / && CI=$ci PATH=$tools:$PATH "$root/tachless" "$@" 2>&1 </dev/null) || code=$?
  calls=$(<"$CALLS")
}
fail() { echo "FAILED: $current: $1"; echo "$output"; failures=$((failures + 1)); }
exits() { ((code == $1)) || fail "exit code $code, expected $1"; }
prints() { [[ $output == *"$1"* ]] || fail "does not print: $1"; }
calls() { [[ $calls == *"$1"* ]] || fail "does not call: $1"; }
calls_no() { [[ $calls != *"$1"* ]] || fail "calls: $1"; }
case_of() { current=$1; }

case_of 'before the first build --help and --version need none'
run --version; exits 0; prints 'tachless 1.2.3'
run --help; exits 0; prints 'Not built yet'; calls_no 'cmake -'
case_of 'it builds once, says what that costs, and hands over'
run run 'two words' --json; exits 7; prints 'builds 1 files: about'; prints 'built command: run two words --json'
calls "cmake -S $root --preset release"; calls --build
run info log; [[ $output == 'built command: info log' ]] || fail 'another output'; calls_no 'cmake -'
case_of 'a file that is compiled in is newer, or one was removed'
touch -d '1 hour' "$root/core/page.css"; run info log; calls --build; calls_no --preset
touch -d '-1 hour' "$root/core/page.css"; run info log; calls_no 'cmake -'
touch -d '1 hour' "$root/core"; run info log; calls --build
touch -d '-1 hour' "$root/core" "$root/core/"*
case_of 'a clone that was copied or moved configures anew and never runs the other one'
sed -i 's|^CMAKE_HOME_DIRECTORY.*|&/elsewhere|' "$root/build/release/CMakeCache.txt"
run info log; exits 7; calls "cmake --fresh -S $root --preset release"; calls --build
run info log; calls_no 'cmake -'
case_of 'the version, in words that people type'
for word in version -v; do run $word; prints 'built command: --version'; done
case_of 'spy needs a display: said before anything is installed or built'
DISPLAY='' run spy; exits 2; prints 'type: ./tachless watch'; calls_no dpkg-query
case_of 'missing packages are installed and named'
tool dpkg-query 'shift 2; for p in "$@"; do [ $p = iproute2 ] || echo -n "installed:$p "; done'
tool apt-get 'case "$*" in *--assume-no*) echo "0 upgraded, 19 newly installed, 0 to remove"
  echo "After this operation, 45.6 MB of additional disk space will be used."; exit 1 ;; esac'
run info log; exits 7; prints 'installs 19 packages (45.6 MB): about 7 s here'
calls '--no-install-recommends -o APT::Status-Fd=1 iproute2'
case_of 'apt-get fails: a remedy'
tool apt-get 'echo "E: Could not get lock /var/lib/dpkg/lock"; exit 100'
run info log; exits 2; prints 'Could not get lock'; prints 'another package manager is running'
tool apt-get 'echo "E: something else"; exit 100'
run info log; exits 2; prints 'as root, type: apt-get install iproute2'
case_of 'a package that only some tests need: not known to the server, and no server'
tool dpkg-query 'shift 2; for p in "$@"; do [ $p = libmujoco-dev ] || echo -n "installed:$p "; done'
tool apt-get 'exit 0'; tool apt-cache 'exit 100'
run package; exits 0; prints 'no package libmujoco-dev for this system'; calls_no ' install '
tool apt-get 'echo "Could not resolve the host"; exit 100'
run package; exits 0; prints 'no package server: what needs libmujoco-dev is not built'; calls_no ' install '
tool apt-get 'exit 0'; tool apt-cache 'exit 0'
run package; exits 0; calls 'install -q -y --no-install-recommends -o APT::Status-Fd=1 libmujoco-dev'
tool dpkg-query 'shift 2; for p in "$@"; do echo -n "installed:$p "; done'
run info log; exits 7; calls_no apt-get
case_of 'package'
run package; exits 0; prints /build/package/a.deb; calls '--target package_files'
calls "cpack --config $root/build/release/CPackConfig.cmake"
case_of 'docs: a warning is an error'
tool doxygen 'exit 0'; tool sphinx-build 'exit 0'
run docs; exits 0; prints /build/docs/html/index.html; calls '--target python_module'; calls 'sphinx-build -W'
prints '--out run'
tool doxygen 'echo "law.h:1: warning: Member kp is not documented"; exit 1'
run docs; exits 1; prints 'kp is not documented'; prints 'the site is not complete'; calls_no sphinx-build
tool doxygen 'exit 0'
case_of 'test: three builds, each its tests; the last line is the count'
run test; exits 0; [[ $output == *$'\n75 passed, 0 failed' ]] || fail 'no count at the end'
calls "$root/build/release --target slow_tests"; calls "$root/build/asan-ubsan --target fast_tests"
calls "$root/build/tsan --target thread_tests"; calls '-L ^slow$'; calls '-L ^fast$'; calls '-L ^threads$'
calls 'ip link set lo up'; calls_no '-LE'; prints 'building and testing take 35 to 45 minutes'
calls "cmake -S $root --preset release -DTACHLESS_TESTS=ON -DCMAKE_COMPILE_WARNING_AS_ERROR=OFF"
case_of 'after test, run configures nothing; a warning is an error in continuous integration only'
run info log; calls_no --preset; touch "$root/core"; run info log; calls_no --preset
ci=true; run test; calls '-DCMAKE_COMPILE_WARNING_AS_ERROR=ON'; ci=
run test; calls '-DCMAKE_COMPILE_WARNING_AS_ERROR=OFF'; run test; calls_no --preset
case_of 'test: the search path has the tools of root'
tool ctest '[[ $PATH == *:/usr/sbin* ]] && echo "100% tests passed, 0 tests failed out of 25"'
run test; exits 0
case_of 'test --all'
run test --all; calls "$root/build/release --target all"; calls_no '-L ^slow$'
case_of 'test of a selection is of one build'
run test --label launch --preset asan-ubsan test_a test_b; exits 0; prints '25 passed, 0 failed'
calls '-L launch -R test_a|test_b'; calls_no 'build/release'
run test --preset fast; exits 2; prints 'must be dev, release, asan-ubsan or tsan'
run test --help; exits 0; prints '--all'
case_of 'test where mount namespaces are forbidden'
tool unshare 'shift; [[ $1 != mount ]] || exit 1; exec "$@"'
tool ctest 'case "$*" in *" -N "*) echo "Total Tests: 2" ;; *) echo "100% tests passed, 0 tests failed out of 25" ;; esac'
run test; exits 0; prints 'not tested: '; prints '75 passed, 0 failed, 6 skipped'; calls '-LE ^namespaces$'
tool unshare 'exit 1'
run test; exits 2; prints 'private network namespace'
tool unshare 'shift; exec "$@"'
case_of 'failures count'
tool ctest 'echo "96% tests passed, 1 tests failed out of 25"; exit 8'
run test; exits 1; prints '72 passed, 3 failed'
tool ctest 'echo "No tests were found!!!"'; run test nothing; exits 1
tool ctest 'exit 139'; run test --preset release; exits 1; prints '0 passed, 1 failed'
touch "$root/broken"; run test; exits 1; prints 'a.cpp:1: error: broken'; prints '0 passed, 3 failed'
((failures == 0)) && echo "all cases pass"
