// SPDX-License-Identifier: Apache-2.0
#pragma once
// Lines of JSON about answers, of `run --answers` and `run --json` (docs/scene.md).

#include <cstdint>
#include <nlohmann/json.hpp>

#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber::program {

/// Of one pair.
[[nodiscard]] nlohmann::ordered_json answer_to_json(std::uint64_t frame, double time_s,
                                                    const PairAnswer& pair,
                                                    const FrameReport& report,
                                                    const Session& session, bool is_any);
/// Of the pairs that are not listed: free by bounds, or unknown.
[[nodiscard]] nlohmann::ordered_json others_to_json(std::uint64_t frame, double time_s,
                                                    const FrameReport& report,
                                                    const Session& session);

}  // namespace nearmesh::subscriber::program
