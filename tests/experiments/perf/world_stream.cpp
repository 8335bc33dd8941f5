// SPDX-License-Identifier: Apache-2.0
#include "world_stream.hpp"

#include <malloc.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <memory>

#include "core/base/resources.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/world/world_probe.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using subscriber::Channel;
using subscriber::LocalChannel;
using subscriber::Session;

/// So that a peer can end, and give its memory back, without its publisher.
class Link final : public Channel {
 public:
  explicit Link(LocalChannel& other) : other_(other) {}
  [[nodiscard]] wire::SessionId own_id() const override { return other_.own_id(); }
  void send(const wire::RegionSubscription& subscription) override { other_.send(subscription); }
  void send(const wire::BodyPoses&) override {}
  void send(const wire::BodyDirectory&) override {}
  void send(const wire::ContactReport&) override {}
  [[nodiscard]] Inbox take() override { return other_.take(); }

 private:
  LocalChannel& other_;
};

double resident_kb() {
  ::malloc_trim(0);
  return static_cast<double>(resident_memory_bytes()) / 1024;
}

}  // namespace

bool run_stream(const std::string& folder, int frames) {
  constexpr double kStep_s = 0.05, kSpeed_mps = 200, kAbove_m = 12, kLeg_m = 40e3;
  constexpr int kMostUpdates = 60;
  LocalChannel publisher;
  const auto aircraft = test::write_model(test::bake_mesh(generate_aircraft(500, 7), 16));
  auto file = ModelFile::open(aircraft->path());
  auto heights = WorldProbe::open(folder);
  if (!file.is_ok() || !heights.is_ok() ||
      !publisher.add_model("aircraft", std::move(file).value()).is_ok() ||
      !publisher.add_world("world", folder).is_ok()) {
    std::fprintf(stderr, "%s: no world that can be served\n", folder.c_str());
    return false;
  }
  const auto height_m = [&](double x, double y) {
    const RayProbe ray{.origin_m = {x, y, 20e3}};
    WorldRayAnswer answer;
    const bool is_hit = heights.value().probe({}, {&ray, 1}, {&answer, 1}).is_ok() &&
                        answer.ray.status == ProbeStatus::kHit;
    return is_hit ? answer.ray.point_m[2] : 0.0;
  };
  auto session = std::make_unique<Session>(std::make_unique<Link>(publisher));
  const auto ground = session->add_body({.name = "ground", .model = "world"}).value();
  const auto body = session->add_body({.name = "one", .model = "aircraft", .own = true}).value();
  static_cast<void>(session->place_body(ground, {}));
  static_cast<void>(session->watch(body, ground));
  const auto bytes = [&session] {
    return session->stats().header_bytes + session->stats().batch_bytes;
  };
  std::uint64_t before_tile = 0, join_headers = 0, most_tiles = 0;
  int certified = 0, contacts = 0, updates = 0;
  std::printf("frame,updates,tiles,bytes,requests,certified\n");
  for (int frame = 0; frame < frames; ++frame) {
    // There and back in lanes beside each other.
    const double way_m = kSpeed_mps * kStep_s * frame, lane = std::floor(way_m / kLeg_m);
    const bool is_back = std::fmod(lane, 2) != 0;
    const double along_m = is_back ? (lane + 1) * kLeg_m - way_m : way_m - lane * kLeg_m;
    const double across_m = 0.3 * along_m + 500 * lane;
    const double speed_mps = is_back ? -kSpeed_mps : kSpeed_mps;
    Motion motion{.linear_velocity_mps = {speed_mps, 0.3 * speed_mps, 0}};
    motion.pose.translation_m = {along_m, across_m, height_m(along_m, across_m) + kAbove_m};
    bool is_certified = false;
    int tries = 0;
    std::size_t tiles = 0;
    for (; tries < kMostUpdates && !is_certified; ++tries) {
      const std::uint64_t had = bytes();
      const auto report =
          session->update(static_cast<std::uint64_t>(frame), kStep_s * frame, {{body, motion}}, 1);
      if (!report.is_ok()) return false;
      is_certified = report.value().all_certified();
      const auto& answer = report.value().answers.front();
      if (answer.world) tiles = answer.world->tiles.size();
      contacts += is_certified && answer.answer.pair_total > 0 ? 1 : 0;
      // The world's record and the aircraft's header come first.
      if (join_headers == 0) join_headers = session->stats().header_bytes;
      if (before_tile == 0 && session->stats().header_bytes > join_headers) before_tile = had;
    }
    updates += tries;
    most_tiles = std::max<std::uint64_t>(most_tiles, tiles);
    certified += is_certified ? 1 : 0;
    if (frame % std::max(frames / 10, 1) == 0)
      std::printf("%d,%d,%zu,%llu,%llu,%d\n", frame, tries, tiles,
                  static_cast<unsigned long long>(bytes()),
                  static_cast<unsigned long long>(session->stats().requests), is_certified ? 1 : 0);
  }
  const std::uint64_t all = bytes();
  const double with_kb = resident_kb();
  session.reset();
  std::printf(
      "# before the first tile %llu bytes; %d frames %llu bytes, %d certified, %d in contact, at "
      "most %llu tiles near, "
      "%.2f updates a frame; peer's memory %.0f KB\n",
      static_cast<unsigned long long>(before_tile), frames, static_cast<unsigned long long>(all),
      certified, contacts, static_cast<unsigned long long>(most_tiles),
      static_cast<double>(updates) / frames, with_kb - resident_kb());
  return true;
}

}  // namespace nearmesh
