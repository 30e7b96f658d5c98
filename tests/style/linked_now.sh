#!/bin/sh
# Checks that programs that receive datagrams resolve all addresses at their start: linked_now.sh PROGRAM...
for program in "$@"; do
  readelf -d "$program" | grep -q 'BIND_NOW\|FLAGS_1.*NOW' || { echo "$program: not linked with -z now"; exit 1; }
done
