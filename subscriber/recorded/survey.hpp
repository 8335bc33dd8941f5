// SPDX-License-Identifier: Apache-2.0
#pragma once
// The counts of a recorded session (takes a recording, gives Survey): what info prints and the page
// of report begins with.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

struct TopicCount {
  std::uint64_t samples = 0, bytes = 0;
  std::uint64_t before = 0;   ///< sent before the recorder heard their writers
  std::uint64_t missing = 0;  ///< sent since, and never came
};

/// Of whom the recorder heard nothing of what was sent first.
struct LateWriter {
  std::size_t topic = 0;
  /// The publisher or peer, of batches "PUBLISHER to PEER"; "" where no sample says so.
  std::string who;
  std::uint64_t first_sequence = 0;  ///< that was heard
};

struct ModelFacts {
  std::string name;
  std::uint64_t faces = 0;
};

struct Survey {
  double duration_s = 0;
  std::set<wire::SessionId> peers, publishers;
  std::map<wire::SessionId, std::string> names;  ///< what they called themselves, if it was heard
  std::map<ContentHash, ModelFacts> models;      // by content hash
  std::vector<TopicCount> topics;
  std::vector<LateWriter> late;
  std::array<std::uint64_t, 5> by_status{};
  std::uint64_t contact_pairs = 0;
  std::vector<double> to_certified_s;  // ascending
};

/// Errors: kUnsupported for another wire version; those of the reader. Samples that do not decode
/// count as samples, and no further.
[[nodiscard]] Result<Survey> survey(RecordingReader& recording);

/// From the first report of a pair that is not certified to the next that is.
class CertifiedTimes {
 public:
  struct Began {
    std::int64_t source_ns = 0;
    std::uint64_t bytes = 0;  ///< what the peer had received by then
  };
  /// When what ends with this report began, if it is certified and one before was not.
  std::optional<Began> add(const wire::ContactReport& report, const Began& now) {
    const auto key = std::tuple(report.peer, report.body_a, report.body_b);
    const auto open = open_.find(key);
    if (!is_certified(static_cast<AnswerStatus>(report.status))) {
      if (open == open_.end()) open_.emplace(key, now);
      return std::nullopt;
    }
    if (open == open_.end()) return std::nullopt;
    const Began began = open->second;
    open_.erase(open);
    return began;
  }

 private:
  std::map<std::tuple<wire::SessionId, std::string, std::string>, Began> open_;
};

}  // namespace nearmesh::subscriber
