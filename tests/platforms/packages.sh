#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Debian packages: made, looked at by lintian, installed into a fresh chroot, used there (installed.sh), and removed again.
#   packages.sh FOLDER [bookworm|trixie]      none named: this machine's release
# FOLDER/RELEASE is where a release that is not this machine's is built (chroot.sh), FOLDER/fresh-RELEASE is the fresh one.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
tree=$(cd "$here/../.." && pwd)
own=$(. /etc/os-release && echo "$VERSION_CODENAME")
folder=${1:?usage: packages.sh FOLDER [RELEASE]}
release=${2:-$own}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)

make='set -e; source cmake/setup.sh; install_missing "${nearmesh_packages[@]}" dpkg-dev file lintian pybind11-dev python3-dev
  build_preset package >/dev/null; rm -rf build/package/packages/*.deb; (cd build/package && cpack -G DEB >/dev/null)
  lintian --fail-on error,warning build/package/packages/*.deb && echo "lintian: nothing to say"'
if [[ $release == "$own" ]]; then
  (cd "$tree" && bash -c "$make")
  built=$tree/build/package/packages
else
  "$here/chroot.sh" --release "$release" "$folder/$release" bash -c "$make"
  built=$folder/$release.build/package/packages
fi

fresh=$folder/fresh-$release
mkdir -p "$fresh.out/packages"
rm -f "$fresh.out"/packages/*
cp "$built"/*.deb "$fresh.out/packages"
"$here/chroot.sh" --release "$release" "$fresh" tests/platforms/installed.sh install
"$here/chroot.sh" --release "$release" --alone "$fresh" tests/platforms/installed.sh use
"$here/chroot.sh" --release "$release" "$fresh" tests/platforms/installed.sh remove
echo "packages: all hold on $release"
