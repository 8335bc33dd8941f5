// SPDX-License-Identifier: Apache-2.0
// Why what comes out is what the peer said: bounds follow from headers, poses and velocities alone (core/THEOREM.md, "Free by bounds"), so
// which bodies there were before, and in which order, does not count.
#include "prove_bounds.hpp"

#include <algorithm>
#include <array>
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
#include "core/broadphase/body_bounds.hpp"
#include "core/broadphase/free_pairs.hpp"
#include "core/world/content_bytes.hpp"
#include "core/world/near_tiles.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"

namespace nearmesh::subscriber {
namespace {

/// A report is judged when so many messages more have been read: what it rests on comes by other ways, some milliseconds before or after.
constexpr std::int64_t kMessagesARound = 8192;
/// Poses that others have followed are kept for so many rounds.
constexpr int kRoundsKept = 3;
constexpr std::size_t kMaxHoles = 4096;
constexpr std::size_t kMaxReasons = 64;

/// The leading bytes of an endpoint's identifier.
using Participant = std::array<std::uint8_t, 12>;

Participant participant_of(const RecordedWriter& writer) {
  Participant participant{};
  std::copy_n(writer.guid.begin(), participant.size(), participant.begin());
  return participant;
}

/// What one participant said of the bodies that one session moves: their names, and their poses for a while.
class PoseTape {
 public:
  explicit PoseTape(const Participant& participant) : participant_(participant) {}

  [[nodiscard]] const Participant& participant() const { return participant_; }

