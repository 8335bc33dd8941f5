// SPDX-License-Identifier: Apache-2.0
// Why what comes out is what the peer said: bounds follow from headers, poses and velocities alone
// (core/THEOREM.md, "Free by bounds"), so which bodies there were before, and in which order, does
// not count.
#include "prove_bounds.hpp"

#include <algorithm>
#include <deque>
#include <limits>
#include <map>
#include <new>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/broadphase/body_place.hpp"
#include "core/broadphase/free_pairs.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "pose_tape.hpp"
#include "recorded_bounds.hpp"
#include "watcher.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMaxReasons = 64;

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

  /// The bodies of a mover, as one participant tells of them: first the peer's own by the
  /// participant that reports, then the latest first, for one session may have had several. `use`
  /// gives true where it has found what it looked for.
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
    // No other can be meant: it is the peer's own, and nothing of the mover's is missing.
    bool is_certain = false;
  };
  /// The pose that the peer used of a body that somebody moves: all that is known of it is asked
  /// for here. `exactly`: in the sample of that sequence.
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
      const PoseSamples::Found found = who->links > 1 && body.mover != peer && !exactly
                                           ? links.find(samples, *who, last)
                                           : samples.find(body.number, last);
      if (found.body == nullptr || (exactly && !found.is_of(*exactly))) return false;
      body.name = who->name;
      pose = {found.body, by_reporter && samples.is_whole(found, last)};
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
