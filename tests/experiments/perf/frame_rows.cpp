// SPDX-License-Identifier: Apache-2.0
#include "frame_rows.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <utility>

#include "core/demand/answer.hpp"
#include "nearmesh/core/query/probe.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "test_models.hpp"

namespace nearmesh::perf {
namespace {

using subscriber::LocalChannel;
using subscriber::Session;

constexpr double kSpeed_mps = 60, kTurn_radps = 0.04;
/// As long as the look-ahead: the detail of the first poses is there then.
constexpr double kWarm_s = 0.5;

/// Of this thread: what others do on the machine is not in it.
double cpu_s() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

// ---- scenes -------------------------------------------------------------------------------------

struct FrameScene {
  std::string name;
  const Model* ground;  // in place; none: null
  const Model& mover;
  std::size_t movers;
  std::function<Pose(std::size_t mover, double time_s)> pose_at;
  bool is_by_name = false;  // all pairs are watched by name, near or not; else by watch_all()
};

/// Heights of a terrain below points of it, by its full tree.
double height_m(const Model& terrain, double x, double y) {
  const RayProbe ray{.origin_m = {x, y, 1e4}};
  RayAnswer answer;
  static_cast<void>(probe(terrain.tree.view(), Pose{}, {&ray, 1}, {&answer, 1}).value());
  return 1e4 - answer.distance_m();
}

/// Low over the ground, up and down, along a slow turn: one aircraft above `along` and `aside` of
/// the first.
Pose flown(const Model& terrain, double along_m, double aside_m, double phase, double low_m,
           double high_m, double time_s) {
  const double heading = kTurn_radps * time_s, c = std::cos(heading), s = std::sin(heading);
  const double radius_m = kSpeed_mps / kTurn_radps;
  const double x = along_m + radius_m * s, y = aside_m + radius_m * (1 - c);
  const double share = 0.5 + 0.5 * std::sin(2 * time_s + phase);
  return {.rotation = {c, -s, 0, s, c, 0, 0, 0, 1},
          .translation_m = {x, y, height_m(terrain, x, y) + low_m + share * (high_m - low_m)}};
}

/// In a square, or one behind the other.
FrameScene flight_of(const std::string& name, const Model& terrain, const Model& aircraft,
                     std::size_t count, double apart_m, bool is_in_file, double low_m,
                     double high_m, bool is_by_name = false) {
  const auto side =
      is_in_file ? count
                 : static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(count))));
  const auto pose_at = [=, &terrain](std::size_t i, double time_s) {
    return flown(terrain, apart_m * static_cast<double>(i % side),
                 apart_m * static_cast<double>(i / side), 0.7 * static_cast<double>(i), low_m,
                 high_m, time_s);
  };
  return {name, &terrain, aircraft, count, pose_at, is_by_name};
}

/// The motion that leads from one frame's pose to the next one's.
Motion motion_at(const FrameScene& scene, std::size_t mover, double time_s, double step_s) {
  Motion motion{.pose = scene.pose_at(mover, time_s)};
  const Pose next = scene.pose_at(mover, time_s + step_s);
  const auto &r = motion.pose.rotation, &q = next.rotation;
  const auto turned = [&](std::size_t row,
                          std::size_t column) {  // of next.rotation by the other's transpose
    return q[3 * row] * r[3 * column] + q[3 * row + 1] * r[3 * column + 1] +
           q[3 * row + 2] * r[3 * column + 2];
  };
  for (std::size_t k = 0; k < 3; ++k) {
    motion.linear_velocity_mps[k] = (next.translation_m[k] - motion.pose.translation_m[k]) / step_s;
    const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
    motion.angular_velocity_radps[k] = (turned(j, i) - turned(i, j)) / 2 / step_s;
  }
  return motion;
}

// ---- channel ------------------------------------------------------------------------------------

/// A LocalChannel that tells its publisher's time from the peer's, and may deliver all detail of a
/// model once anything of it is asked for.
class ServedChannel final : public subscriber::Channel {
 public:
  [[nodiscard]] bool serve(const std::string& name, const Model& model, bool all_detail) {
    const auto file = test::write_model(model.baked);
    Result<ModelFile> opened = ModelFile::open(file->path());
    if (!opened.is_ok() || !opened.value().require_all().is_ok()) return false;
    if (all_detail) add_all_detail(opened.value());
    return local_.add_model(name, std::move(opened).value()).is_ok();
  }
  /// Since the last call.
  [[nodiscard]] double take_publisher_s() { return std::exchange(publisher_s_, 0); }

