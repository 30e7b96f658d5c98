#!/usr/bin/env bash
# clang-tidy over every .cpp of the rooms. A file that passed is not looked at again until it, one
# of the headers it includes, or the configuration has changed.
set -euo pipefail
source_dir=$(readlink -f "${1:?usage: clang_tidy.sh SOURCE_DIR BUILD_DIR}")
build_dir=$(readlink -f "${2:?usage: clang_tidy.sh SOURCE_DIR BUILD_DIR}")
passed=$build_dir/clang-tidy-passed
mkdir -p "$passed"
cd "$source_dir"

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# ninja's own record of what each object was made from: "object: …" and then indented lines.
dependencies=$scratch/dependencies
ninja -C "$build_dir" -t deps >"$dependencies"
# g++'s precompiled headers are not clang's.
sed -E 's/ -Winvalid-pch -include [^ ]*cmake_pch\.hxx//' "$build_dir/compile_commands.json" \
  >"$scratch/compile_commands.json"

check() {
  local file=$1 hash inputs said
  inputs=$(awk -v file="$file" '
    /^[^ ]/ { object = $0; keep = index(object, "/" substr(file, 1 + match(file, /[^\/]*$/) - 1) ".o") }
    /^ / && keep { print $1 }' "$dependencies" | sed "s|^\.\./\.\./|$source_dir/|" |
    grep "^$source_dir/" | sort -u || true)
  hash=$(cat .clang-tidy "$file" $inputs | sha256sum | cut -d' ' -f1)
  [[ -e $passed/$hash ]] && return
  if ! said=$(clang-tidy -p "$scratch" --extra-arg=-Wno-unknown-warning-option --header-filter="$headers" --quiet "$file" 2>&1); then
    echo "$said"
    echo "clang-tidy objects to $file"
    return 1
  fi
  touch "$passed/$hash"
}
export -f check
export source_dir scratch passed dependencies

mapfile -t rooms < <(sed -nE 's/^([a-z]+) .*/\1/p' cmake/rooms.txt)
headers="/($(IFS='|'; echo "${rooms[*]}"))/([^/]*/)*[^/]*\.h\$"
export headers
[[ ! -d examples ]] || rooms+=(examples)
find "${rooms[@]}" -name '*.cpp' -print0 |
  xargs -0 -n 1 -P 2 bash -c 'set -euo pipefail; check "$1"' bash
