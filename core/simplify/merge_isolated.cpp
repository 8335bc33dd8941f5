// SPDX-License-Identifier: Apache-2.0
// Vertices without faces: merged by nearness, whatever the topology.
#include "simplifier.hpp"

namespace nearmesh::simplification {

/// Merges vertices without faces: near ones pairwise, each group then into the nearest vertex that
/// has faces. Bottom up along the octree that Morton order is, so that no vertex takes in many one
/// after the other.
std::uint64_t Simplifier::merge_isolated() {
  std::vector<std::uint64_t> codes;
  for (std::uint32_t i = 0; i < vertices_.size(); ++i) {
    if (vertices_[i].first == kNone) continue;
    live_.push_back(i);
    codes.push_back(morton_code(vertices_[i].p, code_shift_));
    if (vertices_[i].count > 0) base_.push_back(i);
  }
  if (live_.size() == base_.size()) return 0;
  const std::size_t before = collapses_.size();
  merge_range(codes, 0, live_.size());
  return collapses_.size() - before;
}

Simplifier::Range Simplifier::merge_range(const std::vector<std::uint64_t>& codes,
                                          std::size_t begin, std::size_t end) {
  if (end - begin == 1) {
    const std::uint32_t v = live_[begin];
    const auto base = std::lower_bound(base_.begin(), base_.end(), v);
    const auto at = static_cast<std::size_t>(base - base_.begin());
    const bool has_faces = vertices_[v].count > 0;
    return {has_faces ? kNone : v, at, at + (has_faces ? 1 : 0)};
  }
  std::size_t middle = begin + (end - begin) / 2;
  if (const std::uint64_t differing = codes[begin] ^ codes[end - 1]; differing != 0) {
    const std::uint64_t split = codes[end - 1] >> (std::bit_width(differing) - 1)
                                                      << (std::bit_width(differing) - 1);
    middle = static_cast<std::size_t>(
        std::lower_bound(codes.begin() + static_cast<std::ptrdiff_t>(begin),
                         codes.begin() + static_cast<std::ptrdiff_t>(end), split) -
        codes.begin());
  }
  const Range left = merge_range(codes, begin, middle), right = merge_range(codes, middle, end);
  Range both{kNone, left.base_begin, right.base_end};
  const auto merge = [&](std::uint32_t removed, std::uint32_t kept) {
    remove_vertex(removed, kept);
    return kept;
  };
  if (left.isolated != kNone && right.isolated != kNone) {
    const bool keep_left = vertices_[left.isolated].depth >= vertices_[right.isolated].depth;
    both.isolated =
        keep_left ? merge(right.isolated, left.isolated) : merge(left.isolated, right.isolated);
  } else {
    both.isolated = left.isolated != kNone ? left.isolated : right.isolated;
  }
  if (both.isolated != kNone && both.base_begin < both.base_end) {
    // Only one side has vertices with faces; those next to the other side in Morton order are
    // enough.
    constexpr std::size_t kLooked = 64;
    std::size_t from = both.base_begin, to = both.base_end;
    if (left.base_begin == left.base_end)
      to = std::min(to, from + kLooked);
    else if (to - from > kLooked)
      from = to - kLooked;
    merge(both.isolated, nearest_base(both.isolated, from, to));
    both.isolated = kNone;
  }
  return both;
}

std::uint32_t Simplifier::nearest_base(std::uint32_t v, std::size_t begin, std::size_t end) const {
  std::uint32_t nearest = kNone;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = begin; i < end; ++i) {
    const Vec3 d = between(vertices_[v], vertices_[base_[i]]);
    if (const double distance2 = dot(d, d); distance2 < least) {
      least = distance2;
      nearest = base_[i];
    }
  }
  return nearest;
}

}  // namespace nearmesh::simplification
