#!/usr/bin/env bash
# Every source file is as clang-format writes it.
set -euo pipefail
cd "${1:?usage: clang_format.sh SOURCE_DIR}"
mapfile -t rooms < <(sed -nE 's/^([a-z]+) .*/\1/p' cmake/rooms.txt)
for other in tests bench examples; do
  [[ -d $other ]] && rooms+=("$other")
done
find "${rooms[@]}" \
  \( -name '*.cpp' -o -name '*.h' \) -print0 |
  xargs -0 clang-format --dry-run -Werror
