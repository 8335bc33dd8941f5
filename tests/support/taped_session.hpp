// SPDX-License-Identifier: Apache-2.0
#pragma once
// A whole session without DDS, faster than real time: one publisher, any number of peers that each
// fly an aircraft over one terrain and ask about the ground and the next peer's aircraft.
// Everything that is sent goes to a recording. The same plan gives the same bytes on every machine.

#include <memory>
#include <string>
#include <vector>

#include "memory_channel.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "publisher/serve/service.hpp"
#include "taped_channels.hpp"
#include "test_models.hpp"

namespace nearmesh::test {

struct SessionPlan {
  std::uint32_t peers = 2;
  double seconds = 4, rate_hz = 3;  ///< of frames
  std::uint32_t terrain_size = 96;  ///< squares along a side, of 32 m
  std::uint32_t aircraft_faces = 800;
  std::uint64_t lose_every = 5;  ///< poses that the recorder does not hear: one in so many; 0: none
  double commit_period_s = RecordingWriter::kCommitPeriod_s;  ///< of real time
};

struct SessionFigures {
  std::uint64_t messages = 0, frames = 0, answers = 0, certified = 0;
  double append_s = 0;  ///< spent in the recording's writer
};

/// One peer's way: from point to point close above the ground, now and then through it, turning.
class Way {
 public:
  Way(const BakedModel& ground, std::uint64_t seed) : ground_(ground), random_(seed) {
    from_ = point();
    turn_to(point());
  }
  /// Where the aircraft is after `dt_s` more.
  Motion fly(double dt_s) {
    since_s_ += dt_s;
    if (since_s_ >= leg_s_) {
      motion_.pose = pose_at(motion_, leg_s_);
      from_ = motion_.pose.translation_m;
      turn_to(point());
      since_s_ = 0;
    }
    Motion now = motion_;
    now.pose = pose_at(motion_, since_s_);
    return now;
  }

 private:
  std::array<double, 3> point() {
    auto at =
        position_m(ground_.header, ground_.store, {random_.below(ground_.header.vertex_count)});
    at[2] += random_.between(-5, 40);
    return at;
  }
  void turn_to(const std::array<double, 3>& to) {
    constexpr double kSpeed_mps = 80;
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) square += (to[k] - from_[k]) * (to[k] - from_[k]);
    leg_s_ = std::max(1.0, std::sqrt(square) / kSpeed_mps);
    motion_.pose.translation_m = from_;
    for (std::size_t k = 0; k < 3; ++k)
      motion_.linear_velocity_mps[k] = (to[k] - from_[k]) / leg_s_;
    motion_.angular_velocity_radps = {random_.between(-0.5, 0.5), random_.between(-0.5, 0.5),
                                      random_.between(-0.5, 0.5)};
  }

  const BakedModel& ground_;
  Random random_;
  std::array<double, 3> from_{};
  Motion motion_;
  double leg_s_ = 0, since_s_ = 0;
};

/// Errors: those of the recording.
inline Result<SessionFigures> record_session(const SessionPlan& plan, const std::string& path) {
  constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
  constexpr wire::SessionId kServer = 0xa1, kFirstPeer = 0xb1;
  constexpr int kRounds = 4;  // of messages in a frame, while some answer is not certified
  const std::string prefix = "nearmesh";
  const BakedModel ground = bake_mesh(generate_terrain(plan.terrain_size, 7), 64);
  const BakedModel aircraft = bake_mesh(generate_aircraft(plan.aircraft_faces, 7), 64);
  const auto ground_file = write_model(ground), aircraft_file = write_model(aircraft);
  auto writer = RecordingWriter::create(
      path, {0x5e55, 0, wire::kWireVersion, prefix, wire::idl_text()}, plan.commit_period_s);
  if (!writer.is_ok()) return writer.status();
  Tape tape(std::move(writer).value(), prefix);
  tape.now_ns = kStart_ns;
  tape.lose_every = plan.lose_every;
  MemoryBus bus;
  TapedPublisher channel(bus.make_publisher(kServer), kServer, tape);
  publisher::Service service(channel, kServer);
  EXPECT_TRUE(service.add_model("terrain", std::move(ModelFile::open(ground_file->path())).value())
                  .is_ok());
  EXPECT_TRUE(
      service.add_model("aircraft", std::move(ModelFile::open(aircraft_file->path())).value())
          .is_ok());
  service.announce();

  struct Peer {
    std::unique_ptr<subscriber::Session> session;
    subscriber::BodyId body;
    Way way;
  };
  std::vector<Peer> peers;
  const auto name_of = [&](std::uint32_t i) {
    return "aircraft_" + std::to_string(i % plan.peers + 1);
  };
  for (std::uint32_t i = 0; i < plan.peers; ++i) {
    auto session = std::make_unique<subscriber::Session>(
        std::make_unique<TapedPeer>(bus.make_peer(kFirstPeer + i), tape));
    const std::string own = name_of(i), next = name_of(i + 1);
    const auto scenery = session->add_body({.name = "ground", .model = "terrain"}).value();
    const auto body = session->add_body({.name = own, .model = "aircraft", .own = true}).value();
    EXPECT_TRUE(session->place_body(scenery, {}).is_ok());
    EXPECT_TRUE(session->watch(scenery, body).is_ok());
    if (next != own) {
      const auto other = session->add_body({.name = next, .model = "aircraft"}).value();
      EXPECT_TRUE(session->watch(body, other).is_ok());
    }
    peers.push_back({std::move(session), body, Way(ground, 100 + i)});
  }

  SessionFigures figures;
  figures.frames = static_cast<std::uint64_t>(plan.seconds * plan.rate_hz);
  for (std::uint64_t frame = 0; frame < figures.frames && tape.status.is_ok(); ++frame) {
    const double time_s = static_cast<double>(frame) / plan.rate_hz;
    std::vector<Motion> motions;
    for (Peer& peer : peers) motions.push_back(peer.way.fly(frame == 0 ? 0 : 1 / plan.rate_hz));
    std::uint64_t certified = 0, answers = 0;
    for (int round = 0; round == 0 || (round < kRounds && certified < answers); ++round) {
      const double now_s = time_s + round / (plan.rate_hz * kRounds);
      tape.now_ns = kStart_ns + static_cast<std::int64_t>(now_s * 1e9);
      bus.tick();
      service.step(now_s);
      certified = answers = 0;
      for (std::size_t i = 0; i < peers.size(); ++i) {
        std::vector<subscriber::Session::OwnMotion> own;
        if (round == 0) own.push_back({peers[i].body, motions[i]});
        const auto report = peers[i].session->update(frame, time_s, own, 1);
        EXPECT_TRUE(report.is_ok()) << report.status().message();
        for (const subscriber::PairAnswer& pair : report.value().answers) {
          ++answers;
          certified += is_certified(pair.answer.status) ? 1 : 0;
        }
      }
      bus.reports.clear();
      bus.subscriptions.clear();
    }
    figures.answers += answers;
    figures.certified += certified;
  }
  const Status closed = tape.close();
  if (!closed.is_ok()) return closed;
  figures.messages = tape.messages();
  figures.append_s = tape.append_s();
  return figures;
}

}  // namespace nearmesh::test
