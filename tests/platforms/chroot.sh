#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command in another Debian, which is made in a folder by debootstrap where it is not there yet. Needs root.
#   chroot.sh [--alone] [--release trixie] FOLDER COMMAND...
# Inside, /nearmesh is this tree, read-only but for build/ and out/, which are the folder's own: FOLDER.build, FOLDER.out. The
# shared test data (NEARMESH_TEST_DATA, else ../shared/data) are at /shared/data. Compilations go through this machine's
# ccache, where both have one.
# --alone: in a network namespace of its own, with loopback alone: nobody else hears what is said there. Without it the
# command has the network, to install packages.
set -euo pipefail

release=trixie alone=()
while [[ ${1:-} == --* ]]; do
  case $1 in
    --alone) alone=(--net) ;;
    --release) release=$2; shift ;;
    *) echo "chroot.sh: unknown option $1" >&2; exit 2 ;;
  esac
  shift
done
if [[ $# -lt 2 ]]; then sed -n 3,9p "$0" >&2; exit 2; fi
mkdir -p "$1"
root=$(cd "$1" && pwd)
shift
tree=$(cd "$(dirname "$0")/../.." && pwd)

if [[ ! -e $root/.made ]]; then
  if ! command -v debootstrap >/dev/null; then
    DEBIAN_FRONTEND=noninteractive apt-get -qy install --no-install-recommends debootstrap >/dev/null
  fi
  echo "Making $release in $root"
  debootstrap --variant=minbase "$release" "$root" >"$root.log" 2>&1 || { tail "$root.log" >&2; exit 1; }
  touch "$root/.made"
fi
cp -L /etc/resolv.conf "$root/etc/resolv.conf"
mkdir -p "$tree/build" "$tree/out" "$root.build" "$root.out"

# Mounts are seen by this command alone, and are gone when it ends.
export root tree
export data=${NEARMESH_TEST_DATA:-$tree/../shared/data}
export is_alone=${alone:+yes}
export cache=${CCACHE_DIR:-$(ccache -k cache_dir 2>/dev/null || true)}
exec unshare --mount --propagation private "${alone[@]}" bash -euc '
  if [[ $is_alone ]]; then ip link set lo up && ip link set lo multicast on; fi
  onto() { mkdir -p "$root$2" && mount --bind "$1" "$root$2"; }
  onto "$tree" /nearmesh && mount -o remount,bind,ro "$root/nearmesh"
  onto "$root.build" /nearmesh/build
  onto "$root.out" /nearmesh/out
  if [[ -d $data ]]; then onto "$data" /shared/data && mount -o remount,bind,ro "$root/shared/data"; fi
  mkdir -p "$root/proc" "$root/dev" "$root/sys"
  mount -t proc proc "$root/proc"
  mount --rbind /dev "$root/dev"
  mount -t sysfs -o ro sysfs "$root/sys" || mount --rbind /sys "$root/sys"
  with=()
  if [[ -d $cache && -x $root/usr/bin/ccache ]]; then
    onto "$cache" /ccache
    with=(CMAKE_CXX_COMPILER_LAUNCHER=ccache CMAKE_C_COMPILER_LAUNCHER=ccache CCACHE_DIR=/ccache)
  fi
  for name in "${!NEARMESH_@}"; do with+=("$name=${!name}"); done
  if [[ -n ${NEARMESH_TEST_DATA:-} ]]; then with+=(NEARMESH_TEST_DATA=/shared/data); fi
  exec chroot "$root" env -i HOME=/tmp LANG=C.UTF-8 TERM="${TERM:-dumb}" PATH=/usr/sbin:/usr/bin:/sbin:/bin "${with[@]}" \
    bash -c "cd /nearmesh && exec \"\$@\"" -- "$@"' -- "$@"
