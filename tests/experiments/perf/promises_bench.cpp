// SPDX-License-Identifier: Apache-2.0
// What peers of a large world hear of each other's bodies, with promises and without.
//   count [PEERS [BODIES]]  by count: PEERS (100) sessions of BODIES (10) bodies each, over a
//         square of 100 km, with the product's own sessions, broad phase and codec on a bus in
//         memory; each sample with the bytes of its headers on UDP. CSV:
//         what,samples_per_s,bytes_per_s, of what each peer hears.
//   fly [PEERS [BODIES [SECONDS]]]  live: PEERS (8) processes on loopback, best in a network
//         namespace of their own. CSV:
//         kind,bodies,bytes_per_s,payload_per_s,core_percent,sent,heard,lost: of each peer; lost of
//         all, of samples that were sent to it.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "nearmesh/idl/dds/payload.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "test_models.hpp"
#include "traffic.hpp"

namespace {

using namespace nearmesh;
using subscriber::BodyId;
using subscriber::Session;
using test::bake_mesh;
using test::kSpeed_mps;
using test::kStep_s;
using test::TempFile;
using test::Traffic;
using test::write_model;

/// Of a sample on UDP: Ethernet, IP, UDP, RTPS header, time stamp, data submessage.
constexpr double kHeaders = 14 + 28 + 20 + 12 + 24;
/// Of a reliable one also the heartbeat that follows; acknowledgements go the other way.
constexpr double kHeartbeat = 14 + 28 + 20 + 16 + 32;

/// What one kind of sample takes of a hearer.
struct Heard {
  double samples = 0, bytes = 0;
  void add(std::size_t payload, double more, double hearers = 1) {
    samples += hearers;
    bytes += hearers * (static_cast<double>(payload) + more);
  }
};

/// All peers, in one process; everybody hears everything at once.
struct Town {
  struct Peer;
  std::vector<Peer*> peers;
  Heard poses, near, wanted, promises;
  bool is_counted = false;

  template <class Message>
  void count(Heard& of, const Message& message, double hearers, bool is_reliable) const {
    if (is_counted)
      of.add(wire::encode_payload(message).size(), kHeaders + (is_reliable ? kHeartbeat : 0),
             hearers);
  }
};

struct Town::Peer : subscriber::Channel {
  Peer(Town& of, std::size_t at) : town(of), place(at) {}
  [[nodiscard]] wire::SessionId own_id() const override { return place + 1; }
  void send(const wire::RegionSubscription& subscription) override { local.send(subscription); }
  void send(const wire::ContactReport&) override {}
  void allow(double budget_s) override { local.allow(budget_s); }
  void send(const wire::BodyDirectory& directory) override {
    for (const auto& body : directory.bodies) {
      told.resize(std::max<std::size_t>(told.size(), body.number + 1));
      told[body.number] = body;
    }
  }
  void send(const wire::BodyPoses& poses) override {
    town.count(town.poses, poses, static_cast<double>(town.peers.size() - 1), true);
    for (Peer* other : town.peers)
      if (other != this) hand(*other, poses);
  }
  void send_near(const wire::NearPoses& poses) override {
    for (Peer* other : town.peers) {
      const auto wish = wishes.find(other->own_id());
      if (wish == wishes.end()) continue;
      bool is_wanted = false;
      for (const auto& body : poses.bodies) is_wanted |= wish->second.wants(body.number);
      if (!is_wanted) continue;
      town.count(town.near, poses, 1, false);
      hand(*other, poses);
    }
  }
  void promise(const wire::BodyPromises& promises) override {
    town.count(town.promises, promises, static_cast<double>(town.peers.size() - 1), true);
    for (Peer* other : town.peers)
      if (other != this)
        for (const auto& body : promises.bodies) {
          if (other->met_bodies.insert(told[body.number].name).second)
            other->inbox.bodies.push_back({told[body.number], false});
          other->inbox.promises.push_back(wire::promise_of(promises, body, told[body.number]));
        }
  }
  void want(const wire::WantedPoses& wanted) override {
    town.count(town.wanted, wanted, 1, false);
    Peer& mover = *town.peers.at(wanted.mover - 1);
    mover.wishes[wanted.peer] = wanted;
    mover.inbox.wanted.push_back(wanted);
  }
  void hand(Peer& to, const wire::BodyPoses& poses) const {
    for (const auto& body : poses.bodies)
      if (to.met_bodies.insert(told[body.number].name).second)
        to.inbox.bodies.push_back({told[body.number], false});
    for (const auto& body : poses.bodies)
      to.inbox.poses.push_back({.peer = own_id(),
                                .body = told[body.number].name,
                                .frame = poses.frame,
                                .time_s = body.time_s,
                                .pose = body.motion.pose,
                                .linear_velocity_mps = body.motion.linear_velocity_mps,
                                .angular_velocity_radps = body.motion.angular_velocity_radps});
  }
  Inbox take() override {
    Inbox all = local.take();
    all.bodies = std::exchange(inbox.bodies, {});
    all.poses = std::exchange(inbox.poses, {});
    all.promises = std::exchange(inbox.promises, {});
    all.wanted = std::exchange(inbox.wanted, {});
    return all;
  }

