#!/usr/bin/env bash
# Installs the Python package by pip in a virtual environment, without network. The package simulates, finds the
# program by TACHLESS or PATH, and states the remedy if there is no program.
set -euo pipefail
tree=${1:?usage: pip.sh SOURCE_DIR BUILD_DIR}
build=${2:?usage: pip.sh SOURCE_DIR BUILD_DIR}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/tree"
cp -r "$tree"/{pyproject.toml,setup.py,CMakeLists.txt,python} "$folder/tree" # pip writes beside them
cd "$folder"
unset PYTHONPATH TACHLESS
/usr/bin/python3 -m venv --system-site-packages venv
TACHLESS_BUILD=$build venv/bin/pip install --no-build-isolation --no-index ./tree

cat >simulate.py <<'END'
import sys, tachless
assert tachless.__file__.startswith(sys.prefix), tachless.__file__
assert tachless.simulate(sys.argv[1], **{"loop.duration_s": 0.01})["q"].shape == (200, 2)
END
cat >certify.py <<'END'
import sys, tachless
try:
    print(tachless.certify(sys.argv[1]))
except tachless.Error as error:
    sys.exit(f"{error.code}: {error}")
END
scenario=$tree/scenarios/paper_rigid.yaml
venv/bin/python simulate.py "$scenario"
# expect WORDS VARIABLE=VALUE…: fails unless certify.py prints the words in that environment.
expect() {
  local words=$1 said
  shift
  said=$(env "$@" venv/bin/python certify.py "$scenario" 2>&1) || true
  [[ $said == *"$words"* ]] || { echo "expected: $words; printed: $said"; exit 1; }
}
expect 'paper_rigid: loria_ortega_rigid' TACHLESS="$build/bin/tachless"
expect 'paper_rigid: loria_ortega_rigid' PATH="$build/bin"
expect '2: no program tachless beside this package or in PATH; install it, or set TACHLESS to its path' PATH=/nowhere
expect "2: TACHLESS is '/nowhere/tachless': no such program" TACHLESS=/nowhere/tachless
