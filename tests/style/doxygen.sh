#!/usr/bin/env bash
# doxygen.sh SOURCE_DIR BUILD_DIR: checks that the headers of docs/site/Doxyfile document each public name,
# and that docs/site/cpp.md names these headers.
set -euo pipefail
cd "${1:?usage: doxygen.sh SOURCE_DIR BUILD_DIR}"
mkdir -p "$2/doxygen"
{
  cat docs/site/Doxyfile
  echo "OUTPUT_DIRECTORY = $2/doxygen"
} | doxygen -
fail=0 found=0
for header in $(sed -n '/^INPUT =/,/[^\\]$/p' docs/site/Doxyfile | grep -o '[a-z_/]*\.h'); do
  found=$((found + 1))
  grep -qF "\`$header\`" docs/site/cpp.md || { echo "$header: docs/site/cpp.md does not name it"; fail=1; }
done
((found > 10 && !fail))
