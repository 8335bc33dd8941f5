// SPDX-License-Identifier: Apache-2.0
// What many bodies cost, as CSV rows: what,bodies,tiles,median_us,mean_us,p99_us,worst_us,near.
// Thread CPU time, one thread.
//   broad    the broad phase alone: bodies as boxes that fly, turn and bounce over a square of
//            100 km, tiles below them
//   fcl      FCL's dynamic AABB tree on the same boxes, in the same run (where it is installed)
//   session  Session::update() of one peer that moves all bodies, 20 Hz, everything that a default
//            session does
//   crowd1, crowd2  the same of bodies that are all near each other, on one thread and on two; wall
//            clock
//   budget1, budget2  60 bodies that fly through each other, with sweeps, contacts and look-ahead,
//            and a budget of 8 and of 2 ms; wall clock. From the first frame on: nothing is held
//            then. Then the same with depth. The publisher has a thread of its own.
//   ..._over, ..._over_cpu  by how much these frames overran their budgets, by the wall clock and
//            by this thread's processor time: where the former is more, the system had given the
//            processor to others. With two threads part of the work is the other one's.
//   fans     two fans of that many faces, tip to tip, so that each face touches each: a query with
//            a session's max_tests, wall clock, and what that takes of memory. By itself, or the
//            memory is that of what was before.
// With "broad" (and fcl), "session", "crowd", "budget" or "fans" those rows alone. "stream WORLD
// [FRAMES]" is another table: a flight, of 200 frames without a number, low over a world on disk
// (world_stream.hpp), and so is "low WORLD [FRAMES]": updates of 100 aircraft that fly low over it.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <ctime>
#include <deque>
#include <map>
#include <numbers>
#include <numeric>
#include <thread>

#include "core/base/random.hpp"
#include "core/base/resources.hpp"
#include "core/broadphase/broad_phase.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "test_models.hpp"
#include "traffic.hpp"
#include "world_stream.hpp"

#ifdef NEARMESH_PEER_FCL_CROWD
#include "box_crowd.hpp"
#endif

namespace {

using namespace nearmesh;
using test::kSide_m;
using test::kStep_s;
using test::Traffic;

constexpr double kLookahead_s = 0.5, kRadius_m = 44;
constexpr int kFrames = 400;

double cpu_s() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

WorldBox around(const Motion& motion, double duration_s) {
  const auto& v = motion.linear_velocity_mps;
  const double reach_m = kRadius_m + std::hypot(v[0], v[1], v[2]) * duration_s;
  WorldBox box;
  for (std::size_t k = 0; k < 3; ++k) {
    box.lo_m[k] = motion.pose.translation_m[k] - reach_m;
    box.hi_m[k] = motion.pose.translation_m[k] + reach_m;
  }
  return box;
}

std::vector<WorldBox> make_tiles(std::size_t count) {
  std::vector<WorldBox> tiles;
  const auto side = static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(count))));
  const double edge_m = kSide_m / static_cast<double>(std::max<std::size_t>(1, side));
  for (std::size_t i = 0; i < side; ++i)
    for (std::size_t j = 0; j < side; ++j) {
      const double x = static_cast<double>(i) * edge_m, y = static_cast<double>(j) * edge_m;
      tiles.push_back({{x, y, -200}, {x + edge_m, y + edge_m, 150}});
    }
  return tiles;
}

/// A row. In: microseconds.
void print_row(const std::string& what, std::size_t bodies, std::size_t tiles,
               std::vector<double> us, double near) {
  std::sort(us.begin(), us.end());
  const auto count = static_cast<double>(us.size());
  std::printf("%s,%zu,%zu,%.1f,%.1f,%.1f,%.1f,%.1f\n", what.c_str(), bodies, tiles,
              us[us.size() / 2], std::accumulate(us.begin(), us.end(), 0.0) / count,
              us[us.size() * 99 / 100], us.back(), near);
  std::fflush(stdout);
}

