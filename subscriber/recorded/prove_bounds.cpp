// SPDX-License-Identifier: Apache-2.0
// Why what comes out is what the peer said: bounds follow from headers, poses and velocities alone (core/THEOREM.md, "Free by bounds"), so
// which bodies there were before, and in which order, does not count.
#include "prove_bounds.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <new>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/broadphase/body_place.hpp"
#include "core/broadphase/free_pairs.hpp"
#include "core/world/content_bytes.hpp"
#include "core/world/near_tiles.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {
namespace {

/// A report is judged when so many messages more have been read: what it rests on comes by other ways, some milliseconds before or after.
constexpr std::int64_t kMessagesARound = 8192;
/// Poses that others have followed are kept for so many rounds.
constexpr int kRoundsKept = 3;
constexpr std::size_t kMaxHoles = 4096;
/// Of a robot's poses: samples of each part that are looked at for the last whole instant.
constexpr std::size_t kMaxInstants = 64;
constexpr std::size_t kMaxReasons = 64;

/// The leading bytes of an endpoint's identifier.
using Participant = std::array<std::uint8_t, 12>;

Participant participant_of(const RecordedWriter& writer) {
  Participant participant{};
  std::copy_n(writer.guid.begin(), participant.size(), participant.begin());
  return participant;
}

/// Samples of poses of one topic, by part and sequence.
class PoseSamples {
 public:
  /// The bodies of a part may come in several samples, so many at most: as many count as the last one.
  explicit PoseSamples(std::size_t samples_a_part) : samples_a_part_(samples_a_part) {}

  void take(wire::BodyPoses&& poses, int round) {
    const std::uint32_t sequence = poses.sequence;
    if (sequence == 0) return;
    if (sequence > last_) {
      if (sequence > last_ + 1) holes_.emplace_back(last_ + 1, sequence - 1);
      last_ = sequence;
    }
    if (holes_.size() > kMaxHoles) {
      unknown_until_ = holes_.front().second;
      holes_.pop_front();
    }
    parts_[poses.part].try_emplace(sequence, Sample{std::move(poses.bodies), round});
  }
  void forget(int round) {
    for (auto& [part, samples] : parts_)
      while (samples.size() > samples_a_part_ &&
             std::next(samples.begin())->second.round + kRoundsKept < round)
        samples.erase(samples.begin());
  }
  struct Found {
    const wire::BodyPoses::Body* body = nullptr;
    std::uint32_t sequence = 0;
  };
  /// Where the last samples of its part have the body, of those up to `last`.
  [[nodiscard]] Found find(std::uint32_t number, std::uint32_t last) const {
    const auto part = parts_.find(number / wire::kBodiesPerPart);
    if (part == parts_.end()) return {};
    auto at = part->second.upper_bound(last);
    for (std::size_t i = 0; i < samples_a_part_ && at != part->second.begin(); ++i) {
      --at;
      for (const wire::BodyPoses::Body& body : at->second.bodies)
        if (body.number == number) return {&body, at->first};
    }
    return {};
  }
  /// The same of the links of a robot, by number: where the last instant has them of which all had come. Empty where there is none.
  using Links = std::map<std::uint32_t, Found>;
  [[nodiscard]] Links find_links(std::uint32_t first, std::uint32_t links,
                                 std::uint32_t last) const {
    struct Instant {
      Links links;
      std::uint32_t newest = 0;
    };
    std::map<double, Instant> instants;
    for (std::uint32_t at = first / wire::kBodiesPerPart;
         at <= (first + links - 1) / wire::kBodiesPerPart; ++at) {
      const auto part = parts_.find(at);
      if (part == parts_.end()) return {};
      auto sample = part->second.upper_bound(last);
      for (std::size_t i = 0; i < kMaxInstants && sample != part->second.begin(); ++i) {
        --sample;
        for (const wire::BodyPoses::Body& body : sample->second.bodies) {
          if (body.number < first || body.number >= first + links) continue;
          Instant& instant = instants[body.time_s];
          instant.newest = std::max(instant.newest, sample->first);
          instant.links.try_emplace(body.number, Found{&body, sample->first});
        }
      }
    }
    Instant* whole = nullptr;
    for (auto& [time_s, instant] : instants)
      if (instant.links.size() == links && (whole == nullptr || whole->newest < instant.newest))
        whole = &instant;
    return whole == nullptr ? Links{} : std::move(whole->links);
  }
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
  [[nodiscard]] bool is_whole(std::uint32_t first, std::uint32_t last) const {
    if (last > last_ || first < unknown_until_) return false;
    // Ascending, since each begins after what had come.
    const auto next = std::partition_point(holes_.begin(), holes_.end(),
                                           [&](const auto& hole) { return hole.second <= first; });
    return next == holes_.end() || next->first > last;
  }

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
                                        const wire::BodyDirectory::Body& link, std::uint32_t last) {
    const auto [at, is_new] = robots_.try_emplace({&samples, link.first_link, link.links, last});
    if (is_new) at->second = samples.find_links(link.first_link, link.links, last);
    const auto found = at->second.find(link.number);
    return found == at->second.end() ? PoseSamples::Found{} : found->second;
  }

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

