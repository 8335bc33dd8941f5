#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The README's two commands on Debian 13: ./demo and ./test in a chroot, which is made where it is not there.
#   trixie.sh FOLDER
set -euo pipefail
here=$(dirname "$0")
folder=${1:?usage: trixie.sh FOLDER}
# They install what they need; that needs the network, so once for all and before the rest goes on alone.
"$here/chroot.sh" "$folder" bash -c 'command -v ccache >/dev/null || { apt-get -q update && apt-get -qy install --no-install-recommends ccache; } >/dev/null 2>&1'
"$here/chroot.sh" "$folder" ./test -N
"$here/chroot.sh" --alone "$folder" ./demo
"$here/chroot.sh" --alone "$folder" ./test
