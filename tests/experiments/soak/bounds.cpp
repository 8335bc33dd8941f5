// SPDX-License-Identifier: Apache-2.0
// Pairs that a session says are free by bounds, against the exact query of the full meshes:
// aircraft that fly, turn, jump, come and go over a ground. Some are the session's own and at times
// say nothing; others are heard of now and then, late, and their poses grow stale.
//   nearmesh-soak-bounds --pair-frames 1000000 --seed 1
// Of each frame: a pair that is not listed is free at the poses that are known, with the clearance
// that was said; as many pairs as there should be are unknown, and no more; what a listed pair was
// answered agrees with the full meshes. Of each eighth pair: it is still free at some moment of the
// horizon that was said, where both bodies have gone on as they flew. Exit 1 at the first that is
// not so.

#include <CLI/CLI.hpp>
#include <cinttypes>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>

#include "brute_force.hpp"
#include "fault_of.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "swarm.hpp"

using namespace nearmesh;
using subscriber::BodyId;
using subscriber::FrameReport;
using subscriber::PairAnswer;
using subscriber::Session;

namespace {

constexpr std::size_t kPlaces = 24;
constexpr int kFrames = 200;
constexpr double kStep_s = 0.05, kMaxAge_s = 0.26;
constexpr wire::SessionId kOther = 0xc1;

struct Model {
  explicit Model(const IndexedMesh& mesh) : baked(test::bake_mesh(mesh, 16)) {}
  BakedModel baked;
  std::unique_ptr<test::TempFile> file = test::write_model(baked);
  test::FullModel full{baked};
};

struct Counts {
  std::uint64_t free = 0, free_with_stale_pose = 0, ahead = 0, listed = 0, certified = 0,
                contacts = 0, unknown = 0, expired = 0;
};

/// A session over a ground, and what it should know of each body.
class Flight {
 public:
  Flight(const Model& ground, const Model& aircraft, std::uint64_t seed, Counts& counts)
      : ground_(ground),
        aircraft_(aircraft),
        counts_(counts),
        random_(seed),
        swarm_(ground.baked, seed, kPlaces),
        visitors_(kPlaces) {
    auto made = std::make_unique<subscriber::LocalChannel>();
    channel_ = made.get();
    for (const auto& [name, model] :
         {std::pair("ground", &ground), std::pair("aircraft", &aircraft)})
      require(made->add_model(name, std::move(ModelFile::open(model->file->path())).value()));
    session_ = std::make_unique<Session>(
        std::move(made), subscriber::SessionOptions{.lookahead_s = 0.2, .margin_m = 1});
    session_->watch_all();
    ground_id_ = session_->add_body({.name = "ground", .model = "ground"}).value();
    require(session_->place_body(ground_id_, {}));
    known_[ground_id_] = {.motion = Motion{}, .is_there = true};
  }

  /// Flies and judges a frame: what is wrong; empty: nothing.
  std::string frame(std::uint64_t number) {
    time_s_ = kStep_s * static_cast<double>(number);
    const std::vector<Session::OwnMotion> own = move();
    const Result<FrameReport> report =
        session_->update(number, time_s_, own, std::numeric_limits<double>::infinity());
    require(report.status());
    swarm_.step(kStep_s);
    return judge(report.value());
  }

 private:
  struct Visitor {
    std::optional<BodyId> id;
    std::string name;
    bool is_own = false;
  };
  struct Known {
    std::optional<Motion> motion;  // said or heard last
    double time_s = 0;             // for which
    bool is_there = false;         // at any time: it stands in its place
    bool is_own = false;
  };

  static void require(const Status& status) {
    if (status.is_ok()) return;
    std::fprintf(stderr, "%s\n", status.message().c_str());
    std::abort();
  }

  /// Bodies come and go; own ones that say where they are.
  std::vector<Session::OwnMotion> move() {
    std::vector<Session::OwnMotion> own;
    for (std::size_t i = 0; i < visitors_.size(); ++i) {
      Visitor& visitor = visitors_[i];
      const double luck = random_.unit();
      if (!visitor.id && luck < 0.5) {
        visitor.is_own = random_.below(2) == 0;
        visitor.name = "a" + std::to_string(++visits_);
        subscriber::BodyOptions body{
            .name = visitor.name, .model = "aircraft", .own = visitor.is_own};
        if (!visitor.is_own) body.max_pose_age_s = kMaxAge_s;
        visitor.id = session_->add_body(body).value();
        known_[*visitor.id] = {.motion = {}, .is_own = visitor.is_own};
      } else if (visitor.id && luck < 0.02) {
        require(session_->remove_body(*visitor.id));
        known_.erase(*visitor.id);
        visitor.id.reset();
      }
      if (!visitor.id) continue;
      Known& known = known_[*visitor.id];
      const Motion& motion = swarm_.motions[i];
      if (visitor.is_own) {
        if (random_.unit() < 0.1) continue;
        own.push_back({*visitor.id, motion});
        known.motion = motion;
        known.time_s = time_s_;
      } else if (random_.unit() < 0.3) {
        // Up to two frames late, as what was on its way is.
        const double at_s = std::max(0.0, time_s_ - kStep_s * random_.below(3));
        require(channel_->deliver({.peer = kOther,
                                   .body = visitor.name,
                                   .time_s = at_s,
                                   .pose = motion.pose,
                                   .linear_velocity_mps = motion.linear_velocity_mps,
                                   .angular_velocity_radps = motion.angular_velocity_radps}));
        known.motion = motion;
        known.time_s = at_s;
      }
    }
    return own;
  }

