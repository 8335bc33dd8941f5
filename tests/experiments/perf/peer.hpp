// SPDX-License-Identifier: Apache-2.0
#pragma once
// How a peer's Session asks a publisher, and what it is sent, without a transport: for measurements.

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "core/ask/predict.hpp"
#include "core/demand/collect.hpp"
#include "core/spm/packed_region.hpp"

namespace nearmesh::perf {

using Batches = std::vector<std::vector<std::uint8_t>>;

/// Where `other` stands, and a margin around, in the grid of `own`; both are kept by reference.
inline RegionMaker region_around(const TreeView& own, const Pose& own_pose, const TreeView& other,
                                 const Pose& other_pose, double margin_m) {
  return [&own, &other, own_pose, other_pose, margin_m](std::size_t max_parts,
                                                        std::span<const GridBox> near) {
    return swept_region(own, Motion{.pose = own_pose}, other, Motion{.pose = other_pose}, 0,
                        margin_m, max_parts, near);
  };
}

/// What a peer asks for `own`, whose store is given, where `other` stands or moves: `missing`, and what lies within a margin.
/// Nothing where nothing is missing.
inline std::optional<RegionRequest> next_request(const SplitStore& store, const TreeView& own,
                                                 const Pose& own_pose, const TreeView& other,
                                                 const Pose& other_pose, double margin_m,
                                                 std::vector<NodeSpan> missing,
                                                 std::uint32_t max_splits, Portion portion) {
  auto request = make_request(store, region_around(own, own_pose, other, other_pose, margin_m),
                              std::move(missing), kRegionParts, max_splits, portion);
  // As it is when it arrives.
  if (request) request->region = unpack_region(pack_region(request->region)).value();
  return request;
}

/// Bytes of a request's lists.
inline std::uint64_t request_bytes(const RegionRequest& request) {
  return 8 * request.attach.size() + kBytesPerPart * request.region.size();
}

/// The publisher's answer. `require` makes a node's split known to the store. Ends the program where the request is refused.
inline Demand demand_of(const SplitStore& store, const RegionRequest& request,
                        const std::function<Status(NodeSpan)>& require) {
  if (const Status status = check_request(store, request); !status.is_ok()) {
    std::fprintf(stderr, "%s\n", status.message().c_str());
    std::exit(1);
  }
  return collect(store, request, require, AttachRule::kAlways).value();
}

}  // namespace nearmesh::perf
