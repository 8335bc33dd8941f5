// SPDX-License-Identifier: Apache-2.0
#pragma once
// Swept answers, and what the query says at one instant of the same motions.

#include <gtest/gtest.h>

#include "nearmesh/core/query/sweep.hpp"

namespace nearmesh::test {

inline constexpr double kNever = std::numeric_limits<double>::infinity();

inline SweptAnswer swept(const TreeView& a, const Motion& motion_a, const TreeView& b,
                         const Motion& motion_b, const SweepOptions& options) {
  const Result<SweptAnswer> answer = sweep(a, motion_a, "a", b, motion_b, "b", options);
  if (!answer.is_ok()) ADD_FAILURE() << answer.status().message();
  return answer.value();
}

/// query() at an instant of the motions.
inline AnswerStatus status_at(const TreeView& a, const Motion& motion_a, const TreeView& b,
                              const Motion& motion_b, double t) {
  const PosedPair posed =
      pose_pair(*a.grid, pose_at(motion_a, t), "a", *b.grid, pose_at(motion_b, t), "b").value();
  return query(a, posed.a, b, posed.b, {.any = true, .clearance = Clearance::kNone}).status;
}

}  // namespace nearmesh::test