  /// Own ones may be as old as they like.
  [[nodiscard]] bool is_known(const Known& body) const {
    return body.motion && (body.is_there || body.is_own || time_s_ - body.time_s <= kMaxAge_s);
  }
  [[nodiscard]] Pose pose_of(const Known& body, double after_s) const {
    if (body.is_there) return {};
    return after_s < 0 ? body.motion->pose : pose_at(*body.motion, time_s_ - body.time_s + after_s);
  }
  [[nodiscard]] Answer full(bool is_ground_first, const Pose& a, const Pose& b) const {
    const TriangleTree& first = is_ground_first ? ground_.full.tree : aircraft_.full.tree;
    const TriangleTree& second = aircraft_.full.tree;
    const auto posed = pose_pair(first.grid, a, "a", second.grid, b, "b");
    require(posed.status());
    return query(first.view(), posed.value().a, second.view(), posed.value().b,
                 {.clearance = Clearance::kExact});
  }

  std::string judge(const FrameReport& report) {
    std::uint64_t free = 0, unknown = 0;
    for (auto one = known_.begin(); one != known_.end(); ++one)
      for (auto two = std::next(one); two != known_.end(); ++two) {
        const bool is_ground = one->first == ground_id_;
        const Known &a = one->second, &b = two->second;
        const std::string pair =
            std::to_string(one->first.value) + " and " + std::to_string(two->first.value) + ": ";
        if (const PairAnswer* found = report.find(one->first, two->first); found != nullptr) {
          ++counts_.listed;
          if (!found->asked) {
            if (is_certified(found->answer.status)) return pair + "certified without being asked";
            continue;
          }
          const Answer truth = full(is_ground, pose_of(a, -1), pose_of(b, -1));
          if (std::string fault = test::fault_of(found->answer, truth); !fault.empty())
            return pair + fault;
          counts_.certified += is_certified(found->answer.status) ? 1U : 0U;
          counts_.contacts += truth.pairs.empty() ? 0U : 1U;
          continue;
        }
        if (!is_known(a) || !is_known(b)) {
          ++unknown;
          counts_.expired += (a.motion && b.motion) ? 1U : 0U;
          continue;
        }
        ++free;
        const bool is_late = (!a.is_there && a.time_s < time_s_) || b.time_s < time_s_;
        counts_.free_with_stale_pose += is_late ? 1U : 0U;
        const Answer truth = full(is_ground, pose_of(a, -1), pose_of(b, -1));
        if (truth.status != AnswerStatus::kFree)
          return pair + "free by bounds, but the full meshes say " + to_string(truth.status);
        if (report.free_by_bounds.clearance_m > truth.clearance_m)
          return pair + "a clearance of " + std::to_string(report.free_by_bounds.clearance_m) +
                 " m was said, the full meshes have " + std::to_string(truth.clearance_m);
        if (random_.below(8) != 0) continue;
        const double after_s = random_.unit() * report.free_by_bounds.horizon_s;
        if (full(is_ground, pose_of(a, after_s), pose_of(b, after_s)).status != AnswerStatus::kFree)
          return pair + "not free after " + std::to_string(after_s) + " s of a horizon of " +
                 std::to_string(report.free_by_bounds.horizon_s);
        ++counts_.ahead;
      }
    counts_.free += free;
    counts_.unknown += unknown;
    if (report.free_by_bounds.pairs != free)
      return std::to_string(report.free_by_bounds.pairs) + " pairs were said to be free, " +
             std::to_string(free) + " are known and not listed";
    if (report.unknown_pairs != unknown)
      return std::to_string(report.unknown_pairs) + " pairs were said to be unknown, not " +
             std::to_string(unknown);
    if (unknown > 0 && report.all_certified()) return "all is certified though bodies are unknown";
    return {};
  }

  const Model &ground_, &aircraft_;
  Counts& counts_;
  Random random_;
  test::Swarm swarm_;
  std::vector<Visitor> visitors_;
  std::uint64_t visits_ = 0;
  subscriber::LocalChannel* channel_ = nullptr;
  std::unique_ptr<Session> session_;
  BodyId ground_id_;
  std::map<BodyId, Known> known_;
  double time_s_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  std::uint64_t wanted = 1'000'000, seed = 1;
  CLI::App app{"Pairs that are free by bounds against the full meshes"};
  app.add_option("--pair-frames", wanted, "Pairs that are free by bounds, at least")
      ->capture_default_str();
  app.add_option("--seed", seed, "Of the flights")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const Model ground(generate_terrain(40, 7)), aircraft(generate_aircraft(500, 7));
  Counts counts;
  for (std::uint64_t flight = 0; counts.free < wanted; ++flight) {
    Flight flown(ground, aircraft, seed * 1'000'003 + flight, counts);
    for (int frame = 0; frame < kFrames; ++frame)
      if (const std::string fault = flown.frame(static_cast<std::uint64_t>(frame));
          !fault.empty()) {
        std::printf("seed %" PRIu64 ", flight %" PRIu64 ", frame %d: bodies %s\n", seed, flight,
                    frame, fault.c_str());
        return 1;
      }
  }
  std::printf("%" PRIu64 " pair-frames free by bounds, all free of the full meshes (%" PRIu64
              " rest on a pose of before, %" PRIu64 " were looked at ahead too); %" PRIu64
              " listed, of which %" PRIu64 " certified and %" PRIu64 " touch; %" PRIu64
              " unknown, of which %" PRIu64 " by a stale pose\n",
              counts.free, counts.free_with_stale_pose, counts.ahead, counts.listed,
              counts.certified, counts.contacts, counts.unknown, counts.expired);
  // Else it has shown nothing.
  return counts.free_with_stale_pose > counts.free / 10 && counts.expired > counts.free / 50 &&
                 counts.ahead > counts.free / 16 && counts.contacts > counts.free / 1000
             ? 0
             : 1;
}
