// SPDX-License-Identifier: Apache-2.0
#pragma once
// The broad phase of another library: boxes that move among themselves and over boxes that stand.

#include <cstddef>
#include <memory>
#include <vector>

#include "core/broadphase/body_bounds.hpp"

namespace nearmesh::peers {

class BoxCrowd {
 public:
  virtual ~BoxCrowd() = default;
  /// One frame: the boxes are elsewhere, each of the size that it had. How many pairs meet.
  virtual std::size_t count_near(const std::vector<WorldBox>& movers) = 0;
};

/// FCL's dynamic AABB trees, one for the movers and one for the scenery.
std::unique_ptr<BoxCrowd> make_fcl_crowd(const std::vector<WorldBox>& scenery,
                                         const std::vector<WorldBox>& movers);

}  // namespace nearmesh::peers
