#!/usr/bin/env bash
# Every source file is as clang-format writes it.
set -euo pipefail
cd "${1:?usage: clang_format.sh SOURCE_DIR}"
rooms=()
for room in robot bus app plant reference controller logger study launch tests bench docs; do
  [[ -d $room ]] && rooms+=("$room")
done
find "${rooms[@]}" \
  \( -name '*.cpp' -o -name '*.h' \) -print0 |
  xargs -0 clang-format --dry-run -Werror
