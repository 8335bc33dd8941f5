# SPDX-License-Identifier: Apache-2.0
# Sourced by ./test, ./demo and .ci/run: what they share. Stops the caller at the first failure.
#   nearmesh_packages   what to install on this Debian, 12 or 13
#   nearmesh_test_packages   and for all tests
#   install_missing PACKAGE...   installs those Debian packages that are not there; silent when all are
#   build_preset PRESET [TARGET...]   configures and builds (all, or these targets) into build/PRESET; a new build/dev is a
#       joined one, and stays so until `cmake --preset dev -DCMAKE_UNITY_BUILD=OFF`
# Call from anywhere: the working folder becomes the project's.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

fastdds=libfastrtps-dev  # Debian 12: Fast DDS 2.9
if (. /etc/os-release 2>/dev/null && [[ ${ID:-} == debian && ${VERSION_ID:-99} -ge 13 ]]); then
  fastdds=libfastdds-dev  # Debian 13: Fast DDS 3.1
fi
nearmesh_packages=(
  build-essential cmake ninja-build python3
  libeigen3-dev libassimp-dev zlib1g-dev libcli11-dev nlohmann-json3-dev libxxhash-dev libgtest-dev libgmp-dev libhwy-dev
  libsqlite3-dev libssl-dev libjs-three
  "$fastdds" libfastcdr-dev fastddsgen libspdlog-dev libyaml-cpp-dev
  prometheus-cpp-dev libtinyxml2-dev iproute2 nftables libfaketime)
nearmesh_test_packages=(
  cyclonedds-dev cyclonedds-tools  # another vendor's DDS
  python3-dev pybind11-dev python3-numpy python3-pytest)  # the Python package

install_missing() {
  command -v dpkg-query >/dev/null || return 0  # not Debian: CMake will name what it cannot find
  local missing=() package
  for package in "$@"; do
    if [[ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" != installed ]]; then
      missing+=("$package")
    fi
  done
  if [[ ${#missing[@]} -eq 0 ]]; then return 0; fi
  local as_root=()
  if [[ $EUID -ne 0 ]]; then
    if ! command -v sudo >/dev/null; then
      echo "Missing packages, and neither root nor sudo to install them: ${missing[*]}" >&2
      return 1
    fi
    as_root=(sudo)
  fi
  echo "Installing ${missing[*]}"
  local log
  log=$(mktemp)
  if ! { "${as_root[@]}" apt-get -q -o Acquire::Retries=3 update &&
         "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
           apt-get -qy -o Acquire::Retries=3 install --no-install-recommends "${missing[@]}"; } >"$log" 2>&1 </dev/null; then
    tail -n 30 "$log" >&2
    return 1
  fi
  rm -f "$log"
}

build_preset() {
  local preset=$1
  if [[ $preset == dev && ! -e build/dev/CMakeCache.txt ]]; then preset=joined; fi
  cmake --preset "$preset" --log-level=WARNING
  cmake --build --preset "$1" ${2:+--target "${@:2}"}
}