/// Calls frame() so often, and prints what it took and how much was near.
template <class Frame>
void measure(const std::string& what, std::size_t bodies, std::size_t tiles, int frames,
             const Frame& frame) {
  std::vector<double> us;
  double near = 0;
  for (int i = 0; i <= frames; ++i) {
    double spent_s = 0;
    const std::size_t found = frame(spent_s);
    if (i == 0) continue;  // builds the trees
    us.push_back(spent_s * 1e6);
    near += static_cast<double>(found);
  }
  const auto count = static_cast<double>(us.size());
  print_row(what, bodies, tiles, std::move(us), near / count);
}

void run_broad(std::size_t bodies, std::size_t tile_count) {
  const std::vector<WorldBox> tiles = make_tiles(tile_count);
  BroadPhase broad;
  for (const WorldBox& tile : tiles)
    broad.place(broad.add({.is_scenery = true}), tile, [&] { return tile; });
  std::vector<BroadPhase::Slot> slots;
  for (std::size_t i = 0; i < bodies; ++i) slots.push_back(broad.add({}));
  Traffic traffic(7, bodies);
  measure("broad", bodies, tiles.size(), kFrames, [&](double& spent_s) {
    traffic.step();
    const double start_s = cpu_s();
    for (std::size_t i = 0; i < bodies; ++i) {
      const Motion& motion = traffic.motions[i];
      const WorldBox box = around(motion, kLookahead_s);
      broad.place(slots[i], box, [&] {
        const double duration_s = roam_s(i);
        std::array<double, 3> way_m = motion.linear_velocity_mps;
        for (double& way : way_m) way *= duration_s;
        return roam_along(box, way_m, kRoamAside * std::hypot(way_m[0], way_m[1], way_m[2]));
      });
    }
    const std::size_t near = broad.find_near().size();
    spent_s = cpu_s() - start_s;
    return near;
  });
}

#ifdef NEARMESH_PEER_FCL_CROWD
void run_fcl(std::size_t bodies, std::size_t tile_count) {
  Traffic traffic(7, bodies);
  std::vector<WorldBox> boxes(bodies);
  const auto set_boxes = [&] {
    for (std::size_t i = 0; i < bodies; ++i) boxes[i] = around(traffic.motions[i], kLookahead_s);
  };
  set_boxes();
  const auto crowd = peers::make_fcl_crowd(make_tiles(tile_count), boxes);
  measure("fcl", bodies, tile_count, bodies > 3000 ? 40 : kFrames, [&](double& spent_s) {
    traffic.step();
    const double start_s = cpu_s();
    set_boxes();
    const std::size_t near = crowd->count_near(boxes);
    spent_s = cpu_s() - start_s;
    return near;
  });
}
#endif

/// Jobs on this thread and on one more.
void run_on_two(std::size_t count, const std::function<void(std::size_t)>& job) {
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) job(i);
  };
  std::thread other(work);
  work();
  other.join();
}