  void take(wire::BodyDirectory&& directory) {
    for (wire::BodyDirectory::Body& body : directory.bodies) {
      const std::uint32_t number = body.number;  // none is used again
      who_[number] = std::move(body);
    }
  }
  void take(wire::BodyPoses&& message, int round) { poses.take(std::move(message), round); }
  /// Out: a line about a body that is not where it was promised to be; else empty.
  std::string take(wire::NearPoses&& message, int round) {
    std::string broken;
    for (const wire::BodyPoses::Body& body : message.bodies) {
      const auto part = promises_.find(body.number / wire::kBodiesPerPromise);
      if (part == promises_.end()) continue;
      for (const auto& [sequence, promised] : part->second)
        if (const auto promise = promise_in(promised.message, body.number);
            promise && broken.empty())
          broken = why_broken(*promise, body);
    }
    near.take(std::move(message), round);
    return broken;
  }
  /// The same.
  std::string take(wire::BodyPromises&& message, int round) {
    std::string broken;
    for (const wire::BodyPromises::Body& body : message.bodies)
      if (const auto promise = promise_in(message, body.number))
        near.for_each(body.number, [&](const wire::BodyPoses::Body& pose) {
          if (broken.empty()) broken = why_broken(*promise, pose);
        });
    if (message.sequence != 0)
      promises_[message.part].try_emplace(message.sequence, Promised{std::move(message), round});
    return broken;
  }
  void forget(int round) {
    poses.forget(round);
    near.forget(round);
    for (auto& [part, promised] : promises_)
      while (promised.size() > 2 &&
             std::next(promised.begin(), 2)->second.round + kRoundsKept < round)
        promised.erase(promised.begin());
  }
  /// Null where no directory told.
  [[nodiscard]] const wire::BodyDirectory::Body* who_is(std::uint32_t number) const {
    const auto at = who_.find(number);
    return at == who_.end() ? nullptr : &at->second;
  }
  /// What was promised of a body at that time, as one knows it who heard all up to `last`: `is_known` is false where nothing was.
  struct FoundPromise {
    bool is_known = false;
    std::optional<wire::BodyPromise> holds;
  };
  [[nodiscard]] FoundPromise find_promise(std::uint32_t number, std::uint32_t last,
                                          double time_s) const {
    FoundPromise found;
    const auto part = promises_.find(number / wire::kBodiesPerPromise);
    if (part == promises_.end()) return found;
    auto at = part->second.upper_bound(last);
    for (int heard = 0; heard < 2 && at != part->second.begin();) {
      --at;
      const std::optional<wire::BodyPromise> promise = promise_in(at->second.message, number);
      if (!promise) continue;
      ++heard;
      found.is_known = true;
      if (promise->radius_m(time_s) && (!found.holds || found.holds->from_s < promise->from_s))
        found.holds = promise;
    }
    return found;
  }

  PoseSamples poses{1}, near{wire::kBodiesPerPart};

