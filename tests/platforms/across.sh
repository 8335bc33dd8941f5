#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Debian 12 and Debian 13 side by side: this machine's build/dev, and that of a chroot (chroot.sh). Their programs run in one
# network namespace, with loopback alone. One line for each thing that was tried; exit code 1 with the first that fails.
#   across.sh FOLDER [digest] [models] [udp] [tcp] [discovery] [secured] [recordings] [datagrams]      none named: all
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
if [[ -z ${NEARMESH_ACROSS:-} ]]; then
  NEARMESH_ACROSS=1 exec unshare --net "$0" "$@"
fi
ip link set lo up
ip link set lo multicast on
mkdir -p "${1:?usage: across.sh FOLDER [WHAT...]}"
root=$(cd "$1" && pwd)
shift
what=" ${*:-digest models udp tcp discovery secured recordings datagrams} "
tree=$(cd "$here/../.." && pwd)
out=$root.out/across
rm -rf "$out"  # of an earlier run
mkdir -p "$out"
cd "$out"

# on 12|13 PROGRAM WORDS...: takes the place of this shell, so use it in one of its own.
on() {
  if [[ $1 == 12 ]]; then exec "$tree/build/dev/bin/$2" "${@:3}"; fi
  exec "$here/chroot.sh" "$root" env -C /nearmesh/out/across "/nearmesh/build/dev/bin/$2" "${@:3}"
}
run() { (on "$@"); }
fail() {
  echo "$1: FAILED" >&2
  tail -n 5 "$out"/*.log >&2 || true
  exit 1
}
trap 'kill $(jobs -p) 2>/dev/null || true' EXIT

says() {  # LOG TEXT: waits until it is there
  for _ in $(seq 600); do
    if grep -q "$2" "$1"; then return 0; fi
    sleep 0.1
  done
  fail "$1 did not say '$2'"
}

# fly NAME PUBLISHER PEER1 PEER2, versions each; arrays of options: bus, of_publisher, of_peer1, of_peer2. All answers are to be
# certified; on a busy machine some frames have no time for that, so three flights are tried (UNCERTAIN=10: and as many answers
# a flight may be left so). None may be wrong.
fly() {
  local line
  for _ in 1 2 3; do
    fly_once "$@"
    line=$(head -n 1 check.log)
    echo "$1: publisher $2, peers $3 and $4: $line"
    [[ $line =~ answers\ ([0-9]+),\ wrong\ 0,\ certified\ ([0-9]+) ]] || fail "$1"
    if [[ ${BASH_REMATCH[1]} -gt 0 && $((BASH_REMATCH[1] - BASH_REMATCH[2])) -le ${UNCERTAIN:-0} ]]; then return 0; fi
  done
  fail "$1"
}
fly_once() {
  local name=$1
  rm -f answers?.jsonl
  (on "$2" nearmesh-publisher serve terrain.spm aircraft.spm "${bus[@]}" "${of_publisher[@]}" >publisher.log 2>&1) &
  local publisher=$!
  says publisher.log "ready on domain"
  (on "$3" nearmesh-subscriber run peer1.yaml --answers answers1.jsonl "${bus[@]}" "${of_peer1[@]}" >peer1.log 2>&1) &
  local peer1=$!
  (on "$4" nearmesh-subscriber run peer2.yaml --answers answers2.jsonl "${bus[@]}" "${of_peer2[@]}" >peer2.log 2>&1) &
  local peer2=$!
  wait $peer1 || fail "$name: peer 1 of $3"
  wait $peer2 || fail "$name: peer 2 of $4"
  kill -INT $publisher
  wait $publisher || fail "$name: publisher of $2"
  run 12 nearmesh-model check terrain.spm aircraft.spm --answers answers1.jsonl answers2.jsonl >check.log || fail "$name"
}
# Every publisher with every peer, in two flights.
fly_all() {
  fly "$1" 12 12 13
  fly "$1" 13 13 12
}

# The models and flights of the demo, by programs of 12; kept for the next time.
prepare() {
  cp "$tree"/examples/demo/peer?.yaml .
  if [[ -e prepared ]]; then return 0; fi
  for model in terrain aircraft; do
    run 12 nearmesh-model generate $model -o $model.ply >/dev/null
    run 12 nearmesh-model build $model.ply -o $model.spm >/dev/null 2>&1
  done
  run 12 nearmesh-demo-flights . >/dev/null
  touch prepared
}

reset() {
  bus=(--domain 77 --interface 127.0.0.1)
  of_publisher=() of_peer1=() of_peer2=()
}

echo "12: $(run 12 nearmesh-subscriber --version | tr '\n' ' ')"
echo "13: $(run 13 nearmesh-subscriber --version | tr '\n' ' ')"
prepare

if [[ $what == *" digest "* ]]; then
  (on 12 nearmesh-digest >digest12.txt) &
  (on 13 nearmesh-digest >digest13.txt) &
  wait
  cmp digest12.txt digest13.txt || fail digest
  echo "digest: $(wc -l <digest12.txt) lines are the same"
fi
if [[ $what == *" models "* ]]; then
  for model in terrain aircraft; do
    run 13 nearmesh-model build $model.ply -o $model-13.spm >/dev/null 2>&1
    cmp $model.spm $model-13.spm || fail models
    echo "models: $model, $(stat -c %s $model.spm) bytes are the same"
  done
fi
if [[ $what == *" udp "* ]]; then
  reset
  fly_all udp
fi
if [[ $what == *" tcp "* ]]; then
  reset
  bus+=(--transport tcp)
  of_publisher=(--listen-port 5100)
  of_peer1=(--listen-port 5101 --peer 127.0.0.1:5100)
  of_peer2=(--listen-port 5102 --peer 127.0.0.1:5100 --peer 127.0.0.1:5101)
  fly_all tcp
fi
if [[ $what == *" discovery "* ]]; then
  for version in 12 13; do
    reset
    (on $version nearmesh-publisher discovery --listen 127.0.0.1:11811 --domain 77 >discovery.log 2>&1) &
    server=$!
    says discovery.log "ready: a discovery server"
    bus+=(--discovery-server 127.0.0.1:11811)
    fly_all "discovery server $version"
    kill -INT $server
    wait $server || fail "discovery server $version"
  done
fi
if [[ $what == *" secured "* ]]; then
  reset
  rm -rf keys
  run 12 nearmesh-publisher make-security keys --domain 77 --publisher server --subscriber one two >/dev/null
  of_publisher=(--security keys/server)
  of_peer1=(--security keys/one)
  of_peer2=(--security keys/two)
  for version in 12 13; do
    fly secured $version $version $version
    if grep -h "is secured by" ./*.log; then fail "secured: of one release, and told to be of two"; fi
  done
  # Not both on one bus: each side says so.
  for version in 12 13; do
    other=$((25 - version))
    (on $version nearmesh-publisher serve terrain.spm aircraft.spm "${bus[@]}" --security keys/server >publisher.log 2>&1) &
    publisher=$!
    says publisher.log "ready on domain"
    (on $other nearmesh-subscriber run peer1.yaml "${bus[@]}" --security keys/one >peer1.log 2>&1) &
    peer=$!
    says publisher.log "never find each other"
    says peer1.log "never find each other"
    kill -INT $publisher $peer
    wait $publisher || fail secured
    wait $peer || true
    for log in publisher peer1; do
      echo "secured: publisher $version, peer $other: $log: $(grep -o "[^ ]* is secured by.*" $log.log | head -n 1)"
    done
  done
fi
if [[ $what == *" recordings "* ]]; then
  for version in 12 13; do
    other=$((25 - version))
    reset
    (on $version nearmesh-subscriber record -o flight-$version.db3 "${bus[@]}" >recorder.log 2>&1) &
    recorder=$!
    says recorder.log "recording domain"
    fly "recordings" $other $version $other
    kill -INT $recorder
    wait $recorder || fail recordings
    run $version nearmesh-subscriber verify flight-$version.db3 >own.txt || fail "recordings: verify by $version"
    run $other nearmesh-subscriber verify flight-$version.db3 >other.txt || fail "recordings: verify by $other"
    cmp own.txt other.txt || fail recordings
    echo "recordings: recorded by $version, verified by both: $(head -n 1 own.txt)"
  done
fi
if [[ $what == *" datagrams "* ]]; then
  for version in 12 13; do
    reset
    "$here/largest_datagram.py" >largest.txt &
    watcher=$!
    sleep 0.5
    fly datagrams $version $version $version
    kill -INT $watcher
    wait $watcher || true
    read -r largest count <largest.txt
    echo "datagrams: $version: the largest of $count has $largest bytes"
    [[ $largest -le 1400 ]] || fail datagrams
  done
fi
echo "across: all hold"
