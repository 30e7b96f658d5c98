#!/usr/bin/env bash
# Runs clang-tidy over every source of the product and examples, in the batches in which the build compiles
# them. A batch that passed is skipped until one of its files, or the configuration, has changed.
set -euo pipefail
source_dir=$(readlink -f "${1:?usage: clang_tidy.sh SOURCE_DIR BUILD_DIR}")
build_dir=$(readlink -f "${2:?usage: clang_tidy.sh SOURCE_DIR BUILD_DIR}")
passed=$build_dir/clang-tidy-passed
mkdir -p "$passed"
cd "$source_dir"

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir -p "$scratch/include/tachless"  # the examples include the headers as installed
for library in "$source_dir"/{plant,reference,controller,logger} "$source_dir"/{core,analysis,tools}/*/; do
  [[ ! -d $library ]] || ln -s "$library" "$scratch/include/tachless/$(basename "$library")"
done
# clang cannot read g++'s precompiled headers.
sed -E 's/ -Winvalid-pch -include [^ ]*cmake_pch\.hxx//' "$build_dir/compile_commands.json" >"$scratch/compile_commands.json"
# ninja's record of the dependencies of each object: "object: …" and then indented lines.
ninja -C "$build_dir" -t deps >"$scratch/dependencies"

folders=()
for folder in core plant reference controller logger analysis tools python; do
  [[ -d $folder ]] && folders+=("$folder")
done
either=$(IFS='|'; echo "${folders[*]}")
[[ ! -d examples ]] || folders+=(examples)

# "source<tab>object" of every product file that the build compiles; then the sources that it does not
# compile.
sed -nE 's/^  "command": ".* -o ([^ ]+) -c ([^ ]+)",$/\2\t\1/p' "$scratch/compile_commands.json" |
  { grep -E $'\t'"($either)/" || true; } >"$scratch/compiled"
compiled=$(cut -f1 "$scratch/compiled" | while IFS= read -r file; do
  [[ $file != */Unity/* ]] && echo "$file" || sed -nE 's/^#include "(.*)"$/\1/p' "$file"
done | sed "s|^$source_dir/||")
find "${folders[@]}" -name '*.cpp' | grep -v -x -F "$compiled" | sed 's/$/\t-/' >>"$scratch/compiled" || true

check() {
  local source=${1%%$'\t'*} object=${1#*$'\t'} inputs hash objections
  inputs=$(awk -v object="$object:" '/^[^ ]/ { keep = $1 == object } /^ / && keep { print $1 }' \
    "$scratch/dependencies" | sed "s|^\.\./\.\./|$source_dir/|" | grep "^$source_dir/" | sort -u || true)
  hash=$(cat .clang-tidy "$source" $inputs | sha256sum | cut -d' ' -f1)
  [[ -e $passed/$hash ]] && return
  # A batch is a source that includes others.
  if ! objections=$(clang-tidy -p "$scratch" --config-file=.clang-tidy --checks=-bugprone-suspicious-include \
      --extra-arg=-Wno-unknown-warning-option --extra-arg="-I$scratch/include" --quiet \
      --header-filter="/($either)/([^/]*/)*[^/]*\\.(h|cpp)\$" "$source" 2>&1); then
    echo "$objections"
    echo "clang-tidy objects to $source"
    return 1
  fi
  touch "$passed/$hash"
}
export -f check
export source_dir scratch passed either

tr '\n' '\0' <"$scratch/compiled" | xargs -0 -n 1 -P 2 bash -c 'set -euo pipefail; check "$1"' bash