 private:
  struct Promised {
    wire::BodyPromises message;
    int round = 0;
  };
  [[nodiscard]] std::optional<wire::BodyPromise> promise_in(const wire::BodyPromises& message,
                                                            std::uint32_t number) const {
    const auto who = who_.find(number);
    if (who == who_.end() || who->second.max_speed_mps <= 0) return std::nullopt;
    for (const wire::BodyPromises::Body& body : message.bodies)
      if (body.number == number) return wire::promise_of(message, body, who->second);
    return std::nullopt;
  }
  /// Sessions round against the body, so what they let pass is in here.
  static std::string why_broken(const wire::BodyPromise& promise,
                                const wire::BodyPoses::Body& pose) {
    const std::optional<double> radius_m = promise.radius_m(pose.time_s);
    if (!radius_m) return {};
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double way_m = pose.motion.pose.translation_m[k] - promise.place_m[k];
      square += way_m * way_m;
    }
    if (std::sqrt(square) <= *radius_m) return {};
    return "body " + promise.body + " of " + to_hex(promise.peer) + " is " +
           std::to_string(std::sqrt(square)) + " m from its promised place at " +
           std::to_string(pose.time_s) + " s, promised were " + std::to_string(*radius_m) + " m";
  }

  Participant participant_;
  std::map<std::uint32_t, wire::BodyDirectory::Body> who_;
  std::map<std::uint32_t, std::map<std::uint32_t, Promised>> promises_;  // by part and sequence
};

/// Of models and worlds whose headers are recorded.
class RecordedBounds {
 public:
  void take(const wire::MeshHeader& header) {
    if (bounds_.contains(header.content_hash)) return;
    if (is_world_record(header.bytes)) {
      if (auto record = decode_world(header.bytes); record.is_ok())
        worlds_.try_emplace(record.value().root, World{header.content_hash, record.value(),
                                                       ContentReader(record.value().root)});
    } else if (auto model = decode_header(header.bytes); model.is_ok()) {
      const SplitStore store(model.value());
      bounds_.emplace(header.content_hash, ModelBounds(model.value().grid, store));
    }
  }
  /// A world's first page has its box.
  [[nodiscard]] bool awaits_pages() const { return !worlds_.empty(); }
  void take(const wire::SplitBatchMessage& batch) {
    const auto at = worlds_.find(batch.content_hash);
    if (at == worlds_.end() || batch.refused) return;
    World& world = at->second;
    const auto piece = unseal_batch(batch.content_hash, batch.bytes);
    if (!piece.is_ok()) return;
    const auto bytes = world.reader.take(piece.value());
    if (!bytes.is_ok() || !bytes.value()) return;
    const Result<WorldPage> page = decode_page(*bytes.value());
    if (!page.is_ok() || page.value().level != world.record.root_level) return;
    const CellBox all = page.value().box();
    GridBox box;
    for (std::size_t k = 0; k < 3; ++k) {
      box.lo.v[k] = static_cast<std::int32_t>(all.lo[k]);
      box.hi.v[k] = static_cast<std::int32_t>(all.hi[k]);
    }
    bounds_.emplace(world.name, ModelBounds(world_grid(world.record), box));
    worlds_.erase(at);
  }
  [[nodiscard]] const ModelBounds* find(const ContentHash& content) const {
    const auto at = bounds_.find(content);
    return at == bounds_.end() ? nullptr : &at->second;
  }

 private:
  struct World {
    ContentHash name;
    WorldRecord record;
    ContentReader reader;
  };
  std::map<ContentHash, ModelBounds> bounds_;
  std::map<ContentHash, World> worlds_;  // whose first page has not come, by that
};

bool is_same(const Motion& a, const Motion& b) {
  return a.pose.rotation == b.pose.rotation && a.pose.translation_m == b.pose.translation_m &&
         a.linear_velocity_mps == b.linear_velocity_mps &&
         a.angular_velocity_radps == b.angular_velocity_radps;
}

struct Judged {
  enum class Verdict : std::uint8_t { kProved, kWrong, kUnprovable } verdict = Verdict::kProved;
  std::string what;
};
Judged unprovable(std::string what) { return {Judged::Verdict::kUnprovable, std::move(what)}; }
Judged wrong(std::string what) { return {Judged::Verdict::kWrong, std::move(what)}; }

/// A body that a peer watches.
struct WatchedBody {
  wire::SessionId mover = 0;  // 0: it is in place
  wire::WatchedBodies::Known known = wire::WatchedBodies::Known::kByPose;
  std::size_t mover_place = 0;
  std::uint32_t number = 0;
  std::string name;  // empty: not known yet
  ContentHash content;
  Company company;
  double max_age_s = 0;
  const ModelBounds* bounds = nullptr;
  // As it was last put into the broad phase.
  BroadPhase::Slot slot = 0;
  std::optional<Motion> motion;
  BodyPlace place;
};

