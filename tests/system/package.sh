#!/usr/bin/env bash
# Builds the Debian packages, unpacks them, and works with what is in them where neither the source tree
# nor the build can be seen: a run of an installed scenario, a law of one's own built and run, a project
# of one's own.
set -euo pipefail
tree=${1:?usage: package.sh SOURCE_DIR BUILD_DIR}
build=${2:?usage: package.sh SOURCE_DIR BUILD_DIR}
[[ $build == "$tree"/* ]] || { echo "the build has to be in the tree, which is hidden"; exit 1; }
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT

cmake --build "$build" --target package_files
cpack --config "$build/CPackConfig.cmake" -B "$root/package"
for package in "$root"/package/*.deb; do dpkg-deb -x "$package" "$root"; done
cd "$root"

# A man page for each program and verb, which groff takes without a warning, with every exit code.
verbs=$(sed -n 's/^TACHLESS_VERB(\(.*\))/-\1/p' "$tree/tools/cli/verbs.inc")
codes=$(sed -n 's/^  [a-z_]* = \([0-9]*\),.*/\1/p' "$tree/core/base/failure.h")
[[ $verbs == *-run* && $codes == *130* ]]
for page in '' -plant -reference -controller -logger -mit-can $verbs; do
  zcat "usr/share/man/man1/tachless$page.1.gz" >page
  for line in 'SH SYNOPSIS' 'SH OPTIONS' 'SH EXAMPLES' 'SH EXIT STATUS' 'SH ENVIRONMENT' 'fBTACHLESS_KEY_FILE\fR' 'fBNO_COLOR\fR' 'SH SEE ALSO'; do
    grep -qF "$line" page || { echo "tachless$page.1: no $line"; exit 1; }
  done
  for code in $codes; do grep -qF "fB$code\fR" page || { echo "tachless$page.1: no exit code $code"; exit 1; }; done
  warnings=$(groff -man -ww -z -k -Tutf8 -rLL=78n page 2>&1)
  [[ -z $warnings ]] || { echo "tachless$page.1: $warnings"; exit 1; }
done
rm page
zcat usr/share/man/man1/tachless-plant.1.gz | grep -q 'run\\-id'

cat >user.sh <<'END'
set -euo pipefail
mount -t tmpfs none "$TREE"
[[ ! -e $TREE/tachless ]]
ip link set lo up multicast on
ip route add 224.0.0.0/4 dev lo
PATH=$ROOT/usr/bin:/usr/bin:$PATH
mkdir home && cd home
tachless run paper_rigid --duration 0.05
tachless replay out/paper_rigid
tachless report out/paper_rigid
grep -q THREE out/paper_rigid/latest/report.html

# The tutorial as typed; a line may say the exit code that it is to end with.
export PYTHONPATH=$ROOT/usr/lib/python3/dist-packages
home=$PWD typed=0
while IFS= read -r line; do
  echo "\$ $line"
  code=0
  eval "$line" || code=$?
  [[ $line =~ \#\ exit\ code\ ([0-9]+) ]] && expected=${BASH_REMATCH[1]} || expected=0
  ((code == expected)) || { echo "exit code $code, not $expected"; exit 1; }
  typed=$((typed + 1))
done < <(awk '/^```/ { typed = $0 == "```sh"; next } typed' "$ROOT/usr/share/doc/tachless/docs/tutorial.md")
((typed >= 15))
tachless info out/python | grep 'MyLaw (external)'
cd "$home"

cp -r "$ROOT/usr/share/tachless/examples/own_law" .
cmake -S own_law -B own_law/build -DCMAKE_PREFIX_PATH="$ROOT/usr" >cmake.log || { cat cmake.log; exit 1; }
cmake --build own_law/build
cd own_law/build
tachless run ../own_law.yaml --controller ./own_law
tachless info out/own_law | grep my_law
END
ROOT=$root TREE=$tree unshare -rmn bash user.sh
