// SPDX-License-Identifier: Apache-2.0
// What a report claims, by what it says of itself.
#include <limits>
#include <utility>

#include "recorded_peer.hpp"

namespace nearmesh::subscriber {

std::string why_stale(const wire::ContactReport& report) {
  for (const auto& [asked, body] :
       {std::pair(&report.a, &report.body_a), std::pair(&report.b, &report.body_b)}) {
    // Else no session asks.
    if (asked->stamp.mover == wire::Mover::kNone && !report.asked) continue;
    std::string why = wire::why_stale(asked->stamp, report.time_s, *body);
    if (!why.empty()) return why;
  }
  return {};
}

bool claims_nothing(const wire::ContactReport& report) {
  // The wire carries finite numbers: the largest stands for "cannot be bounded".
  return report.answer_digest == digest(nothing_known()) &&
         report.status == static_cast<std::uint8_t>(AnswerStatus::kUncertain) &&
         report.pair_count == 0 && report.pairs.empty() && report.clearance_m == 0 &&
         report.uncertainty_m == std::numeric_limits<double>::max();
}

}  // namespace nearmesh::subscriber