/// One peer, as one participant speaks for it.
struct Watcher {
  struct Waiting {
    std::int64_t id = 0;
    int round = 0;
    wire::BoundsReport report;
  };
  std::map<std::uint32_t, std::map<std::uint32_t, wire::WatchedBodies>> told;  // by part, edition
  std::uint32_t whole_until = 0;  // all editions up to this came
  std::deque<Waiting> waiting;
  // What it watched when a report was judged last.
  std::uint32_t edition = 0;  // 0: none
  LookAhead ahead;
  std::vector<WatchedBody> bodies;
  std::vector<wire::SessionId> movers;
  BroadPhase broad;
  std::vector<std::size_t> by_slot;  // of the bodies

  /// Contact reports, by their bodies' names in order, then frame; for a while.
  struct Said {
    double since_s = 0;  // a frame may be repeated
    int round = 0;
    bool put_off = false;  // told once, until the pair is asked again
  };
  std::map<std::pair<std::string, std::string>, std::map<std::uint64_t, Said>> said;
  std::optional<std::uint64_t> first_said;  // frame
  std::uint64_t latest_frame = 0;           // of the report that came last, of either kind

  void take(wire::ContactReport&& report, int round) {
    if (!first_said) first_said = report.frame;
    latest_frame = report.frame;
    // What claims something where nothing could be known is no answer: verify calls it different.
    const bool is_known = report.asked && why_stale(report).empty();
    if (!is_known && !claims_nothing(report)) return;
    if (report.body_b < report.body_a) std::swap(report.body_a, report.body_b);
    auto& frames = said[{std::move(report.body_a), std::move(report.body_b)}];
    const auto at = frames.try_emplace(report.frame, Said{report.time_s}).first;
    at->second = {std::min(at->second.since_s, report.time_s), round, report.put_off};
  }
  [[nodiscard]] bool has_said(const std::string& a, const std::string& b,
                              const wire::BoundsReport& report) const {
    const auto pair = said.find(std::minmax(a, b));
    if (pair == said.end()) return false;
    const auto after = pair->second.upper_bound(report.frame);
    if (after == pair->second.begin()) return false;
    const auto& [frame, last] = *std::prev(after);
    // Where a frame is repeated at another time, what is as before is not said again.
    return last.put_off || (frame == report.frame && last.since_s <= report.time_s);
  }
  void forget(int round) {
    for (auto& [names, frames] : said) {
      const std::uint64_t last = frames.rbegin()->first;
      std::erase_if(frames, [last, round](const auto& one) {
        return one.second.round + kRoundsKept < round && !(one.first == last && one.second.put_off);
      });
    }
    std::erase_if(said, [](const auto& pair) { return pair.second.empty(); });
  }

  void take(wire::WatchedBodies&& watched) {
    if (watched.edition == whole_until + 1) whole_until = watched.edition;
    auto& editions = told[watched.part];
    editions.insert_or_assign(watched.edition, std::move(watched));
    if (std::cmp_greater(editions.size(), 2 * kMessagesARound)) editions.erase(editions.begin());
  }
};

class Prover {
 public:
  /// `late`: who had sent contact reports before the recorder heard the first.
  Prover(bool lacks_watched, std::set<Participant> late)
      : lacks_watched_(lacks_watched), late_(std::move(late)) {}

