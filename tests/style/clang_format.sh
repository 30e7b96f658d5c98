#!/usr/bin/env bash
# Checks that every source file has clang-format's format.
set -euo pipefail
cd "${1:?usage: clang_format.sh SOURCE_DIR}"
folders=()
for folder in core plant reference controller logger analysis tools python tests bench examples; do
  [[ -d $folder ]] && folders+=("$folder")
done
find "${folders[@]}" \
  \( -name '*.cpp' -o -name '*.h' \) -print0 |
  xargs -0 clang-format --dry-run -Werror
