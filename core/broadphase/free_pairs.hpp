// SPDX-License-Identifier: Apache-2.0
#pragma once
// What is said at once of all pairs that bounds prove apart (core/THEOREM.md, "Free by bounds"): by
// the session that says it, and by whoever proves it again.

#include <cstdint>
#include <limits>
#include <string_view>

#include "broad_phase.hpp"
#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh {

/// Of all that a body's box follows from: the same on every machine. Two bodies in the same place
/// have two, for they have two names.
[[nodiscard]] std::uint64_t place_digest(std::string_view name, const ContentHash& content,
                                         const Company& company, const Motion& motion);

/// What bounds the pairs of bodies that have boxes, and whose boxes do not meet.
class FreePairs {
 public:
  /// Of each body that has a box: how far it may go in the look-ahead, metres, and how old its pose
  /// is, seconds, negative for one of the frame's future.
  void add(double way_m, double age_s);
  /// Metres that each pair is apart at least.
  [[nodiscard]] double clearance_m(double margin_m) const;
  /// Seconds after the frame's time until which none can touch.
  [[nodiscard]] double horizon_s(double lookahead_s) const;

 private:
  double least_way_m_ = std::numeric_limits<double>::infinity(), next_way_m_ = least_way_m_;
  double oldest_s_ = 0, newest_s_ = 0;  // so long before and after the frame's time
};

/// As reports carry it: no more than the number, and no more than the largest.
[[nodiscard]] float float_at_most(double number);

}  // namespace nearmesh