  void take(std::int64_t id, const RecordedMessage& message, const RecordedWriter& writer,
            const wire::RecordedSamples& samples) {
    const Participant from = participant_of(writer);
    if (auto poses = samples.read<wire::BodyPoses>(message)) {
      tape_of(poses->peer, from).take(std::move(*poses), round_);
    } else if (auto near = samples.read<wire::NearPoses>(message)) {
      note_broken(tape_of(near->peer, from).take(std::move(*near), round_));
    } else if (auto promises = samples.read<wire::BodyPromises>(message)) {
      note_broken(tape_of(promises->peer, from).take(std::move(*promises), round_));
    } else if (auto directory = samples.read<wire::BodyDirectory>(message)) {
      tape_of(directory->peer, from).take(std::move(*directory));
    } else if (auto watched = samples.read<wire::WatchedBodies>(message)) {
      watchers_[{from, watched->peer}].take(std::move(*watched));
    } else if (const auto header = samples.read<wire::MeshHeader>(message)) {
      bounds_.take(*header);
    } else if (samples.is<wire::SplitBatchMessage>(message)) {
      if (!bounds_.awaits_pages()) return;
      if (const auto batch = samples.read<wire::SplitBatchMessage>(message)) bounds_.take(*batch);
    } else if (samples.is<wire::BoundsReport>(message)) {
      ++proof_.reports;
      auto report = samples.read<wire::BoundsReport>(message);
      if (!report) {
        ++proof_.malformed;
        return;
      }
      proof_.pairs += report->pairs;
      Watcher& watcher = watchers_[{from, report->peer}];
      watcher.latest_frame = report->frame;
      watcher.waiting.push_back({id, round_, std::move(*report)});
    } else if (auto said = samples.read<wire::ContactReport>(message)) {
      watchers_[{from, said->peer}].take(std::move(*said), round_);
    }
  }
  /// Judges what has waited long enough. `final`: nothing more comes.
  void work(bool final) {
    for (auto& [key, watcher] : watchers_) {
      for (; !watcher.waiting.empty() && (final || watcher.waiting.front().round < round_);
           watcher.waiting.pop_front()) {
        const wire::BoundsReport& report = watcher.waiting.front().report;
        Judged verdict = judge(watcher, key.first, report);
        if (verdict.verdict == Judged::Verdict::kProved)
          count_unreported(watcher, report, late_.contains(key.first));
        note(watcher.waiting.front(), std::move(verdict));
      }
      watcher.forget(round_);
    }
    ++round_;
    for (auto& [mover, tapes] : tapes_)
      for (PoseTape& tape : tapes) tape.forget(round_);
  }
  [[nodiscard]] BoundsProof finish() {
    std::sort(proof_.wrong_ones.begin(), proof_.wrong_ones.end(),
              [](const auto& a, const auto& b) { return a.message < b.message; });
    if (proof_.wrong_ones.size() > kMaxWrongBounds) proof_.wrong_ones.resize(kMaxWrongBounds);
    return std::move(proof_);
  }

 private:
  PoseTape& tape_of(wire::SessionId mover, const Participant& from) {
    std::deque<PoseTape>& tapes = tapes_[mover];
    const auto known = std::find_if(tapes.begin(), tapes.end(), [&](const PoseTape& tape) {
      return tape.participant() == from;
    });
    return known != tapes.end() ? *known : tapes.emplace_back(from);
  }

  void note_broken(std::string&& what) {
    if (what.empty()) return;
    ++proof_.broken;
    if (proof_.first_broken.empty()) proof_.first_broken = std::move(what);
  }

  void note(const Watcher::Waiting& judged, Judged&& verdict) {
    switch (verdict.verdict) {
      case Judged::Verdict::kProved:
        ++proof_.proved;
        proof_.proved_pairs += judged.report.pairs;
        proof_.digest += mix(judged.report.places_digest ^ mix(judged.report.pairs));
        break;
      case Judged::Verdict::kWrong:
        ++proof_.wrong;
        if (proof_.wrong_ones.size() < 64 * kMaxWrongBounds)
          proof_.wrong_ones.push_back({judged.id, judged.report, std::move(verdict.what)});
        break;
      case Judged::Verdict::kUnprovable:
        ++proof_.unprovable;
        if (proof_.why_not.size() < kMaxReasons || proof_.why_not.contains(verdict.what))
          ++proof_.why_not[verdict.what];
        break;
    }
  }

