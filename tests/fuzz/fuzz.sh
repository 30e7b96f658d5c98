#!/bin/sh
# fuzz.sh FUZZER SEEDS NAME RUNS LONGEST: fuzzes from fresh seeds, with a fixed random seed.
set -eu
corpus=$(mktemp -d)
trap 'rm -rf "$corpus"' EXIT
"$2" "$3" "$corpus"
"$1" -runs="$4" -max_len="$5" -seed=1 -timeout=10 -rss_limit_mb=1024 -print_final_stats=1 \
  -artifact_prefix="$(dirname "$1")/" "$corpus" 2>&1 | tail -n 40 >"$1.out" || true
cat "$1.out"
grep -q "^Done $4 runs" "$1.out"