  [[nodiscard]] wire::SessionId own_id() const override { return local_.own_id(); }
  void send(const wire::RegionSubscription& subscription) override {
    if (subscription.certificate) {
      for (const auto& model : subscription.certificate->models)
        deliver_detail(model.content, subscription.publisher);
    } else {
      deliver_detail(subscription.content_hash, subscription.publisher);
    }
    const double begun_s = cpu_s();
    local_.send(subscription);
    publisher_s_ += cpu_s() - begun_s;
  }
  void send(const wire::BodyPoses& poses) override { local_.send(poses); }
  void send(const wire::BodyDirectory& directory) override { local_.send(directory); }
  void send(const wire::ContactReport& report) override { local_.send(report); }
  [[nodiscard]] Inbox take() override {
    Inbox inbox = local_.take();
    std::move(delivered_.begin(), delivered_.end(), std::back_inserter(inbox.batches));
    delivered_.clear();
    return inbox;
  }

 private:
  void add_all_detail(ModelFile& file) {
    const SplitStore& store = file.store();
    RegionRequest request{.max_splits = std::numeric_limits<std::uint32_t>::max()};
    GridBox all;
    for (const BaseRoot& root : store.roots()) {
      if (root.node.size > 1) request.attach.push_back(root.node);
      all.add(store.box(root.node));
    }
    request.region = {all};
    auto batches = answer_request(file.header(), store, request,
                                  [&file](NodeSpan node) { return file.require(node); });
    detail_[file.content_hash()] =
        wire::answer_messages(0, 0, file.content_hash(), std::move(batches).value(), true);
  }
  void deliver_detail(const ContentHash& content, wire::SessionId publisher) {
    auto messages = detail_.extract(content);
    if (messages.empty()) return;
    for (wire::SplitBatchMessage& message : messages.mapped()) {
      message.publisher = publisher;
      delivered_.push_back(std::move(message));
    }
  }

  LocalChannel local_;
  std::map<ContentHash, std::vector<wire::SplitBatchMessage>> detail_;  // not yet asked for
  std::vector<wire::SplitBatchMessage> delivered_;
  double publisher_s_ = 0;
};

// ---- frames -------------------------------------------------------------------------------------

struct Frames {
  std::vector<double> us;  ///< without the publisher's time
  double publisher_us = 0;
  /// Answers, in all frames; the last two without a query, and with a contact.
  double pairs = 0, certified = 0, spared = 0, touching = 0;
};

void fly(const FrameScene& scene, int rate_hz, bool all_detail, Report& report) {
  const std::string name =
      scene.name + "/" + std::to_string(rate_hz) + "hz/" + (all_detail ? "full" : "least");
  std::fprintf(stderr, "%s\n", name.c_str());
  auto made = std::make_unique<ServedChannel>();
  ServedChannel& channel = *made;
  if ((scene.ground != nullptr && !channel.serve("ground", *scene.ground, all_detail)) ||
      !channel.serve("mover", scene.mover, all_detail)) {
    std::fprintf(stderr, "%s: a model cannot be served\n", name.c_str());
    return;
  }
  Session session(std::move(made));
  std::vector<subscriber::BodyId> bodies;
  if (scene.ground != nullptr) {
    bodies.push_back(session.add_body({.name = "ground", .model = "ground"}).value());
    static_cast<void>(session.place_body(bodies.back(), Pose{}));
  }
  std::vector<Session::OwnMotion> own;
  for (std::size_t i = 0; i < scene.movers; ++i) {
    bodies.push_back(
        session.add_body({.name = "m" + std::to_string(i), .model = "mover", .own = true}).value());
    own.push_back({bodies.back(), {}});
  }
  if (scene.is_by_name) {
    for (std::size_t i = 0; i < bodies.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) static_cast<void>(session.watch(bodies[j], bodies[i]));
  } else {
    session.watch_all();
  }
  const double step_s = 1.0 / rate_hz;
  const int warm = static_cast<int>(kWarm_s * rate_hz), count = rate_hz < 100 ? 200 : 500;
  Frames frames;
  for (int frame = -warm; frame < count; ++frame) {
    const double time_s = (frame + warm) * step_s;
    for (std::size_t i = 0; i < own.size(); ++i)
      own[i].motion = motion_at(scene, i, time_s, step_s);
    const double begun_s = cpu_s();
    const auto done = session.update(static_cast<std::uint64_t>(frame + warm), time_s, own,
                                     std::numeric_limits<double>::infinity());
    const double spent_s = cpu_s() - begun_s, publisher_s = channel.take_publisher_s();
    if (!done.is_ok()) {
      std::fprintf(stderr, "%s: %s\n", name.c_str(), done.status().message().c_str());
      return;
    }
    if (frame < 0) continue;
    frames.us.push_back((spent_s - publisher_s) * 1e6);
    frames.publisher_us += publisher_s * 1e6;
    for (const auto& answer : done.value().answers) {
      ++frames.pairs;
      frames.certified += is_certified(answer.answer.status) ? 1 : 0;
      frames.spared += answer.asked && answer.answer.stats.box_tests == 0 ? 1 : 0;
      frames.touching += answer.answer.pair_total > 0 ? 1 : 0;
    }
  }
  const auto measured = static_cast<double>(frames.us.size());
  const auto add = [&](const char* metric, double value, const char* unit) {
    report.add(name, kUnderTest, metric, value, unit, 0);
  };
  add("mean", std::accumulate(frames.us.begin(), frames.us.end(), 0.0) / measured, "us");
  add("median", quantile(frames.us, 0.5), "us");
  add("p99", quantile(frames.us, 0.99), "us");
  add("worst", *std::max_element(frames.us.begin(), frames.us.end()), "us");
  add("publisher", frames.publisher_us / measured, "us");
  add("pairs", frames.pairs / measured, "pairs");
  add("spared", frames.spared / measured, "pairs");
  add("touching", frames.touching / measured, "pairs");
  add("certified", frames.pairs > 0 ? frames.certified / frames.pairs : 1, "share");
  add("held", static_cast<double>(session.stats().held_splits), "splits");
}

}  // namespace