  /// Which bodies the peer watches in an edition. Out: empty, or what is not there.
  std::string assemble(Watcher& watcher, std::uint32_t edition) {
    if (watcher.edition == edition) return {};
    watcher.edition = 0;
    watcher.bodies.clear();
    watcher.broad = BroadPhase();
    std::set<wire::SessionId> movers;
    bool is_any = false;
    for (auto& [part, editions] : watcher.told) {
      auto at = editions.upper_bound(edition);
      if (at == editions.begin()) continue;
      --at;
      editions.erase(editions.begin(), at);
      const wire::WatchedBodies& told = at->second;
      is_any |= told.edition == edition;
      watcher.ahead = {told.horizon_s, told.margin_m};
      for (const wire::WatchedBodies::Run& run : told.runs) {
        movers.insert(run.mover);
        for (std::uint32_t i = 0; i < run.count; ++i)
          watcher.bodies.push_back(
              {.mover = run.mover,
               .known = run.known,
               .number = run.first + i,
               .content = run.content,
               .company = {run.group, run.mask, false, told.only_own && run.mover != told.peer},
               .max_age_s = run.max_age_s});
      }
      for (const wire::WatchedBodies::Placed& body : told.placed)
        watcher.bodies.push_back(
            {.name = body.name,
             .content = body.content,
             .company = {body.group, body.mask, true, told.only_own && !body.own},
             .motion = Motion{.pose = body.pose}});
    }
    if (!is_any) return "which bodies the peer watched";
    watcher.movers.assign(movers.begin(), movers.end());
    std::set<std::tuple<wire::SessionId, std::uint32_t, std::string>> known;
    for (WatchedBody& body : watcher.bodies) {
      if (!known.emplace(body.mover, body.number, body.name).second)
        return "which bodies the peer watched: one is told of twice";
      body.bounds = bounds_.find(body.content);
      if (body.bounds == nullptr)
        return "the header, or the world's first page, of content " + to_hex(body.content);
      body.mover_place = static_cast<std::size_t>(
          std::lower_bound(watcher.movers.begin(), watcher.movers.end(), body.mover) -
          watcher.movers.begin());
      body.slot = watcher.broad.add(body.company);
      watcher.by_slot.resize(std::max<std::size_t>(watcher.by_slot.size(), body.slot + 1));
      watcher.by_slot[body.slot] = static_cast<std::size_t>(&body - watcher.bodies.data());
      if (body.mover == 0) place(watcher, body);
    }
    watcher.edition = edition;
    return {};
  }

  static void put(Watcher& watcher, WatchedBody& body, double margin_s, const auto& place_for) {
    body.place = place_for(watcher.ahead);
    watcher.broad.place(body.slot, body.place.box, [&] {
      const LookAhead farther{watcher.ahead.horizon_s + margin_s, watcher.ahead.margin_m};
      return hull(place_for(farther).box, body.place.box);
    });
  }
  /// Where body.motion has it.
  static void place(Watcher& watcher, WatchedBody& body) {
    put(watcher, body, 1, [&](const LookAhead& ahead) {
      return place_by_pose(who_is(body), *body.bounds, *body.motion, ahead);
    });
  }
  static PlacedBody who_is(const WatchedBody& body) {
    return {body.name, body.content, body.company};
  }

  /// The bodies of a mover, as one participant tells of them: first the peer's own by the participant that reports, then the latest first,
  /// for one session may have had several. `use` gives true where it has found what it looked for.
  template <class Use>
  bool look_at_tapes(const Participant& peer_from, wire::SessionId peer, const WatchedBody& body,
                     const Use& use) {
    const auto tapes = tapes_.find(body.mover);
    if (tapes == tapes_.end()) return false;
    for (const bool by_reporter : {true, false})
      for (auto tape = tapes->second.rbegin(); tape != tapes->second.rend(); ++tape)
        if ((body.mover == peer && tape->participant() == peer_from) == by_reporter &&
            use(*tape, by_reporter))
          return true;
    return false;
  }

  struct FoundPose {
    const wire::BodyPoses::Body* body = nullptr;
    bool is_certain =
        false;  // no other can be meant: it is the peer's own, and nothing of the mover's is missing
  };
  /// The pose that the peer used of a body that somebody moves: all that is known of it is asked for here. `exactly`: in the near poses
  /// of that sequence.
  FoundPose find_pose(const Participant& peer_from, wire::SessionId peer, WatchedBody& body,
                      const wire::BoundsReport::Heard& heard,
                      const std::optional<std::uint32_t>& exactly, FoundLinks& links) {
    FoundPose pose;
    const bool is_promised = body.known == wire::WatchedBodies::Known::kPromised;
    const std::uint32_t last = exactly ? *exactly : is_promised ? heard.near : heard.poses;
    look_at_tapes(peer_from, peer, body, [&](const PoseTape& tape, bool by_reporter) {
      const PoseSamples& samples = is_promised ? tape.near : tape.poses;
      const wire::BodyDirectory::Body* who = tape.who_is(body.number);
      if (who == nullptr) return false;
      // Who moves a robot knows each instant at once.
      const PoseSamples::Found found = who->links > 1 && body.mover != peer
                                           ? links.find(samples, *who, last)
                                           : samples.find(body.number, last);
      if (found.body == nullptr || (exactly && found.sequence != *exactly)) return false;
      body.name = who->name;
      pose = {found.body, by_reporter && samples.is_whole(found.sequence, last)};
      return true;
    });
    return pose;
  }