  Town& town;
  const std::size_t place;
  subscriber::LocalChannel local;
  std::vector<wire::BodyDirectory::Body> told;
  std::map<wire::SessionId, wire::WantedPoses> wishes;
  std::set<std::string> met_bodies;
  Inbox inbox;
};

double cpu_s() {
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_usec) * 1e-6;
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

const BakedModel& model() {
  static const BakedModel baked = bake_mesh(generate_aircraft(500, 7), 16);
  return baked;
}

std::string name_of(std::size_t peer, std::size_t body) {
  return "p" + std::to_string(peer) + "/b" + std::to_string(body);
}

int count(std::size_t peers, std::size_t bodies, bool has_promises) {
  const std::unique_ptr<TempFile> file = write_model(model());
  const auto open = [&] { return std::move(ModelFile::open(file->path())).value(); };
  Town town;
  std::vector<std::unique_ptr<Session>> sessions;
  std::vector<std::vector<BodyId>> ids(peers);
  Traffic traffic(7, peers * bodies);
  for (std::size_t i = 0; i < peers; ++i) {
    auto channel = std::make_unique<Town::Peer>(town, i);
    if (!channel->local.add_model("aircraft", open()).is_ok()) return 1;
    town.peers.push_back(channel.get());
    sessions.push_back(std::make_unique<Session>(std::move(channel)));
    for (std::size_t j = 0; j < bodies; ++j)
      ids[i].push_back(sessions[i]
                           ->add_body({.name = name_of(i, j),
                                       .model = "aircraft",
                                       .own = true,
                                       .max_speed_mps = has_promises ? kSpeed_mps * 1.02 : 0})
                           .value());
    sessions[i]->watch_own();
    sessions[i]->discover_bodies();
  }
  constexpr int kWarm = 200, kFrames = 800;
  double update_s = 0;
  std::uint64_t free = 0, listed = 0, unsure = 0, unknown = 0, worst_unsure = 0;
  for (int frame = 0; frame < kWarm + kFrames; ++frame) {
    if (!has_promises && frame == kWarm + 20) break;
    town.is_counted = frame >= kWarm;
    traffic.step();
    for (std::size_t i = 0; i < peers; ++i) {
      std::vector<Session::OwnMotion> own;
      // Peers begin one after the other, so that not all promise in one frame.
      if (static_cast<std::size_t>(frame) >= i)
        for (std::size_t j = 0; j < bodies; ++j)
          own.push_back({ids[i][j], traffic.motions[i * bodies + j]});
      const double before_s = cpu_s();
      auto report = sessions[i]->update(static_cast<std::uint64_t>(frame), frame * kStep_s, own, 1);
      if (!report.is_ok()) {
        std::fprintf(stderr, "%s\n", report.status().message().c_str());
        return 1;
      }
      if (!town.is_counted) continue;
      update_s += cpu_s() - before_s;
      free += report.value().free_by_bounds.pairs;
      unknown += report.value().unknown_pairs;
      std::uint64_t unsure_now = 0;
      for (const auto& answer : report.value().answers)
        unsure_now += is_certified(answer.answer.status) ? 0U : 1U;
      listed += report.value().answers.size();
      unsure += unsure_now;
      worst_unsure = std::max(worst_unsure, unsure_now);
    }
  }
  const double frames = has_promises ? kFrames : 20,
               of_each = frames * kStep_s * static_cast<double>(peers);
  std::printf("%s: what,samples_per_s,bytes_per_s\n", has_promises ? "with promises" : "without");
  double all = 0;
  for (const auto& [what, heard] : {std::pair("body_poses", town.poses),
                                    {"near_poses", town.near},
                                    {"wanted_poses", town.wanted},
                                    {"body_promises", town.promises}}) {
    std::printf("%s,%.1f,%.0f\n", what, heard.samples / of_each, heard.bytes / of_each);
    all += heard.bytes / of_each;
  }
  std::printf("all,,%.0f\n", all);
  std::printf(
      "# an update takes %.0f us; pairs of a frame of a peer: %.1f free by bounds, %.3f listed, of "
      "these not certified "
      "%.4f (%llu at most), unknown %.2f\n",
      1e6 * update_s / frames / static_cast<double>(peers),
      static_cast<double>(free) / frames / static_cast<double>(peers),
      static_cast<double>(listed) / frames / static_cast<double>(peers),
      static_cast<double>(unsure) / frames / static_cast<double>(peers),
      static_cast<unsigned long long>(worst_unsure),
      static_cast<double>(unknown) / frames / static_cast<double>(peers));
  return 0;
}

/// What one process saw, by pipe.
struct Flown {
  double core = 0;
  std::uint64_t frames = 0, unknown = 0, free = 0, listed = 0, unsure = 0;
  subscriber::PoseCounts counts[16];  // with each other process: sent to it, heard of it
};

std::uint64_t loopback_bytes() {
  std::ifstream table("/proc/net/dev");
  for (std::string line; std::getline(table, line);)
    if (const std::size_t at = line.find("lo:"); at != std::string::npos)
      return std::strtoull(line.c_str() + at + 3, nullptr, 10);
  return 0;
}

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// The model has no publisher: bounds come from the header, which each has on disk.
class Flier : public subscriber::Channel {
 public:
  Flier(std::unique_ptr<subscriber::DdsChannel> dds, const std::string& path)
      : dds_(std::move(dds)) {
    auto model = ModelFile::open(path);
    if (!model.is_ok() || !local_.add_model("aircraft", std::move(model).value()).is_ok())
      std::_Exit(1);
  }
  [[nodiscard]] wire::SessionId own_id() const override { return dds_->own_id(); }
  void send(const wire::RegionSubscription& subscription) override { local_.send(subscription); }
  void send(const wire::BodyPoses& poses) override { dds_->send(poses); }
  void send(const wire::BodyDirectory& directory) override { dds_->send(directory); }
  void send(const wire::ContactReport&) override {}
  void promise(const wire::BodyPromises& promises) override { dds_->promise(promises); }
  void send_near(const wire::NearPoses& poses) override { dds_->send_near(poses); }
  void want(const wire::WantedPoses& wanted) override { dds_->want(wanted); }
  void allow(double budget_s) override { local_.allow(budget_s); }
  Inbox take() override {
    Inbox all = dds_->take();
    Inbox own = local_.take();
    all.hellos = std::move(own.hellos);
    all.headers = std::move(own.headers);
    all.batches = std::move(own.batches);
    return all;
  }

