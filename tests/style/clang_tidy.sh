#!/usr/bin/env bash
# clang-tidy over every .cpp of the rooms. What passed is not looked at again until it, one of the
# headers it includes, or the configuration has changed.
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

mapfile -t rooms < <(sed -nE 's/^([a-z]+) .*/\1/p' cmake/rooms.txt)
either=$(IFS='|'; echo "${rooms[*]}")
[[ ! -d examples ]] || rooms+=(examples)

# Most of the time goes into the headers, so sources that are compiled alike are read together: a batch
# is a source that includes up to 15 of them. Those that the build does not compile are each alone.
mkdir "$scratch/batch"
sed -nE 's/^  "command": "(.*) -o [^ ]+ -c ([^ ]+)",$/\1\t\2/p' "$scratch/compile_commands.json" |
  { grep -E $'\t'"$source_dir/($either)/" || true; } | sort |
  awk -F'\t' -v to="$scratch/batch" -v from="$source_dir/" -v in_dir="$build_dir" '
    $1 != command || ++size > 15 {
      command = $1; size = 1; batch = to "/" ++batches
      printf "%s{\"directory\": \"%s\", \"command\": \"%s -Wno-shadow -c %s.cpp\", \"file\": \"%s.cpp\"}",
        (batches > 1 ? ",\n" : "["), in_dir, command, batch, batch > (to "/compile_commands.json")
    }
    { print "#define main main_of_" size "\n#include \"" $2 "\"  // NOLINT\n#undef main" > (batch ".cpp")
      print substr($2, length(from) + 1) > (batch ".files") }
    END { if (batches) print "]" > (to "/compile_commands.json") }'
compiled=$(cat "$scratch"/batch/*.files 2>/dev/null || true)
find "${rooms[@]}" -name '*.cpp' | grep -v -x -F "$compiled" |
  while IFS= read -r file; do echo "$file" >"$scratch/batch/alone-${file//\//-}.files"; done || true

objections() {
  clang-tidy -p "$1" --config-file=.clang-tidy --extra-arg=-Wno-unknown-warning-option --quiet \
    --header-filter="/($either)/([^/]*/)*[^/]*\\.(h|cpp)\$" "$2" 2>&1
}

# What it objects to in a batch is asked for again file by file: two sources that cannot be read
# together, for names that both have, are no mistake.
check() {
  local batch=${1%.files} files file hash inputs said ok=0
  mapfile -t files <"$1"
  inputs=$(for file in "${files[@]}"; do
    awk -v file="$file" '
      /^[^ ]/ { object = $0; keep = index(object, "/" substr(file, 1 + match(file, /[^\/]*$/) - 1) ".o") }
      /^ / && keep { print $1 }' "$dependencies"
  done | sed "s|^\.\./\.\./|$source_dir/|" | grep "^$source_dir/" | sort -u || true)
  hash=$(cat .clang-tidy "${files[@]}" $inputs | sha256sum | cut -d' ' -f1)
  [[ -e $passed/$hash ]] && return
  if ((${#files[@]} == 1)) || ! objections "$scratch/batch" "$batch.cpp" >/dev/null; then
    for file in "${files[@]}"; do
      said=$(objections "$scratch" "$file") && continue
      echo "$said"
      echo "clang-tidy objects to $file"
      ok=1
    done
  fi
  ((ok == 0)) && touch "$passed/$hash"
}
export -f check objections
export source_dir scratch passed dependencies either

find "$scratch/batch" -name '*.files' -print0 |
  xargs -0 -n 1 -P 2 bash -c 'set -euo pipefail; check "$1"' bash