  void take(wire::BodyDirectory&& directory) {
    for (wire::BodyDirectory::Body& body : directory.bodies)
      names_[body.number] = std::move(body.name);  // no number is used again
  }
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
      while (samples.size() > 1 && std::next(samples.begin())->second.round + kRoundsKept < round)
        samples.erase(samples.begin());
  }
  /// Null where no directory told.
  [[nodiscard]] const std::string* name_of(std::uint32_t number) const {
    const auto at = names_.find(number);
    return at == names_.end() ? nullptr : &at->second;
  }
  struct Found {
    const wire::BodyPoses::Body* body = nullptr;
    std::uint32_t sequence = 0;
  };
  /// Where the last sample of its part has the body, of those up to `last`.
  [[nodiscard]] Found find(std::uint32_t number, std::uint32_t last) const {
    const auto part = parts_.find(number / wire::kBodiesPerPart);
    if (part == parts_.end()) return {};
    auto at = part->second.upper_bound(last);
    if (at == part->second.begin()) return {};
    --at;
    for (const wire::BodyPoses::Body& body : at->second.bodies)
      if (body.number == number) return {&body, at->first};
    return {};
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
  Participant participant_;
  std::map<std::uint32_t, std::string> names_;
  std::map<std::uint32_t, std::map<std::uint32_t, Sample>> parts_;  // by sequence
  std::uint32_t last_ = 0, unknown_until_ = 0;
  std::deque<std::pair<std::uint32_t, std::uint32_t>> holes_;  // sequences that did not come
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
  std::uint64_t digest = 0;
  double way_m = 0;
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
  double horizon_s = 0, margin_m = 0;
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
      watcher.horizon_s = told.horizon_s;
      watcher.margin_m = told.margin_m;
      for (const wire::WatchedBodies::Run& run : told.runs) {
        movers.insert(run.mover);
        for (std::uint32_t i = 0; i < run.count; ++i)
          watcher.bodies.push_back({.mover = run.mover,
                                    .number = run.first + i,
                                    .content = run.content,
                                    .company = {run.group, run.mask, false},
                                    .max_age_s = run.max_age_s});
      }
      for (const wire::WatchedBodies::Placed& body : told.placed)
        watcher.bodies.push_back({.name = body.name,
                                  .content = body.content,
                                  .company = {body.group, body.mask, true},
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

  /// Where body.motion has it.
  static void place(Watcher& watcher, WatchedBody& body) {
    const Motion& motion = *body.motion;
    watcher.broad.place(
        body.slot, body.bounds->around(motion, watcher.horizon_s, watcher.margin_m),
        [&] { return body.bounds->around(motion, watcher.horizon_s + 1, watcher.margin_m); });
    body.way_m = body.bounds->way_m(motion, watcher.horizon_s);
    body.digest = place_digest(body.name, body.content, body.company, motion);
  }

  struct FoundPose {
    const wire::BodyPoses::Body* body = nullptr;
    bool is_certain =
        false;  // no other can be meant: it is the peer's own, and nothing of the mover's is missing
  };
  /// The pose that the peer used of a body that somebody moves: all that is known of it is asked for here.
  FoundPose find_pose(const Participant& peer_from, wire::SessionId peer, WatchedBody& body,
                      std::uint32_t last) {
    const auto tapes = tapes_.find(body.mover);
    if (tapes == tapes_.end()) return {};
    // The peer's own by the participant that reports; then the latest first: one session may have had several.
    for (const bool by_reporter : {true, false})
      for (auto tape = tapes->second.rbegin(); tape != tapes->second.rend(); ++tape) {
        if ((body.mover == peer && tape->participant() == peer_from) != by_reporter) continue;
        const PoseTape::Found found = tape->find(body.number, last);
        const std::string* name = tape->name_of(body.number);
        if (found.body == nullptr || name == nullptr) continue;
        body.name = *name;
        return {found.body, by_reporter && tape->is_whole(found.sequence, last)};
      }
    return {};
  }

  Judged judge(Watcher& watcher, const Participant& from, const wire::BoundsReport& report) {
    if (std::string lacks = assemble(watcher, report.edition); !lacks.empty())
      return unprovable(std::move(lacks));
    if (report.heard.size() != watcher.movers.size())
      return unprovable("whose poses the peer had heard");
    FreePairs bounds;
    std::uint64_t digest = 0;
    bool is_certain = !lacks_watched_ && watcher.whole_until >= report.edition;
    for (WatchedBody& body : watcher.bodies) {
      double age_s = 0;
      if (body.mover != 0) {
        const FoundPose found = find_pose(from, report.peer, body, report.heard[body.mover_place]);
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
      digest += body.digest;
      bounds.add(body.way_m, age_s);
    }
    if (digest != report.places_digest) {
      const std::string what = "the poses that the peer used: they are not those recorded";
      return is_certain ? wrong("recorded poses, names and contents have digest " + to_hex(digest) +
                                ", the report says " + to_hex(report.places_digest))
                        : unprovable(what);
    }
    return compare(report, watcher, bounds);
  }

  static Judged compare(const wire::BoundsReport& report, Watcher& watcher,
                        const FreePairs& bounds) {
    const std::uint64_t near = watcher.broad.find_near().size();
    const std::uint64_t free = watcher.broad.placed_pair_count() - near;
    if (report.pairs != std::min<std::uint64_t>(free, std::numeric_limits<std::uint32_t>::max()))
      return wrong("recorded " + std::to_string(report.pairs) + " pairs free by bounds; found " +
                   std::to_string(free));
    const double clearance_m = bounds.clearance_m(watcher.margin_m);
    if (double{report.clearance_m} > clearance_m)
      return wrong("recorded clearance " + std::to_string(report.clearance_m) +
                   " m; bounds prove " + std::to_string(clearance_m) + " m");
    const double horizon_s = bounds.horizon_s(watcher.horizon_s);
    if (double{report.horizon_s} > horizon_s)
      return wrong("recorded free for " + std::to_string(report.horizon_s) + " s; bounds prove " +
                   std::to_string(horizon_s) + " s");
    return {};
  }

  /// Near are those pairs that the broad phase did not find free just now.
  void count_unreported(Watcher& watcher, const wire::BoundsReport& report, bool is_late) {
    if (report.frame == watcher.latest_frame) return;
    if (is_late && (!watcher.first_said || report.frame <= *watcher.first_said)) return;
    for (const auto& [one, other] : watcher.broad.find_near()) {
      ++proof_.near_pairs;
      const std::string &a = watcher.bodies[watcher.by_slot[one]].name,
                        &b = watcher.bodies[watcher.by_slot[other]].name;
      if (watcher.has_said(a, b, report)) continue;
      ++proof_.unreported;
      if (proof_.first_unreported.empty())
        proof_.first_unreported = "frame " + std::to_string(report.frame) + ", peer " +
                                  wire::partition_of(report.peer) + ", bodies " + a + " and " + b;
    }
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
