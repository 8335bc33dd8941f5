// SPDX-License-Identifier: Apache-2.0
#pragma once
// Proves what was free by bounds in a recorded session, and that what was not has reports of its
// own: makes each peer's boxes again from headers, what it said it watches and recorded poses and
// promises, and counts which of them do not meet (takes a recording, gives what agrees and what
// does not).

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// A report of which something is not so.
struct WrongBounds {
  std::int64_t message = 0;     ///< its id in the recording
  wire::BoundsReport recorded;  ///< says frame and peer
  std::string what;             ///< one line: what was recorded, what was found
};

struct BoundsProof {
  std::uint64_t reports = 0;     ///< all of them; the sum of the next four
  std::uint64_t proved = 0;      ///< what it says comes out of the poses that it is about
  std::uint64_t wrong = 0;       ///< it says more than that, or other pairs
  std::uint64_t unprovable = 0;  ///< something that it rests on is not in the recording
  std::uint64_t malformed = 0;   ///< it does not decode
  std::uint64_t missing = 0;     ///< sent after the first, and never came
  std::uint64_t before = 0;      ///< sent before the recorder heard the first of their peer
  std::uint64_t pairs = 0;       ///< answers: said to be free, in all frames together
  std::uint64_t proved_pairs = 0;
  /// Pairs that the same poses put near each other, in all frames of proved reports together, but
  /// the last of each peer, whose answers may come after the recording's end; and those of them of
  /// which the peer reported no answer.
  std::uint64_t near_pairs = 0, unreported = 0;
  std::string first_unreported;  ///< one line on the first of these; else empty
  /// Samples in which a body is where its mover had promised that it is not: what others said may
  /// be false.
  std::uint64_t broken = 0;
  std::string first_broken;             ///< one line on the first of these; else empty
  std::uint64_t digest = 0;             ///< of all that was found, for comparing builds
  std::vector<WrongBounds> wrong_ones;  ///< the first kMaxWrongBounds, in order of the recording
  std::map<std::string, std::uint64_t> why_not;  ///< what is not there, and for how many reports
};
inline constexpr std::size_t kMaxWrongBounds = 16;

/// Memory: some ten thousand messages, and a box for each watched body of each peer.
/// Errors: those of the reader; kUnsupported for another wire version; kIo where there is no memory
/// for a header's model.
[[nodiscard]] Result<BoundsProof> prove_bounds(RecordingReader& recording);

}  // namespace nearmesh::subscriber
