// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <limits>

#include "core/base/float_guard.hpp"
#include "nearmesh/idl/messages/messages.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kMostSeconds = 3600, kLeastTimeout_s = 1e-4, kLeastSweep_s = 1e-9;
constexpr double kMostMargin_m = 1e9, kLeastPromise_s = 0.1;
constexpr double kLeastWindow = 2000;  // a batch and its frame

}  // namespace

// Certified answers rest on these numbers: boxes that a negative margin shrinks, or that are of no
// number at all, would prove bodies free that touch.
Status check(const SessionOptions& options) {
  const FloatGuard guard;
  struct Range {
    const char* name;
    double number, least, most;
  };
  const Range ranges[] = {
      {"max_pose_age_s", options.max_pose_age_s, 0, kInfinite},
      {"lookahead_s", options.lookahead_s, 0, kMostSeconds},
      {"margin_m", options.margin_m, 0, kMostMargin_m},
      {"sweep_s", options.sweep_s, options.sweep_s == 0 ? 0 : kLeastSweep_s, kMostSeconds},
      {"request_timeout_s", options.request_timeout_s, kLeastTimeout_s, kMostSeconds},
      {"audit_s", options.audit_s, 0, kInfinite},
      {"promise_s", options.promise_s, kLeastPromise_s, wire::kMaxPromise_s},
      {"window_bytes", double{0} + options.window_bytes, kLeastWindow,
       double{0} + std::numeric_limits<std::uint32_t>::max()},
  };
  for (const auto& [name, number, least, most] : ranges) {
    if (number >= least && number <= most) continue;
    char text[160];
    std::snprintf(text, sizeof text, "%s is %.9g, expected a number from %.9g to %.9g", name,
                  number, least, most);
    return {StatusCode::kInvalidArgument, text};
  }
  return Status::ok();
}

}  // namespace nearmesh::subscriber