  /// Of one that the peer knew by a promise. Out: what is not there; else empty.
  std::string place_promised(Watcher& watcher, const Participant& from,
                             const wire::BoundsReport& report, WatchedBody& body,
                             const wire::BoundsReport::Heard& heard) {
    std::optional<wire::BodyPromise> promise;
    const bool is_known = look_at_tapes(from, report.peer, body, [&](const PoseTape& tape, bool) {
      const PoseTape::FoundPromise found =
          tape.find_promise(body.number, heard.promises, report.time_s);
      if (!found.is_known) return false;
      promise = found.holds;
      body.name = tape.who_is(body.number)->name;
      return true;
    });
    if (!is_known) return "a promise of a body of " + to_hex(body.mover) + ", or its name";
    body.motion.reset();
    if (!promise) {
      watcher.broad.lose(body.slot);
      return {};
    }
    const Ball ball{promise->place_m, *promise->radius_m(report.time_s)};
    put(watcher, body, 1, [&](const LookAhead& ahead) {
      return place_by_promise(who_is(body), *body.bounds, ball, promise->max_speed_mps, ahead);
    });
    return {};
  }

  Judged judge(Watcher& watcher, const Participant& from, const wire::BoundsReport& report) {
    if (report.rests_on_more) return unprovable("a pose that the host heard, not from the bus");
    if (std::string lacks = assemble(watcher, report.edition); !lacks.empty())
      return unprovable(std::move(lacks));
    if (report.heard.size() != watcher.movers.size())
      return unprovable("whose poses the peer had heard");
    FreePairs bounds;
    FoundLinks links;
    std::uint64_t digest = 0;
    bool is_certain = !lacks_watched_ && watcher.whole_until >= report.edition;
    for (WatchedBody& body : watcher.bodies) {
      double age_s = 0;
      if (body.mover != 0) {
        const wire::BoundsReport::Heard& heard = report.heard[body.mover_place];
        const auto posed = std::lower_bound(
            heard.posed.begin(), heard.posed.end(), body.number,
            [](const auto& one, std::uint32_t number) { return one.number < number; });
        std::optional<std::uint32_t> exactly;
        if (posed != heard.posed.end() && posed->number == body.number) exactly = posed->sequence;
        const bool is_promised = body.known == wire::WatchedBodies::Known::kPromised;
        if (is_promised && body.mover != report.peer && !exactly) {
          if (std::string lacks = place_promised(watcher, from, report, body, heard);
              !lacks.empty())
            return unprovable(std::move(lacks));
          is_certain = false;
          if (!watcher.broad.is_placed(body.slot)) continue;
        } else {
          const FoundPose found = find_pose(from, report.peer, body, heard, exactly, links);
          if (found.body == nullptr)
            return unprovable("a pose of a body of " + to_hex(body.mover) + ", or its name");
          is_certain &= found.is_certain;
          const bool is_now = body.mover == report.peer && is_at_rest(found.body->motion);
          const wire::PoseStamp stamp{wire::Mover::kThere,
                                      is_now ? report.time_s : found.body->time_s, body.max_age_s};
          age_s = wire::age_s(stamp, report.time_s);
          if (!wire::why_stale(stamp, report.time_s, body.name).empty()) {
            watcher.broad.lose(body.slot);
            body.motion.reset();
            continue;
          }
          if (!body.motion || !is_same(*body.motion, found.body->motion)) {
            body.motion = found.body->motion;
            place(watcher, body);
          }
        }
      }
      digest += body.place.digest;
      bounds.add(body.place.way_m, age_s);
    }
    if (digest != report.places_digest) {
      const std::string what =
          "the poses and promises that the peer used: they are not those recorded";
      return is_certain ? wrong("recorded poses, names and contents have digest " + to_hex(digest) +
                                ", the report says " + to_hex(report.places_digest))
                        : unprovable(what);
    }
    return compare(report, watcher, bounds);
  }

