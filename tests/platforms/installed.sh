#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Inside a fresh chroot: installs the packages in out/packages, uses them, removes them (packages.sh).
#   installed.sh install|use|remove
set -euo pipefail
cd "$(dirname "$0")/../.."
source=$PWD
out=$PWD/out/use
quietly() { "$@" >"$source/out/quiet.log" 2>&1 || { tail -n 30 "$source/out/quiet.log" >&2; return 1; }; }

case $1 in
  install)
    export DEBIAN_FRONTEND=noninteractive
    quietly apt-get -q update
    quietly apt-get -qy install --no-install-recommends "$source"/out/packages/nearmesh-tools*.deb
    for program in nearmesh-model nearmesh-publisher nearmesh-subscriber; do $program --version | head -n 1; done
    quietly apt-get -qy install --no-install-recommends "$source"/out/packages/{libnearmesh0,libnearmesh-dev,python3-nearmesh}_*.deb
    quietly apt-get -qy install --no-install-recommends g++ make cmake pkg-config libcli11-dev systemd
    dpkg -L nearmesh-tools libnearmesh-dev libnearmesh0 python3-nearmesh | sort -u >out/files
    ;;
  use)
    rm -rf "$out"
    mkdir -p "$out"
    cd "$out"
    settings=/usr/share/doc/nearmesh-tools/examples
    bus=(--domain 31 --interface 127.0.0.1)
    trap 'kill $(jobs -p) 2>/dev/null || true' EXIT
    quietly nearmesh-model generate terrain --size 200 -o terrain.ply
    quietly nearmesh-model generate aircraft -o aircraft.ply
    quietly nearmesh-model build terrain.ply -o terrain.spm
    quietly nearmesh-model build aircraft.ply -o aircraft.spm
    quietly nearmesh-demo-flights . --size 200 --frames 100
    cp $settings/demo/peer?.yaml .
    echo "baked: $(stat -c %s terrain.spm) bytes"
    # As the unit does it: its command with the example's settings, by a user who owns nothing.
    mkdir -p /etc/nearmesh /srv/nearmesh
    cp terrain.spm aircraft.spm /srv/nearmesh
    cp $settings/settings/publisher.yaml /etc/nearmesh
    unit=$(grep service$ "$source/out/files")
    # What it does not understand it says, and ends with 0.
    said=$(systemd-analyze verify "$unit" 2>&1) && ! grep -i nearmesh <<<"$said" || { echo "$said" >&2; exit 1; }
    echo "unit: accepted by systemd-analyze verify"
    command=$(sed -n 's/^ExecStart=//p' "$unit")
    (exec env NEARMESH_DOMAIN=31 NEARMESH_INTERFACE=127.0.0.1 setpriv --reuid 65534 --regid 65534 --clear-groups --no-new-privs \
       --inh-caps=-all $command >publisher.log 2>&1) &
    publisher=$!
    (exec nearmesh-subscriber record -o flight.db3 "${bus[@]}" >recorder.log 2>&1) &
    recorder=$!
    for log in publisher.log recorder.log; do
      for _ in $(seq 300); do grep -qE "ready on domain|recording domain" $log && break; sleep 0.1; done
    done
    nearmesh-subscriber run peer1.yaml --answers answers1.jsonl "${bus[@]}" >peer1.log 2>&1 &
    peer1=$!
    nearmesh-subscriber run peer2.yaml --answers answers2.jsonl "${bus[@]}" >peer2.log 2>&1
    wait $peer1
    kill -INT $publisher $recorder
    wait $publisher
    wait $recorder
    echo "flown: $(nearmesh-model check terrain.spm aircraft.spm --answers answers1.jsonl answers2.jsonl | head -n 1)"
    echo "verified: $(nearmesh-subscriber verify flight.db3 | head -n 1)"
    rm -rf /etc/nearmesh /srv/nearmesh
    quietly cmake -S "$source/tests/consumer/project" -B consumer -DCMAKE_BUILD_TYPE=Release \
      -DCOMPONENTS=core,meshio,recording,subscriber_dds
    quietly cmake --build consumer -j2
    quietly consumer/two_spheres
    echo "consumer by CMake: built and run"
    for name in two_spheres local_peer lone_peer; do
      module=nearmesh-cpp
      if [[ $name == two_spheres ]]; then module=nearmesh-core; fi
      quietly g++ -std=c++20 -O1 $(pkg-config --cflags $module) "$source/tests/consumer/project/$name.cpp" -o $name \
        $(pkg-config --libs $module)
    done
    quietly ./two_spheres
    echo "consumer by pkg-config: built and run"
    quietly gcc -std=c11 $(pkg-config --cflags nearmesh) "$source/tests/consumer/c_project/two_cubes.c" -o two_cubes \
      $(pkg-config --libs nearmesh)
    quietly cmake -S "$source/tests/consumer/c_project" -B consumer_in_c
    quietly cmake --build consumer_in_c
    quietly ./two_cubes cube.spm
    quietly consumer_in_c/two_cubes cube.spm
    echo "programs in C by pkg-config and CMake: built and run"
    quietly cmake -S /usr/share/doc/libnearmesh-dev/examples/flightgear -B flightgear -DCMAKE_BUILD_TYPE=Release
    quietly cmake --build flightgear -j2
    quietly flightgear/nearmesh-example-flightgear --version
    echo "examples/flightgear: built from the package"
    python3 - <<'PYTHON'
import numpy as np
import nearmesh as nm
vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
tetra = nm.bake(vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]), "tetra.spm")
poses = np.tile(np.eye(4), (2, 1, 1))
poses[:, 0, 3] = 0.3, 1.5
answers = nm.Pair(tetra, tetra).query(np.eye(4), poses)
assert list(answers["status"] == nm.Status.CONTACT) == [True, False] and all(answers["certified"])
session = nm.Session.dds(domain=31, interface="127.0.0.1")
print("Python", nm.__version__ + ": baked, asked, joined a bus")
PYTHON
    test -s /usr/share/nearmesh/idl/nearmesh.idl
    for page in model publisher subscriber demo-flights; do
      test -s /usr/share/man/man1/nearmesh-$page.1.gz || test ! -d /usr/share/man/man1  # minimal systems may leave them out
      bash -c "source /usr/share/bash-completion/completions/nearmesh-$page && complete -p nearmesh-$page" >complete.txt
    done
    ;;
  remove)
    quietly apt-get -qy purge nearmesh-tools libnearmesh-dev libnearmesh0 python3-nearmesh
    left=$(while read -r file; do [[ -e $file && ! -d $file ]] && echo "$file"; done <out/files || true)
    left+=$(find / -xdev \( -path /nearmesh -o -path /proc \) -prune -o -iname '*nearmesh*' -print)
    if [[ -n $left ]]; then echo "left after removal: $left" >&2; exit 1; fi
    echo "removed: nothing is left of $(wc -l <out/files) files and folders"
    ;;
esac
