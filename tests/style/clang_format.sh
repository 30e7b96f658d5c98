#!/usr/bin/env bash
# Every source file is as clang-format writes it.
set -euo pipefail
cd "${1:?usage: clang_format.sh SOURCE_DIR}"
find robot bus app plant reference controller logger study launch tests bench docs \
  \( -name '*.cpp' -o -name '*.h' \) -print0 |
  xargs -0 clang-format --dry-run -Werror
