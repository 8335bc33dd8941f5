// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// How far a body, or a part of one, is from certified answers, and why it is not there yet. Takes
// what the last update found; nothing here waits for all bodies at once.

#include <cstddef>
#include <cstdint>
#include <string>

namespace nearmesh::subscriber {

enum class ReadyStage : std::uint8_t {
  kWaiting = 0,  ///< for some pair of the body nothing can be asked yet
  kAnswering =
      1,  ///< base meshes and poses are there: every pair is asked, some answer is not certified
  kCertified = 2,  ///< every watched pair of the body was certified by the last update
};
/// "waiting", "answering", "certified".
[[nodiscard]] const char* to_string(ReadyStage stage);

/// Of one body. Never certified by default: not before an update has answered all its pairs, and
/// not where none is watched.
struct Readiness {
  ReadyStage stage = ReadyStage::kWaiting;
  std::size_t pairs = 0,
              certified = 0;  ///< watched pairs that the body is in, and how many are certified
  std::string reason;         ///< of the first pair that is least far; empty when certified
};

/// Of a box in a body's model. `resolved`: all that the full mesh has there is here, so no answer
/// about what happens there waits for this body. Else the rest says what is missing. Nothing is
/// asked for: detail comes where a watched body is, or will be within the look-ahead.
struct RegionReadiness {
  bool resolved = false;
  std::size_t unresolved_nodes = 0;    ///< whose box meets the region
  std::uint64_t missing_vertices = 0;  ///< below them: an upper bound of what the region lacks
  double uncertainty_m = 0;  ///< as Answer::uncertainty_m, of these nodes; infinite: no header
  std::string reason;        ///< empty when resolved
};

}  // namespace nearmesh::subscriber
