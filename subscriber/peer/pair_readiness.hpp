// SPDX-License-Identifier: Apache-2.0
#pragma once
// Readiness of one watched pair, and of a body from its pairs.

#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber {

/// Of a pair that the next update will ask about; `names` of the two bodies, for the reason.
[[nodiscard]] inline Readiness not_asked(const std::string& names) {
  return {.pairs = 1, .reason = names + ": not asked since the last update"};
}

/// Of a pair whose turn did not come.
[[nodiscard]] inline Readiness put_off(const std::string& names) {
  return {ReadyStage::kAnswering, 1, 0, names + ": out of budget"};
}

[[nodiscard]] inline Readiness readiness_of(const PairAnswer& pair, const std::string& names) {
  const Answer& answer = pair.answer;
  if (is_certified(answer.status)) return {ReadyStage::kCertified, 1, 1, {}};
  if (!pair.reason.empty())
    return {pair.asked ? ReadyStage::kAnswering : ReadyStage::kWaiting, 1, 0,
            names + ": " + pair.reason};
  return {ReadyStage::kAnswering, 1, 0,
          names + ": " + to_string(answer.status) + ", " + pair.awaited + "; known to within " +
              std::to_string(answer.uncertainty_m) + " m"};
}

/// A body is as far as the least far of its pairs; start with {.stage = kCertified}.
inline void add_pair(Readiness& body, const Readiness& pair) {
  body.pairs += pair.pairs;
  body.certified += pair.certified;
  if (pair.stage >= body.stage) return;
  body.stage = pair.stage;
  body.reason = pair.reason;
}

}  // namespace nearmesh::subscriber
