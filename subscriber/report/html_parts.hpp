// SPDX-License-Identifier: Apache-2.0
#pragma once
// The parts of the page that `report` writes: what is gathered from a recording, charts as SVG, pictures of scenes as SVG.
// All text from a recording is escaped here. Nothing on the page refers to anything outside of it.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "subscriber/recorded/recorded_scene.hpp"

namespace nearmesh::subscriber::report {

inline constexpr std::size_t kStatuses = 5;  ///< of AnswerStatus
inline constexpr std::size_t kBins = 120;    ///< equal parts of the session's time

/// One peer over time.
struct PeerHistory {
  struct Bin {
    std::array<std::uint64_t, kStatuses> answers{};
    std::uint64_t bytes = 0;  ///< of batches, as recorded
  };
  std::vector<Bin> bins = std::vector<Bin>(kBins);
  struct Certified {
    double seconds = 0;       ///< from the first answer that was not certified to the next that was
    std::uint64_t bytes = 0;  ///< of batches recorded in between
  };
  std::vector<Certified> certified;
};

/// A moment that is shown as a picture.
struct Moment {
  std::string why;
  std::int64_t report = 0;  ///< id of the message
};

struct History {
  double duration_s = 0;
  std::map<std::string, PeerHistory> peers;  ///< by partition
  /// Of each body, the most touching face pairs of any answer about it, bin by bin.
  std::map<std::string, std::vector<std::uint32_t>> contacts;
  std::vector<Moment>
      moments;  ///< first contact, most contacts, largest replicas; each report once
};

/// Errors: those of the reader. Cost: one run through the recording.
[[nodiscard]] Result<History> gather_history(RecordingReader& recording);

/// For text and attributes of HTML. Bytes that are no UTF-8 and control characters become '?'.
[[nodiscard]] std::string escape(std::string_view text);
/// With so many significant digits.
[[nodiscard]] std::string number(double x, int digits = 4);

/// A figure: chart, caption, and the same numbers as a table.
[[nodiscard]] std::string timeline_figure(const std::string& peer, const PeerHistory& history,
                                          double duration_s);
[[nodiscard]] std::string contacts_figure(const History& history);
[[nodiscard]] std::string certified_figure(const History& history);
[[nodiscard]] std::string accuracy_figure(const History& history);

/// A figure of both meshes about the smaller body, from above at an angle, coloured as export does.
[[nodiscard]] std::string picture_figure(const RecordedScene& scene, const std::string& why,
                                         double time_s);

}  // namespace nearmesh::subscriber::report