  /// use(one, other) of each pair that is near; which of them the tree finds besides are not.
  template <class Use>
  static void for_each_near(Watcher& watcher, const Use& use) {
    for (const auto& [a, b] : watcher.broad.find_near()) {
      const WatchedBody &one = watcher.bodies[watcher.by_slot[a]],
                        &other = watcher.bodies[watcher.by_slot[b]];
      if (may_be_near(one.place, other.place)) use(one, other);
    }
  }

  static Judged compare(const wire::BoundsReport& report, Watcher& watcher,
                        const FreePairs& bounds) {
    std::uint64_t near = 0;
    for_each_near(watcher, [&](const WatchedBody&, const WatchedBody&) { ++near; });
    const std::uint64_t free = watcher.broad.placed_pair_count() - near;
    if (report.pairs != std::min<std::uint64_t>(free, std::numeric_limits<std::uint32_t>::max()))
      return wrong("recorded " + std::to_string(report.pairs) + " pairs free by bounds; found " +
                   std::to_string(free));
    const double clearance_m = bounds.clearance_m(watcher.ahead.margin_m);
    if (double{report.clearance_m} > clearance_m)
      return wrong("recorded clearance " + std::to_string(report.clearance_m) +
                   " m; bounds prove " + std::to_string(clearance_m) + " m");
    const double horizon_s = bounds.horizon_s(watcher.ahead.horizon_s);
    if (double{report.horizon_s} > horizon_s)
      return wrong("recorded free for " + std::to_string(report.horizon_s) + " s; bounds prove " +
                   std::to_string(horizon_s) + " s");
    return {};
  }

  /// Near are those pairs that the broad phase did not find free just now.
  void count_unreported(Watcher& watcher, const wire::BoundsReport& report, bool is_late) {
    if (report.frame == watcher.latest_frame) return;
    if (is_late && (!watcher.first_said || report.frame <= *watcher.first_said)) return;
    for_each_near(watcher, [&](const WatchedBody& one, const WatchedBody& other) {
      ++proof_.near_pairs;
      if (watcher.has_said(one.name, other.name, report)) return;
      ++proof_.unreported;
      if (proof_.first_unreported.empty())
        proof_.first_unreported = "frame " + std::to_string(report.frame) + ", peer " +
                                  wire::partition_of(report.peer) + ", bodies " + one.name +
                                  " and " + other.name;
    });
  }

  const bool lacks_watched_;  // something that was said of watched bodies did not come
  const std::set<Participant> late_;
  int round_ = 0;
  RecordedBounds bounds_;
  std::map<wire::SessionId, std::deque<PoseTape>> tapes_;
  std::map<std::pair<Participant, wire::SessionId>, Watcher> watchers_;
  BoundsProof proof_;
};

}  // namespace

Result<BoundsProof> prove_bounds(RecordingReader& recording) {
  const FloatGuard guard;
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(samples);
  std::uint64_t missing = 0, before = 0;
  bool lacks_watched = false;
  std::set<Participant> late;
  for (const RecordingGap& gap : recording.gaps()) {
    const auto place = samples.value().place_of(recording.writers()[gap.writer].topic);
    if (place == wire::place_of<wire::BoundsReport>())
      (gap.first_sequence == 1 ? before : missing) += gap.count;
    lacks_watched |= place == wire::place_of<wire::WatchedBodies>();
    if (place == wire::place_of<wire::ContactReport>() && gap.first_sequence == 1)
      late.insert(participant_of(recording.writers()[gap.writer]));
  }
  Prover prover(lacks_watched, std::move(late));
  try {
    for (std::int64_t next = 1; next <= recording.message_count();) {
      const std::int64_t end = std::min(next + kMessagesARound, recording.message_count() + 1);
      NEARMESH_RETURN_IF_ERROR(
          recording.read(next, end, [&](std::int64_t id, const RecordedMessage& message) {
            prover.take(id, message, recording.writers()[message.writer], samples.value());
            return true;
          }));
      next = end;
      prover.work(false);
    }
    prover.work(true);
  } catch (const std::bad_alloc&) {
    return Status{StatusCode::kIo, "no memory for the models of the recording"};
  }
  BoundsProof proof = prover.finish();
  proof.missing = missing;
  proof.before = before;
  return proof;
}

}  // namespace nearmesh::subscriber
