// SPDX-License-Identifier: Apache-2.0
#pragma once
// What movers said of their bodies, for a while: poses, promises and who the bodies are, each as it
// was known to one who had heard so far (takes samples in the order of the recording, gives what a
// bounds report rests on).

#include <algorithm>
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

/// A report is judged when so many messages more have been read: what it rests on comes by other
/// ways, some milliseconds before or after.
inline constexpr std::int64_t kMessagesARound = 8192;
/// Poses that others have followed are kept for so many rounds.
inline constexpr int kRoundsKept = 3;

/// The leading bytes of an endpoint's identifier.
using Participant = std::array<std::uint8_t, 12>;
[[nodiscard]] Participant participant_of(const RecordedWriter& writer);

/// Tells the numbers of a mover's samples apart for as long as a recording is: they are of 32 bits,
/// and what follows the highest is 1 again, for 0 is no number. Samples of 10,000 bodies come to
/// that in a day.
class SampleNumbers {
 public:
  /// A sample came. Out: its place among all of the mover's; of two places the higher was said
  /// later.
  std::uint64_t take(std::uint32_t number) {
    const std::uint64_t place = place_of(number);
    last_ = std::max(last_, place);
    return place;
  }
  /// Of a number that a peer had heard by about now: the nearest to the last one that came. Of 0,
  /// which nobody has said: 0.
  [[nodiscard]] std::uint64_t place_of(std::uint32_t number) const {
    if (number == 0) return 0;
    // There is room below the first for one of before it that comes later.
    if (last_ == 0) return kAround + number;
    const auto ahead = static_cast<std::int32_t>(number - static_cast<std::uint32_t>(last_));
    return last_ + static_cast<std::uint64_t>(std::int64_t{ahead});
  }
  /// 0: none came.
  [[nodiscard]] std::uint64_t last() const { return last_; }
  [[nodiscard]] static bool is_none(std::uint64_t place) {
    return static_cast<std::uint32_t>(place) == 0;
  }

 private:
  static constexpr std::uint64_t kAround = std::uint64_t{1} << 32;
  std::uint64_t last_ = 0;
};

/// Samples of poses of one topic, by part and place (SampleNumbers).
class PoseSamples {
 public:
  /// The bodies of a part may come in several samples, so many at most: as many count as the last
  /// one.
  explicit PoseSamples(std::size_t samples_a_part) : samples_a_part_(samples_a_part) {}

  void take(wire::BodyPoses&& poses, int round);
  void forget(int round);

  struct Found {
    const wire::BodyPoses::Body* body = nullptr;
    std::uint64_t place = 0;  ///< of its sample

    [[nodiscard]] bool is_of(std::uint32_t sequence) const {
      return static_cast<std::uint32_t>(place) == sequence;
    }
  };
  /// Where the last samples of its part have the body, of those up to `last`.
  [[nodiscard]] Found find(std::uint32_t number, std::uint32_t last) const;
  /// The same of the links of a robot, by number: where the last instant of one update has them of
  /// which all had come. Empty where there is none.
  using Links = std::map<std::uint32_t, Found>;
  [[nodiscard]] Links find_links(std::uint32_t first, std::uint32_t links,
                                 std::uint32_t last) const;
  /// use(pose) of each that is kept of the body.
  template <class Use>
  void for_each(std::uint32_t number, const Use& use) const {
    const auto part = parts_.find(number / wire::kBodiesPerPart);
    if (part == parts_.end()) return;
    for (const auto& [place, sample] : part->second)
      for (const wire::BodyPoses::Body& body : sample.bodies)
        if (body.number == number) use(body);
  }
  /// All samples after that of `first` up to `last` are here.
  [[nodiscard]] bool is_whole(const Found& first, std::uint32_t last) const;

 private:
  struct Sample {
    std::vector<wire::BodyPoses::Body> bodies;
    int round = 0;
  };
  const std::size_t samples_a_part_;
  SampleNumbers numbers_;
  std::map<std::uint32_t, std::map<std::uint64_t, Sample>> parts_;  // by place
  std::uint64_t unknown_until_ = 0;
  // Places of samples that did not come.
  std::deque<std::pair<std::uint64_t, std::uint64_t>> holes_;
};

/// Where the links of robots were, as one report rests on them: looked for once for each robot,
/// however many links it has. What it gives holds until samples come or are forgotten.
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

/// What one participant said of the bodies that one session moves: who they are, their poses and
/// promises for a while.
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
  /// What was promised of a body at that time, as one knows it who heard all up to `last`:
  /// `is_known` is false where nothing was.
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
  SampleNumbers promise_numbers_;
  std::map<std::uint32_t, std::map<std::uint64_t, Promised>> promises_;  // by part and place
};

}  // namespace nearmesh::subscriber
