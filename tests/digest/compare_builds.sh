#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Builds nearmesh-digest with other compilers and optimisation, and compares what it prints with the dev build's.
#   tests/digest/compare_builds.sh [gcc-O0] [clang-O0] [clang-O3] [sanitized]     none named: all
# "sanitized" is the build of the preset fuzz: clang, -O2, with sanitizers.
# Exit 1 with the first line that differs.
source "$(dirname "$0")/../../cmake/setup.sh"

declare -A compilers=([gcc-O0]=g++ [clang-O0]=clang++ [clang-O3]=clang++)
declare -A flags=([gcc-O0]=-O0 [clang-O0]=-O0 [clang-O3]="-O3 -DNDEBUG")
names=("$@")
if [[ ${#names[@]} -eq 0 ]]; then names=(gcc-O0 clang-O0 clang-O3 sanitized); fi

build_preset dev nearmesh-digest >/dev/null
build/dev/bin/nearmesh-digest >build/digest-dev.txt
for name in "${names[@]}"; do
  if [[ $name == sanitized ]]; then
    folder=build/fuzz
    cmake --preset fuzz --log-level=WARNING >/dev/null
  else
    folder=build/digest-$name
    # A build type of no known name: the flags are those given here alone.
    cmake -S . -B "$folder" -G Ninja --log-level=WARNING -DCMAKE_BUILD_TYPE=Digest \
      -DCMAKE_CXX_COMPILER="${compilers[$name]}" -DCMAKE_CXX_FLAGS="${flags[$name]}" >/dev/null
  fi
  TIMEFORMAT="$name: built in %R s (%U s of CPU)"
  time cmake --build "$folder" --target nearmesh-digest >/dev/null
  TIMEFORMAT="$name: ran in %R s (%U s of CPU)"
  time "$folder/bin/nearmesh-digest" >"build/digest-$name.txt"
  if ! diff build/digest-dev.txt "build/digest-$name.txt" >"$folder/difference"; then
    echo "$name and dev first differ here ('<' is dev):"
    grep -m 2 '^[<>]' "$folder/difference"
    exit 1
  fi
done
