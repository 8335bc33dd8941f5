// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// For hosts that want certainty about a body before they start: the one call here that blocks.

#include <vector>

#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber {

struct Waited {
  Readiness readiness;  ///< of the body; not certified when the time was over first
  FrameReport report;   ///< of the last update, with the complaints of all
};

/// Calls update() each 2 ms until every watched pair of the body is certified, or `timeout_s` is
/// over (0: one update). Other bodies are served too, but not waited for. `motions`, `frame`,
/// `time_s`: as for update(); motions are published once. While it waits the time goes on with that
/// of others' poses; it stands where these stand.
/// Errors: those of update(); kNotFound where no such body is declared; kInvalidArgument for a
/// timeout_s below 0 or of no number.
/// Threads: one at a time with all else of the session. Blocks at most timeout_s and one update.
[[nodiscard]] Result<Waited> wait_ready(Session& session, BodyId body, double timeout_s,
                                        std::vector<Session::OwnMotion> motions = {},
                                        std::uint64_t frame = 0, double time_s = 0);

}  // namespace nearmesh::subscriber