 private:
  std::unique_ptr<subscriber::DdsChannel> dds_;
  subscriber::LocalChannel local_;
};

void fly_one(std::size_t at, std::size_t peers, std::size_t bodies, double seconds,
             bool has_promises, double begin_s, const std::string& path, int out) {
  subscriber::DdsChannelOptions options;
  options.session = at + 1;
  options.transport.interface = "127.0.0.1";
  options.transport.prefix = has_promises ? "bench/promises" : "bench/poses";
  auto made = subscriber::DdsChannel::create(options);
  if (!made.is_ok()) {
    std::fprintf(stderr, "%s\n", made.status().message().c_str());
    std::_Exit(1);
  }
  const subscriber::DdsChannel* dds = made.value().get();
  Session session(std::make_unique<Flier>(std::move(made).value(), path),
                  {.publish_reports = false});
  Traffic traffic(7, peers * bodies);
  std::vector<BodyId> ids;
  for (std::size_t j = 0; j < bodies; ++j)
    ids.push_back(session
                      .add_body({.name = name_of(at, j),
                                 .model = "aircraft",
                                 .own = true,
                                 .max_speed_mps = has_promises ? kSpeed_mps * 1.02 : 0})
                      .value());
  session.watch_own();
  session.discover_bodies();
  constexpr double kWarm_s = 5, kDrain_s = 1.5;
  Flown flown;
  double before_s = 0;
  const auto last = static_cast<std::uint64_t>((kWarm_s + seconds + kDrain_s) / kStep_s);
  for (std::uint64_t frame = 0; frame < last; ++frame) {
    traffic.step();
    const double due_s = begin_s + static_cast<double>(frame) * kStep_s;
    std::this_thread::sleep_for(std::chrono::duration<double>(std::max(0.0, due_s - now_s())));
    const double time_s = static_cast<double>(frame) * kStep_s;
    if (before_s == 0 && time_s >= kWarm_s) before_s = cpu_s();
    std::vector<Session::OwnMotion> own;
    const bool is_draining = time_s >= kWarm_s + seconds;  // what was sent has come by the end
    if (!is_draining)
      for (std::size_t j = 0; j < bodies; ++j)
        own.push_back({ids[j], traffic.motions[at * bodies + j]});
    const auto report = session.update(frame, std::min(time_s, kWarm_s + seconds), own, 0.02);
    if (!report.is_ok()) {
      std::fprintf(stderr, "%s\n", report.status().message().c_str());
      std::_Exit(1);
    }
    for (const std::string& line : report.value().complaints)
      std::fprintf(stderr, "%s: %s\n", name_of(at, 0).c_str(), line.c_str());
    if (is_draining) {
      if (flown.core == 0) flown.core = (cpu_s() - before_s) / seconds;
      continue;
    }
    if (time_s < kWarm_s) continue;
    ++flown.frames;
    flown.unknown += report.value().unknown_pairs;
    flown.free += report.value().free_by_bounds.pairs;
    flown.listed += report.value().answers.size();
    for (const auto& answer : report.value().answers)
      flown.unsure += is_certified(answer.answer.status) ? 0U : 1U;
  }
  for (const auto& [peer, counted] : dds->pose_counts())
    if (peer >= 1 && peer <= 16) flown.counts[peer - 1] = counted;
  if (write(out, &flown, sizeof flown) != sizeof flown) std::_Exit(1);
  // Nobody leaves before all are done.
  std::this_thread::sleep_for(std::chrono::seconds(1));
  std::_Exit(0);
}

int fly(std::size_t peers, std::size_t bodies, double seconds, bool has_promises) {
  const std::unique_ptr<TempFile> file = write_model(model());
  const double begin_s = now_s() + 3;
  std::vector<int> ends;
  for (std::size_t i = 0; i < peers; ++i) {
    int pipes[2];
    if (pipe(pipes) != 0) return 1;
    if (fork() == 0) {
      close(pipes[0]);
      fly_one(i, peers, bodies, seconds, has_promises, begin_s, file->path(), pipes[1]);
    }
    close(pipes[1]);
    ends.push_back(pipes[0]);
  }
  const auto bytes_at = [&](double time_s) {
    std::this_thread::sleep_for(std::chrono::duration<double>(begin_s + time_s - now_s()));
    return loopback_bytes();
  };
  const std::uint64_t before = bytes_at(5), after = bytes_at(5 + seconds);
  std::vector<Flown> all(peers);
  for (std::size_t i = 0; i < peers; ++i) {
    if (read(ends[i], &all[i], sizeof(Flown)) != sizeof(Flown)) return 1;
    close(ends[i]);
  }
  for (std::size_t i = 0; i < peers; ++i) wait(nullptr);
  const auto n = static_cast<double>(peers);
  subscriber::PoseCounts sent;
  std::uint64_t lost = 0;
  double core = 0, unknown = 0, unsure = 0, listed = 0, frames = 0;
  for (std::size_t i = 0; i < peers; ++i) {
    core += all[i].core / n;
    frames += static_cast<double>(all[i].frames);
    unknown += static_cast<double>(all[i].unknown);
    unsure += static_cast<double>(all[i].unsure);
    listed += static_cast<double>(all[i].listed);
    for (std::size_t j = 0; j < peers; ++j) {
      if (i == j) continue;
      const subscriber::PoseCounts &to = all[i].counts[j], &there = all[j].counts[i];
      sent.sent_near += to.sent_near;
      sent.heard_near += there.heard_near;
      sent.heard_poses += there.heard_poses;
      sent.heard_promises += there.heard_promises;
      sent.lost_poses += there.lost_poses;
      sent.lost_promises += there.lost_promises;
      lost += to.sent_near - std::min(to.sent_near, there.heard_near);
    }
  }
  std::printf(
      "%s,%zu,%.0f,%.2f,%llu,%llu,%llu,%llu,%llu,%llu,%llu\n", has_promises ? "promises" : "poses",
      peers * bodies, static_cast<double>(after - before) / seconds / n, 100 * core,
      static_cast<unsigned long long>(sent.heard_poses),
      static_cast<unsigned long long>(sent.lost_poses),
      static_cast<unsigned long long>(sent.heard_promises),
      static_cast<unsigned long long>(sent.lost_promises),
      static_cast<unsigned long long>(sent.sent_near),
      static_cast<unsigned long long>(sent.heard_near), static_cast<unsigned long long>(lost));
  std::printf(
      "# pairs of a frame of a peer: listed %.2f, of these not certified %.3f, unknown %.3f\n",
      listed / frames, unsure / frames, unknown / frames);
  std::fflush(stdout);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  const auto number = [&](int at, double otherwise) {
    return argc > at ? std::strtod(argv[at], nullptr) : otherwise;
  };
  if (what == "count") {
    const auto peers = static_cast<std::size_t>(number(2, 100)),
               bodies = static_cast<std::size_t>(number(3, 10));
    const int first = count(peers, bodies, true);
    return first != 0 ? first : count(peers, bodies, false);
  }
  if (what == "fly") {
    const auto peers = std::min<std::size_t>(16, static_cast<std::size_t>(number(2, 8))),
               bodies = static_cast<std::size_t>(number(3, 10));
    std::printf(
        "kind,bodies,bytes_per_s,core_percent,heard_poses,lost_poses,heard_promises,lost_promises,"
        "sent_near,heard_near,"
        "lost_near\n");
    std::fflush(stdout);
    const int first = fly(peers, bodies, number(4, 20), true);
    return first != 0 ? first : fly(peers, bodies, number(4, 20), false);
  }
  std::fprintf(stderr,
               "nearmesh-bench-promises count [PEERS [BODIES]] | fly [PEERS [BODIES [SECONDS]]]\n");
  return 1;
}
