#!/usr/bin/env bash
# Writes what Debian packages contain beside programs and libraries: man pages and completions, made
# from the programs' help texts, and the changelog.
set -euo pipefail
usage="usage: package_files.sh PROGRAM_DIR OUT_DIR VERSION"
programs=${1:?$usage} out=${2:?$usage} version=${3:?$usage}
tree=$(dirname "$(dirname "$(readlink -f "$0")")")
man=$out/share/man/man1
bash=$out/share/bash-completion/completions
zsh=$out/share/zsh/vendor-completions
rm -rf "$out"
mkdir -p "$man" "$bash" "$zsh"

rows=$("$tree/cmake/completion.sh" "$programs/tachless")
cat >"$bash/tachless" <<EOF
_tachless() {
  local now=\${COMP_WORDS[COMP_CWORD]} before=\${COMP_WORDS[COMP_CWORD-1]} verb=\${COMP_WORDS[1]} offer=
  ((COMP_CWORD > 1)) || verb=tachless
  case \$verb,\$before in
$rows
  esac
  mapfile -t COMPREPLY < <(compgen -W "\$offer" -- "\$now")
}
complete -o default -F _tachless tachless
EOF
cat >"$zsh/_tachless" <<EOF
#compdef tachless
local now=\$PREFIX before=\${words[CURRENT-1]} verb=\${words[2]} offer=
((CURRENT > 2)) || verb=tachless
case \$verb,\$before in
$rows
esac
if [[ -n \$offer ]]; then compadd -- \${=offer}; else _files; fi
EOF

# man_page PROGRAM [INCLUDED FILE]
man_page() {
  local name
  name=$("$programs/$1" --help | head -n 1 | sed 's/\.$//')
  help2man --no-info --name "$name" --version-string "$version" --output "$man/$1.1" \
    ${2:+--include "$2"} "$programs/$1"
}
verbs=$out/verbs.h2m
for verb in $("$programs/tachless" --help | sed -n '/^Subcommands:/,/^Examples/s/^  \([a-z]*\) .*/\1/p'); do
  printf '[tachless %s]\n.nf\n' "$verb"
  "$programs/tachless" "$verb" --help | sed 's/\\/\\\\/g; s/-/\\-/g; s/^[.'\'']/\\\&&/; s/^\[/ [/; s/^\//\\\&\//'
  printf '.fi\n\n'
done >"$verbs"
man_page tachless "$verbs"
rm "$verbs"
for program in plant reference controller logger; do man_page "tachless-$program"; done

date=$(date -R -u -r "$tree/CHANGELOG.md")
printf 'tachless (%s) unstable; urgency=medium\n\n  * See CHANGELOG.md.\n\n -- %s  %s\n' \
  "$version" "The tachless authors <authors@tachless.invalid>" "$date" >"$out/changelog"
gzip -9n "$out/changelog" "$man"/*
