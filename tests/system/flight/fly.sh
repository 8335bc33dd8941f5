#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Every verb of the three programs once, on loopback: models are made and served, two peers fly 40 frames against each other
# while a recorder listens, the recording is verified, shown and played back. Any exit code but 0 fails. It says nothing of
# speed, so that programs with sanitizers can run it.
#   tests/system/flight/fly.sh FOLDER_OF_PROGRAMS [DOMAIN]
set -euo pipefail
bin=$(cd "$1" && pwd)
domain=${2:-57}
out=$(mktemp -d)
PATH=$bin:$PATH
# Debian's Fast DDS frees with another size than it allocates. Nothing else is let pass.
export ASAN_OPTIONS="new_delete_type_mismatch=0:${ASAN_OPTIONS:-}" UBSAN_OPTIONS=print_stacktrace=1
bus=(--domain "$domain" --prefix "flight-$$" --interface 127.0.0.1)
cd "$out"

step=start
finish() {
  local code=$?
  local running
  running=$(jobs -p)
  if [[ -n "$running" ]]; then kill $running 2>/dev/null || true; fi
  if [[ $code -eq 0 ]]; then
    rm -rf "$out"
  else
    echo "$step failed with exit code $code; what it said, in $out:" >&2
    tail -n 60 "$out/$step.log" >&2 || true
  fi
}
trap finish EXIT

# run NAME WORDS...: to its end. start NAME WORDS...: beside what follows; end NAME SIGNAL: it is told to, and must succeed.
declare -A ids
run() { step=$1; "${@:2}" >"$1.out" 2>"$1.log"; }
start() { "${@:2}" >"$1.out" 2>"$1.log" & ids[$1]=$!; }
end() {
  step=$1
  if [[ -n "${2:-}" ]]; then kill "-$2" "${ids[$1]}"; fi
  wait "${ids[$1]}"
}
says() {  # NAME TEXT: waits until it has said so
  step=$1
  for _ in $(seq 600); do
    if grep -q "$2" "$1.log" "$1.out"; then return 0; fi
    if ! kill -0 "${ids[$1]}" 2>/dev/null; then wait "${ids[$1]}"; return 1; fi
    sleep 0.1
  done
  echo "$1 did not say '$2' within 60 s" >&2
  return 1
}

run generate_terrain nearmesh-model generate terrain --size 48 -o terrain.ply
run generate_aircraft nearmesh-model generate aircraft --size 600 -o aircraft.ply
run build_terrain nearmesh-model build terrain.ply -o terrain.spm
run build_aircraft nearmesh-model build aircraft.ply -o aircraft.spm
run info nearmesh-model info terrain.spm
run export_model nearmesh-model export aircraft.spm -o coarse.ply --splits 20
run flights nearmesh-demo-flights . --size 48 --frames 40 --rate 20
for i in 1 2; do
  other=$((3 - i))
  cat >"peer$i.yaml" <<EOF
bodies:
  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}
  - {name: craft$i, model: aircraft}
  - {name: craft$other, model: aircraft}
moves:
  - {body: craft$i, trajectory: flight$i.csv}
pairs: [[ground, craft$i], [craft1, craft2]]
frame_rate_hz: 20
budget_ms: 20
lookahead_s: 0.2
audit_s: 0.1
start_timeout_s: 60
EOF
done

start publisher nearmesh-publisher serve terrain.spm aircraft.spm "${bus[@]}"
says publisher "ready on domain"
start recorder nearmesh-subscriber record -o flight.db3 "${bus[@]}"
says recorder "recording domain"
start peer1 nearmesh-subscriber run peer1.yaml --answers answers1.jsonl "${bus[@]}"
start peer2 nearmesh-subscriber run peer2.yaml --answers answers2.jsonl "${bus[@]}"
run status nearmesh-subscriber status --seconds 2 --regions "${bus[@]}"
end peer1
end peer2
run doctor nearmesh-subscriber doctor --seconds 2 "${bus[@]}"
end recorder INT
end publisher INT
run check nearmesh-model check terrain.spm aircraft.spm --answers answers1.jsonl answers2.jsonl

run session_info nearmesh-subscriber info flight.db3
run verify nearmesh-subscriber verify --models . --allow-unproved flight.db3
run session_json nearmesh-subscriber info --json flight.db3
peer=$(python3 -c 'import json, sys; print(json.load(sys.stdin)["peers"][0])' <session_json.out)
run export_ply nearmesh-subscriber export flight.db3 --time 1000 --peer "$peer" -o scene.ply
run export_glb nearmesh-subscriber export flight.db3 --time 1000 --peer "$peer" -o scene.glb
run report nearmesh-subscriber report flight.db3 -o page
run replay nearmesh-publisher replay flight.db3 --rate 4 --json "${bus[@]}" </dev/null
run make_security nearmesh-publisher make-security secrets --publisher server --subscriber one
run check_security nearmesh-publisher check-security secrets

answers=$(cat check.out)
reports=$(head -n 1 verify.out)
if [[ "$answers" != *"wrong 0"* || "$reports" != *" 0 different"* || "$reports" == "0 of"* ]]; then
  echo "$answers; $reports" >&2
  exit 1
fi
echo "flight: $answers; $reports"
