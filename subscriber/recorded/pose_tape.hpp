// SPDX-License-Identifier: Apache-2.0
#pragma once
// What movers said of their bodies, for a while: poses, promises and who the bodies are, each as it was known to one who had heard so far
// (takes samples in the order of the recording, gives what a bounds report rests on).

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// A report is judged when so many messages more have been read: what it rests on comes by other ways, some milliseconds before or after.
inline constexpr std::int64_t kMessagesARound = 8192;
/// Poses that others have followed are kept for so many rounds.
inline constexpr int kRoundsKept = 3;

/// The leading bytes of an endpoint's identifier.
using Participant = std::array<std::uint8_t, 12>;
[[nodiscard]] Participant participant_of(const RecordedWriter& writer);

/// Samples of poses of one topic, by part and sequence.
class PoseSamples {
 public:
  /// The bodies of a part may come in several samples, so many at most: as many count as the last one.
  explicit PoseSamples(std::size_t samples_a_part) : samples_a_part_(samples_a_part) {}

  void take(wire::BodyPoses&& poses, int round);
  void forget(int round);

  struct Found {
    const wire::BodyPoses::Body* body = nullptr;
    std::uint32_t sequence = 0;
  };
  /// Where the last samples of its part have the body, of those up to `last`.
  [[nodiscard]] Found find(std::uint32_t number, std::uint32_t last) const;
  /// The same of the links of a robot, by number: where the last instant has them of which all had come. Empty where there is none.
  using Links = std::map<std::uint32_t, Found>;
  [[nodiscard]] Links find_links(std::uint32_t first, std::uint32_t links,
                                 std::uint32_t last) const;
  /// use(pose) of each that is kept of the body.
  template <class Use>
  void for_each(std::uint32_t number, const Use& use) const {
    const auto part = parts_.find(number / wire::kBodiesPerPart);
    if (part == parts_.end()) return;
    for (const auto& [sequence, sample] : part->second)
      for (const wire::BodyPoses::Body& body : sample.bodies)
        if (body.number == number) use(body);
  }
  /// All samples after `first` up to `last` are here.
  [[nodiscard]] bool is_whole(std::uint32_t first, std::uint32_t last) const;

 private:
  struct Sample {
    std::vector<wire::BodyPoses::Body> bodies;
    int round = 0;
  };
  const std::size_t samples_a_part_;
  std::map<std::uint32_t, std::map<std::uint32_t, Sample>> parts_;  // by sequence
  std::uint32_t last_ = 0, unknown_until_ = 0;
  std::deque<std::pair<std::uint32_t, std::uint32_t>> holes_;  // sequences that did not come
};

/// Where the links of robots were, as one report rests on them: looked for once for each robot, however many links it has. What it gives holds until
/// samples come or are forgotten.
class FoundLinks {
 public:
  [[nodiscard]] PoseSamples::Found find(const PoseSamples& samples,
                                        const wire::BodyDirectory::Body& link, std::uint32_t last);

 private:
  // By whose and which samples, first link, links, and the last sample that counts.
  std::map<std::tuple<const PoseSamples*, std::uint32_t, std::uint32_t, std::uint32_t>,
           PoseSamples::Links>
      robots_;
};

/// What one participant said of the bodies that one session moves: who they are, their poses and promises for a while.
class PoseTape {
 public:
  explicit PoseTape(const Participant& participant) : participant_(participant) {}

  [[nodiscard]] const Participant& participant() const { return participant_; }

  void take(wire::BodyDirectory&& directory);
  void take(wire::BodyPoses&& message, int round) { poses.take(std::move(message), round); }
  /// Out: a line about a body that is not where it was promised to be; else empty.
  std::string take(wire::NearPoses&& message, int round);
  /// The same.
  std::string take(wire::BodyPromises&& message, int round);
  void forget(int round);

  /// Null where no directory told.
  [[nodiscard]] const wire::BodyDirectory::Body* who_is(std::uint32_t number) const;
  /// What was promised of a body at that time, as one knows it who heard all up to `last`: `is_known` is false where nothing was.
  struct FoundPromise {
    bool is_known = false;
    std::optional<wire::BodyPromise> holds;
  };
  [[nodiscard]] FoundPromise find_promise(std::uint32_t number, std::uint32_t last,
                                          double time_s) const;

  PoseSamples poses{1}, near{wire::kBodiesPerPart};

 private:
  struct Promised {
    wire::BodyPromises message;
    int round = 0;
  };
  [[nodiscard]] std::optional<wire::BodyPromise> promise_in(const wire::BodyPromises& message,
                                                            std::uint32_t number) const;

  Participant participant_;
  std::map<std::uint32_t, wire::BodyDirectory::Body> who_;
  std::map<std::uint32_t, std::map<std::uint32_t, Promised>> promises_;  // by part and sequence
};

}  // namespace nearmesh::subscriber
