#!/bin/sh
# private_network.sh COMMAND…: runs the command in a network namespace of its own. If user namespaces are
# forbidden, as in a chroot, root can still make one.
if unshare -n true 2>/dev/null; then
  exec unshare -n "$@"
fi
exec unshare -rn "$@"
