#!/usr/bin/env bash
# Writes the files of the Debian packages beside programs and libraries. These are man pages and completions,
# made from the programs' help texts, and the changelog.
set -euo pipefail
usage="usage: package_files.sh PROGRAM_DIR OUT_DIR VERSION [DRIVER …]"
programs=${1:?$usage} out=${2:?$usage} version=${3:?$usage}
drivers=("${@:4}")
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

# Every man page ends with the same blocks. These are the exit codes of `tachless --help` and, from
# docs/README.md, the programs' environment variables.
ends=$out/ends
{
  "$programs/tachless" --help | sed -n '/^Exit codes: /,$p' | tr '\n' ' ' |
    sed 's/^Exit codes: //; s/\. *$/\n/; s/\(^\|, \)\([0-9]*\) /\n.TP\n\\fB\2\\fR\n/g' | grep .
  echo '.SH ENVIRONMENT'
  sed -nE 's/^\| `(LCM_DEFAULT_URL|NO_COLOR|TACHLESS_(KEY_FILE|ISOLATE=1))` \| (.*) \|$/.TP\n\\fB\1\\fR\n\3/p' "$tree/docs/README.md" |
    sed 's/`//g; s/\[\([^]]*\)\]([^)]*)/\1/g; s/-/\\-/g'
} >"$ends"

# man_page NAME COMMAND…: writes the man page of the output of COMMAND --help.
man_page() {
  local name=$1
  {
    "$programs/$2" "${@:3}" --help |
      awk -v name="$name" -v title="$(date -u -r "$tree/CHANGELOG.md" +%F) \"tachless $version\" \"User Commands\"" -f "$tree/cmake/man_page.awk"
    cat "$ends"
    printf '.SH SEE ALSO\n'
    [[ $name == tachless ]] || printf '\\fBtachless\\fR(1), '
    [[ $name != tachless ]] || printf '\\fBtachless\\-%s\\fR(1), ' plant reference controller logger
    printf '/usr/share/doc/tachless/docs\n'
  } >"$man/$name.1"
}
for verb in '' $("$programs/tachless" --help | sed -n '/^Subcommands:/,/^Examples/s/^  \([a-z]*\) .*/\1/p'); do
  man_page "tachless${verb:+-$verb}" tachless ${verb:+"$verb"}
done
for program in plant reference controller logger; do man_page "tachless-$program" "tachless-$program"; done
for driver in "${drivers[@]}"; do  # each in a package of its own
  man_page "$driver" "$driver"
  mkdir -p "$out/$driver/share/man/man1"
  mv "$man/$driver.1" "$out/$driver/share/man/man1"
done
rm "$ends"

date=$(date -R -u -r "$tree/CHANGELOG.md")
printf 'tachless (%s) unstable; urgency=medium\n\n  * See CHANGELOG.md.\n\n -- %s  %s\n' \
  "$version" "The tachless authors <authors@tachless.invalid>" "$date" >"$out/changelog"
gzip -9n "$out/changelog" "$man"/* "$out"/*/share/man/man1/*
