// SPDX-License-Identifier: Apache-2.0
#pragma once
// Proves a recorded session: runs every peer's refinement and queries again from the recorded
// batches, and compares the state and the answer of each report with the recorded digests (takes a
// recording, gives what agrees and what does not). No network, no clock: the same result on every
// machine, build and number of threads.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"
#include "prove_bounds.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {

/// A report that contradicts what comes out now.
struct Difference {
  std::int64_t message = 0;      ///< the report's id in the recording
  wire::ContactReport recorded;  ///< says frame, peer and bodies
  /// The states of refinement differ (and so nothing was asked); else the answers do.
  bool state = false;
  std::string what;  ///< one line: what was recorded, what was found
  /// Face pairs, of the first kMaxReportPairs: those recorded alone, and those found alone.
  std::vector<std::array<FaceKey, 2>> only_recorded, only_found;
};

struct VerifyReport {
  std::uint64_t reports = 0;  ///< all contact reports; the sum of the next seven
  /// State and answer agree, or a pose was stale and nothing certified.
  std::uint64_t verified = 0;
  std::uint64_t different = 0;
  /// The peer lacked a header or a pose, and claimed nothing, so there is nothing to compare.
  std::uint64_t not_asked = 0;
  /// The pair's turn did not come within the frame's budget: nothing was claimed.
  std::uint64_t put_off = 0;
  std::uint64_t lacking = 0;  ///< batches (or a header) that the peer had are not in the recording
  /// The peer had given up detail, and what it held from then on is not recorded.
  std::uint64_t gave_up = 0;
  std::uint64_t malformed = 0;  ///< reports that do not decode
  /// Of `verified`: the peer's own options ended the answer (any, max_pairs, max_tests). What it
  /// lists does touch; that it is all it did not claim. The number of pairs was counted again, and
  /// the uncertainty; of a search that its tests ended, which has no bound, that there are no
  /// fewer, where kCutTests are enough to count them.
  std::uint64_t cut = 0;
  std::uint64_t missing = 0;  ///< reports that were sent after the first and never came
  std::uint64_t before = 0;   ///< sent before the recorder heard the first of their peer
  std::uint64_t peers = 0, batches = 0;
  std::uint64_t digest = 0;  ///< of all that was found, for comparing builds
  BoundsProof bounds;        ///< of pairs that were free by bounds, counted apart
  /// The first kMaxDifferences of each peer, in order of the recording.
  std::vector<Difference> differences;
  /// Files that would help with reports that lack batches, by content.
  std::map<ContentHash, WantedModel> wanted;
  /// One line each: why a peer could not be taken up from what it said it held.
  std::vector<std::string> complaints;

  /// Of how many answers the recording tells.
  [[nodiscard]] std::uint64_t answers() const { return verified + different + lacking + gave_up; }
};
inline constexpr std::size_t kMaxDifferences = 16;

struct VerifyPlan {
  unsigned threads = 1;  ///< peers are spread over so many (>= 1)
  /// From these files a peer is taken up where it said what it held, if batches of before are not
  /// in the recording.
  DetailFolder* models = nullptr;
};

/// Memory: the peers' replicas, and a few thousand messages.
/// Errors: those of the reader; kUnsupported for another wire version.
[[nodiscard]] Result<VerifyReport> verify(RecordingReader& recording, const VerifyPlan& plan);

}  // namespace nearmesh::subscriber
