// SPDX-License-Identifier: Apache-2.0
#pragma once
// Pairs of triangles that are hard for an overlap test: by family, each at the border between
// touching and apart. The same random numbers give the same pair on every machine.

#include <cstdint>
#include <span>

#include "core/base/random.hpp"
#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh::soak {

struct TrianglePair {
  LatticeTriangle a, b;
};

/// The greatest joint extent of any pair: one unit below what triangles_overlap promises, so that
/// each may be moved by a unit.
inline constexpr std::int64_t kMaxExtent = (std::int64_t{1} << 40) - 2;

struct Family {
  const char* name;
  TrianglePair (*make)(Random& random);  ///< corners in a certain order, extent not yet checked
};

[[nodiscard]] std::span<const Family> overlap_families();

/// A pair of the family in random order, its joint extent at most kMaxExtent.
[[nodiscard]] TrianglePair make_pair(const Family& family, Random& random);

/// The greatest difference of two coordinates of the pair along one axis.
[[nodiscard]] std::int64_t joint_extent(const TrianglePair& pair);

}  // namespace nearmesh::soak