void time_flights(const Model& terrain, const Model& aircraft, Report& report) {
  constexpr double kApart_m = 100, kLow_m = 0, kHigh_m = 15;
  fly(flight_of("touching", terrain, aircraft, 1, 0, false, 1, 1), 1000, false, report);
  fly(flight_of("named_100m", terrain, aircraft, 40, kApart_m, false, kLow_m, kHigh_m, true), 100,
      false, report);
  fly(flight_of("named_15m", terrain, aircraft, 40, 15, true, kLow_m, kHigh_m, true), 100, false,
      report);
  FrameScene lying = flight_of("lying_40", terrain, aircraft, 40, kApart_m, false, 0, 1);
  lying.pose_at = [fly_at = lying.pose_at](std::size_t i, double /*time_s*/) {
    return fly_at(i, 0);
  };
  fly(lying, 100, false, report);
  for (const std::size_t count : {1U, 16U, 40U, 200U}) {
    const FrameScene scene = flight_of("flight_" + std::to_string(count), terrain, aircraft, count,
                                       kApart_m, false, kLow_m, kHigh_m);
    for (const int rate_hz : {20, 100, 1000})
      for (const bool all_detail : {false, true}) fly(scene, rate_hz, all_detail, report);
  }
}

void time_near_miss(const std::string& name, const Model& model, Report& report) {
  const std::vector<PoseSet> sets = distances(model, model, 1);
  const auto poses_of = [&](const char* wanted) {
    return std::find_if(sets.begin(), sets.end(),
                        [&](const PoseSet& set) { return set.name == wanted; })
        ->poses.front();
  };
  const PosePair near = poses_of("near_miss");
  std::array<double, 3> away = poses_of("apart_2").b.translation_m;
  double length_m = 0, size_m = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    away[k] -= near.b.translation_m[k];
    length_m += away[k] * away[k];
  }
  length_m = std::sqrt(length_m);
  for (const auto& p : model.mesh.positions_m)
    for (std::size_t k = 0; k < 3; ++k)
      size_m = std::max(size_m, std::abs(p[k] - model.mesh.positions_m.front()[k]));
  constexpr int kRate_hz = 100;
  const auto pose_at = [&](std::size_t mover, double time_s) {
    if (mover == 0) return near.a;
    Pose pose = near.b;
    const double frames = std::fmod(time_s * kRate_hz, 100), out = std::min(frames, 100 - frames);
    for (std::size_t k = 0; k < 3; ++k)
      pose.translation_m[k] += 1e-4 * size_m * out / length_m * away[k];
    return pose;
  };
  fly({name, nullptr, model, 2, pose_at}, kRate_hz, false, report);
}

}  // namespace nearmesh::perf
