// SPDX-License-Identifier: Apache-2.0
#pragma once
// Small baked models for tests, and random poses.

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/base/random.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/query/certify.hpp"

namespace nearmesh::test {

/// Cleaned (21 bits) and baked; fails the test when either refuses.
inline BakedModel bake_mesh(const IndexedMesh& mesh, std::uint32_t base_faces = 256) {
  Result<CleanResult> clean = clean_mesh(mesh, 21);
  if (!clean.is_ok()) ADD_FAILURE() << clean.status().message();
  Result<BakedModel> baked = bake(clean.value().mesh, clean.value().report.rounding_error_m,
                                  {.base_faces = base_faces});
  if (!baked.is_ok()) ADD_FAILURE() << baked.status().message();
  return std::move(baked).value();
}

/// A rotation uniform over all rotations.
inline std::array<double, 9> random_rotation(Random& random) {
  double q[4], length = 0;
  do {
    length = 0;
    for (double& x : q) {
      x = random.between(-1, 1);
      length += x * x;
    }
  } while (length > 1 || length < 0.01);
  length = std::sqrt(length);
  const double w = q[0] / length, x = q[1] / length, y = q[2] / length, z = q[3] / length;
  return {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
          2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
          2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
}

/// Position of a vertex in the model's frame, metres.
inline std::array<double, 3> position_m(const SpmHeader& header, const SplitStore& store, VertexId v) {
  std::array<double, 3> at = header.grid.origin_m;
  for (int k = 0; k < 3; ++k)
    at[static_cast<std::size_t>(k)] += std::ldexp(store.position(v)[k], header.grid.exponent);
  return at;
}

/// All splits of a complete store, parents first.
inline std::vector<VertexId> all_splits(const SplitStore& store) {
  return global_order(store, 0xffffffffU);
}

inline Status no_require(NodeSpan) { return Status::ok(); }

}  // namespace nearmesh::test