double wall_s() {
  timespec t{};
  ::clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

/// Bodies that turn in their places, some 40 m from their neighbours, in a row of rows.
void run_crowd(std::size_t bodies, bool on_two) {
  const auto file = test::write_model(test::bake_mesh(generate_aircraft(20000, 7), 16));
  auto channel = std::make_unique<subscriber::LocalChannel>();
  if (!channel->add_model("aircraft", std::move(ModelFile::open(file->path())).value()).is_ok())
    return;
  subscriber::SessionOptions options{.margin_m = 500};
  if (on_two) options.run_jobs = run_on_two;
  subscriber::Session session(std::move(channel), options);
  session.watch_all();
  std::vector<subscriber::Session::OwnMotion> own;
  Random random(3);
  for (std::size_t i = 0; i < bodies; ++i) {
    const auto id =
        session.add_body({.name = "a" + std::to_string(i), .model = "aircraft", .own = true});
    Motion motion;
    motion.pose.rotation = test::random_rotation(random);
    motion.pose.translation_m = {40.0 * static_cast<double>(i % 6),
                                 40.0 * static_cast<double>(i / 6), 0};
    motion.angular_velocity_radps = {random.between(-1, 1), random.between(-1, 1), 0};
    own.push_back({id.value(), motion});
  }
  std::uint64_t frame = 0;
  measure(on_two ? "crowd2" : "crowd1", bodies, 0, kFrames, [&](double& spent_s) {
    for (auto& [id, motion] : own) motion.pose = pose_at(motion, kStep_s);
    const double start_s = wall_s();
    const auto report = session.update(frame, static_cast<double>(frame) * kStep_s, own, 0.01);
    spent_s = wall_s() - start_s;
    ++frame;
    return report.value().answers.size();
  });
}

/// A LocalChannel whose publisher works on a thread of its own, as it does in a program of its own:
/// over DDS a frame pays for none of that.
class ApartChannel final : public subscriber::Channel {
 public:
  explicit ApartChannel(std::unique_ptr<subscriber::LocalChannel> inner)
      : inner_(std::move(inner)),
        own_id_(inner_->own_id()),
        thread_([this](const std::stop_token& stop) { serve(stop); }) {}
  [[nodiscard]] wire::SessionId own_id() const override { return own_id_; }
  void send(const wire::RegionSubscription& request) override {
    {
      const std::lock_guard lock(mutex_);
      requests_.push_back(request);
    }
    asked_.notify_one();
  }
  void send(const wire::BodyPoses&) override {}
  void send(const wire::BodyDirectory&) override {}
  void send(const wire::ContactReport&) override {}
  [[nodiscard]] Inbox take() override {
    const std::lock_guard lock(mutex_);
    Inbox taken;
    if (!inboxes_.empty()) {
      taken = std::move(inboxes_.front());
      inboxes_.pop_front();
    }
    return taken;
  }

 private:
  void serve(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    for (bool is_first = true; !stop.stop_requested(); is_first = false) {
      std::deque<wire::RegionSubscription> requests = std::exchange(requests_, {});
      lock.unlock();
      inner_->allow(1);
      for (const wire::RegionSubscription& request : requests) inner_->send(request);
      Inbox inbox = inner_->take();
      lock.lock();
      if (is_first || !requests.empty()) inboxes_.push_back(std::move(inbox));
      asked_.wait(lock, stop, [this] { return !requests_.empty(); });
    }
  }

  std::unique_ptr<subscriber::LocalChannel> inner_;  // the thread's
  const wire::SessionId own_id_;
  std::mutex mutex_;
  std::condition_variable_any asked_;
  std::deque<wire::RegionSubscription> requests_;
  std::deque<Inbox> inboxes_;
  std::jthread thread_;  // the last: it uses the others
};

/// Bodies that fly to and fro in a box, through each other, with a budget.
void run_budget(std::size_t bodies, double budget_s, bool on_two, bool with_depth) {
  const auto file = test::write_model(test::bake_mesh(generate_aircraft(20000, 7), 16));
  auto channel = std::make_unique<subscriber::LocalChannel>();
  if (!channel->add_model("aircraft", std::move(ModelFile::open(file->path())).value()).is_ok())
    return;
  subscriber::SessionOptions options{.sweep_s = 0.5,
                                     .contacts = true,
                                     .depth = with_depth,
                                     .max_sweep_tests = 2'500,
                                     .max_depth_tests = 50'000};
  if (on_two) options.run_jobs = run_on_two;
  subscriber::Session session(std::make_unique<ApartChannel>(std::move(channel)), options);
  session.watch_all();
  std::vector<subscriber::Session::OwnMotion> own;
  Random random(3);
  constexpr double kBox_m = 150;
  for (std::size_t i = 0; i < bodies; ++i) {
    const auto id =
        session.add_body({.name = "a" + std::to_string(i), .model = "aircraft", .own = true});
    Motion motion;
    motion.pose.rotation = test::random_rotation(random);
    for (std::size_t k = 0; k < 3; ++k) {
      motion.pose.translation_m[k] = random.between(0, kBox_m);
      motion.linear_velocity_mps[k] = random.between(-20, 20);
      motion.angular_velocity_radps[k] = random.between(-1, 1);
    }
    own.push_back({id.value(), motion});
  }
  std::uint64_t asked = 0, ended = 0, listed = 0, certified = 0, longest = 0, deep = 0;
  std::vector<double> us, over_us, over_cpu_us;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint64_t> waits;
  for (std::uint64_t frame = 0; frame <= kFrames; ++frame) {
    for (auto& [id, motion] : own) {
      motion.pose = pose_at(motion, kStep_s);
      for (std::size_t k = 0; k < 3; ++k)
        if (motion.pose.translation_m[k] < 0 || motion.pose.translation_m[k] > kBox_m)
          motion.linear_velocity_mps[k] = std::copysign(motion.linear_velocity_mps[k],
                                                        kBox_m / 2 - motion.pose.translation_m[k]);
    }
    const double start_s = wall_s(), start_cpu_s = cpu_s();
    const auto report = session.update(frame, static_cast<double>(frame) * kStep_s, own, budget_s);
    const double spent_cpu_s = cpu_s() - start_cpu_s, spent_s = wall_s() - start_s;
    us.push_back(spent_s * 1e6);
    over_us.push_back(std::max(0.0, spent_s - budget_s) * 1e6);
    over_cpu_us.push_back(std::max(0.0, spent_cpu_s - budget_s) * 1e6);
    listed += report.value().answers.size();
    for (const auto& answer : report.value().answers) {
      asked += answer.asked ? 1U : 0U;
      deep += answer.depth ? 1U : 0U;
      ended += answer.swept && answer.swept->exhausted ? 1U : 0U;
      certified += is_certified(answer.answer.status) ? 1U : 0U;
      std::uint64_t& wait = waits[{answer.a.value, answer.b.value}];
      wait = answer.asked ? 0 : wait + 1;
      longest = std::max(longest, wait);
    }
  }
  const double near = static_cast<double>(listed) / static_cast<double>(us.size());
  const std::string what =
      std::string(on_two ? "budget2" : "budget1") + (with_depth ? "_depth" : "");
  print_row(what, bodies, 0, us, near);
  print_row(what + "_over", bodies, 0, over_us, near);
  print_row(what + "_over_cpu", bodies, 0, over_cpu_us, near);
  std::printf(
      "# budget %.1f ms: %llu of %llu pairs asked, %llu certified, %llu with a depth, %llu sweeps "
      "ended by their tests; longest wait %llu frames\n",
      budget_s * 1e3, static_cast<unsigned long long>(asked),
      static_cast<unsigned long long>(listed), static_cast<unsigned long long>(certified),
      static_cast<unsigned long long>(deep), static_cast<unsigned long long>(ended),
      static_cast<unsigned long long>(longest));
}

IndexedMesh make_fan(std::uint32_t faces, double height_m) {
  IndexedMesh fan;
  fan.positions_m.push_back({0, 0, 0});
  for (std::uint32_t i = 0; i < faces; ++i) {
    const double angle = 2 * std::numbers::pi * i / faces;
    fan.positions_m.push_back({std::cos(angle), std::sin(angle), height_m});
    fan.faces.push_back({0, 1 + i, 1 + (i + 1) % faces});
  }
  return fan;
}

void run_fans(std::uint32_t faces) {
  const BakedModel up = test::bake_mesh(make_fan(faces, 1)),
                   down = test::bake_mesh(make_fan(faces, -1));
  LocalModel a(up.store, up.header.grid), b(down.store, down.header.grid);
  const PosedPair posed = pose_pair(a.grid, {}, "a", b.grid, {}, "b").value();
  const QueryOptions options{.max_tests = subscriber::SessionOptions{}.max_tests};
  const Require all = [](NodeSpan) { return Status::ok(); };
  const std::uint64_t before = resident_memory_bytes();
  CertifyTimes times;
  const double start_s = wall_s();
  static_cast<void>(certify(a, posed.a, all, b, posed.b, all, options, &times));
  const double certify_s = wall_s() - start_s;
  std::size_t found = 0;
  measure("fans", faces, 0, 20, [&](double& spent_s) {
    const double begin_s = wall_s();
    found = query(a.view(), posed.a, b.view(), posed.b, options).pairs.size();
    spent_s = wall_s() - begin_s;
    return found;
  });
  std::printf(
      "# fans: %zu of %.0f pairs found; certify gave up after %u rounds, %.1f ms; %.1f MB\n", found,
      static_cast<double>(faces) * faces, times.rounds, certify_s * 1e3,
      static_cast<double>(peak_memory_bytes() - before) / 1e6);
}

void run_session(std::size_t bodies) {
  const auto file = test::write_model(test::bake_mesh(generate_aircraft(2000, 7), 16));
  auto channel = std::make_unique<subscriber::LocalChannel>();
  if (!channel->add_model("aircraft", std::move(ModelFile::open(file->path())).value()).is_ok())
    return;
  subscriber::Session session(std::move(channel));
  session.watch_all();
  std::vector<subscriber::Session::OwnMotion> own;
  for (std::size_t i = 0; i < bodies; ++i)
    own.push_back(
        {session.add_body({.name = "a" + std::to_string(i), .model = "aircraft", .own = true})
             .value(),
         {}});
  Traffic traffic(7, bodies);
  std::uint64_t frame = 0, uncertain = 0;
  measure("session", bodies, 0, kFrames, [&](double& spent_s) {
    traffic.step();
    for (std::size_t i = 0; i < bodies; ++i) own[i].motion = traffic.motions[i];
    const double start_s = cpu_s();
    const auto report = session.update(frame, static_cast<double>(frame) * kStep_s, own, 0.01);
    spent_s = cpu_s() - start_s;
    ++frame;
    uncertain += report.value().all_certified() ? 0U : 1U;
    return report.value().answers.size();
  });
  std::printf("# session of %zu bodies: %llu of %d frames with an answer that is not certified\n",
              bodies, static_cast<unsigned long long>(uncertain), kFrames + 1);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc >= 3 && std::string(argv[1]) == "stream")
    return run_stream(argv[2], argc > 3 ? std::atoi(argv[3]) : 200) ? 0 : 1;
  if (argc >= 3 && std::string(argv[1]) == "low")
    return run_low(argv[2], argc > 3 ? std::atoi(argv[3]) : 80) ? 0 : 1;
  if (argc >= 3 && std::string(argv[1]) == "memory") return run_memory(argv[2]) ? 0 : 1;
  std::printf("what,bodies,tiles,median_us,mean_us,p99_us,worst_us,near\n");
  const auto wants = [only = std::string(argc > 1 ? argv[1] : "")](const char* what) {
    return only.empty() || only == what;
  };
  if (wants("budget"))
    for (const bool with_depth : {false, true})
      for (const double budget_s : {0.008, 0.002})
        for (const bool on_two : {false, true}) run_budget(60, budget_s, on_two, with_depth);
  if (wants("fans")) run_fans(20000);
  if (wants("broad"))
    for (const auto& [bodies, tiles] :
         {std::pair<std::size_t, std::size_t>{1000, 0}, {10000, 0}, {1000, 10000}}) {
      run_broad(bodies, tiles);
#ifdef NEARMESH_PEER_FCL_CROWD
      run_fcl(bodies, tiles);
#endif
    }
  if (wants("session"))
    for (const std::size_t bodies : {100U, 1000U, 10000U}) run_session(bodies);
  if (wants("crowd"))
    for (const std::size_t bodies : {18U, 36U})
      for (const bool on_two : {false, true}) run_crowd(bodies, on_two);
}
