// SPDX-License-Identifier: Apache-2.0
#pragma once
// The parts of the page that `report` writes: what is gathered from a recording, charts as SVG.
// All text from a recording is escaped here. Nothing on the page refers to anything outside of it.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::subscriber::report {

inline constexpr std::size_t kStatuses = 5;  ///< of AnswerStatus
inline constexpr std::size_t kBins = 120;    ///< at most; equal parts of the session's time

/// One peer over time.
struct PeerHistory {
  struct Bin {
    std::array<std::uint64_t, kStatuses> answers{};
    std::uint64_t bytes = 0;  ///< of batches, as recorded
  };
  std::vector<Bin> bins;  ///< History::bins of them
  struct Certified {
    double seconds = 0;       ///< from the first answer that was not certified to the next that was
    std::uint64_t bytes = 0;  ///< of batches recorded in between
  };
  std::vector<Certified> certified;
};

/// Bins are whole frames long, and a frame falls into the bin of its number: so equal bins have
/// equally many frames.
struct History {
  double duration_s = 0;
  std::size_t bins = 1;
  double bin_s = 0;
  std::map<std::string, PeerHistory> peers;  ///< by partition
  /// Of each body that touched something, the most touching face pairs of any answer about it, bin
  /// by bin.
  std::map<std::string, std::vector<std::uint32_t>> contacts;
};

/// Errors: those of the reader. Cost: two runs through the recording.
[[nodiscard]] Result<History> gather_history(RecordingReader& recording);

/// For text and attributes of HTML. Bytes that are no UTF-8 and control characters become '?'.
[[nodiscard]] std::string escape(std::string_view text);
/// With so many significant digits.
[[nodiscard]] std::string number(double x, int digits = 4);

/// A figure: chart, caption, and the same numbers as a table; "" where there is nothing to draw.
[[nodiscard]] std::string timeline_figure(const std::string& peer, const PeerHistory& one,
                                          const History& history);
[[nodiscard]] std::string contacts_figure(const History& history);
[[nodiscard]] std::string certified_figure(const History& history);
[[nodiscard]] std::string accuracy_figure(const History& history);

}  // namespace nearmesh::subscriber::report
