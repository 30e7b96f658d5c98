#!/usr/bin/env bash
# completion.sh PROGRAM: prints rows of `case "$verb,$before"` from the program's help texts. A row sets
# `offer` to the words that a shell offers after these two words. An empty `offer` means files.
set -euo pipefail
program=${1:?usage: completion.sh PROGRAM}
verbs=$("$program" --help | sed -n '/^Subcommands:/,/^Examples/s/^  \([a-z]*\) .*/\1/p' | tr '\n' ' ')
printf "    tachless,* | help,help) offer='help %s' ;;\n" "${verbs% }"
for verb in $verbs; do
  "$program" "$verb" --help | awk -v verb="$verb" '
    /^  -/ {  # "  -o,--out TEXT:{one,other} REQUIRED   What it is for"
      names = $1; gsub(/,/, " ", names); all = all " " names
      if ($2 !~ /^[A-Z]+(:|$)/) next
      choices = ""
      if (match($2, /\{.*\}/)) { choices = substr($2, RSTART + 1, RLENGTH - 2); gsub(/,/, " ", choices) }
      n = split(names, name, " ")
      for (i = 1; i <= n; ++i) printf "    %s,%s) offer=\047%s\047 ;;\n", verb, name[i], choices
    }
    END { printf "    %s,*) [[ $now != -* ]] || offer=\047%s\047 ;;\n", verb, substr(all, 2) }'
done
