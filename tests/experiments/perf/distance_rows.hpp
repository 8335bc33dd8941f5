// SPDX-License-Identifier: Apache-2.0
#pragma once
// How far apart bodies are: exact distances beside others', and the bounds that a session asks for.

#include <span>

#include "report.hpp"
#include "tests/peers/peers.hpp"
#include "workloads.hpp"

namespace nearmesh::perf {

/// A library that was given the two meshes; it may know of no distance.
struct Contender {
  peers::PeerInfo info;
  std::unique_ptr<peers::Peer> peer;
};

/// Adds rows of those poses in which the bodies are free, where there are any. Single thread, the
/// least of three calls each.
/// Out: how many distances lie outside nearmesh's exact bracket, by more than a lattice cell.
[[nodiscard]] int time_distances(const std::string& workload, const PoseSet& set, const Model& a,
                                 const Model& b, std::span<Contender> others, int repeats,
                                 Report& report);

}  // namespace nearmesh::perf
