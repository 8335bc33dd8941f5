// SPDX-License-Identifier: Apache-2.0
#include <stdexcept>
#include <thread>

#include "measures.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "scene_files.hpp"

namespace nearmesh::test {
namespace {

constexpr double kFrame_s = 0.01;
constexpr std::size_t kSteps = 5;  ///< so many frames take a scene that moves to its next pose
constexpr std::size_t kFrames = 100, kFlights = 12;  ///< frames of each, from different poses on
constexpr double kPatience_s = 10;

/// So many frames after a pose; on a curve through the poses, as speeds do not jump.
Motion motion_at(const chart::Scene& scene, std::size_t pose, std::size_t frame) {
  const std::size_t i = scene.frames ? pose + frame / kSteps : pose;
  Motion motion{.pose = scene.poses[i].b};
  if (!scene.frames) return motion;
  const double t = static_cast<double>(frame % kSteps) / kSteps;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto at = [&](std::size_t n) { return scene.poses[n].b.translation_m[k]; };
    // Catmull and Rom, A class of local interpolating splines, 1974.
    const double c1 = (at(i + 1) - at(i - 1)) / 2,
                 c2 = at(i - 1) - 2.5 * at(i) + 2 * at(i + 1) - 0.5 * at(i + 2),
                 c3 = 1.5 * (at(i) - at(i + 1)) + 0.5 * (at(i + 2) - at(i - 1));
    motion.pose.translation_m[k] = at(i) + t * (c1 + t * (c2 + t * c3));
    motion.linear_velocity_mps[k] = (c1 + t * (2 * c2 + t * 3 * c3)) / (kSteps * kFrame_s);
  }
  return motion;
}

/// Seconds from the match on, but for the first.
struct Cold {
  double match_s = 0;  ///< from before the participant is made
  double header_s = 0, certified_s = 0;
  std::size_t frames = 0, certified = 0;
  Lan::Counters wire;  ///< of the peer's interface, from the match to the first certified answer
  subscriber::SessionStats stats;
};

/// A peer that knows from the start where the bodies are. A scene that moves is flown from its pose
/// `first` on, an update a frame; else the peer looks whenever something comes, until its answer is
/// certified.
Cold start_cold(const Lan& lan, const chart::Scene& scene, std::size_t first, unsigned domain) {
  subscriber::DdsChannelOptions options;
  options.transport.domain = domain;
  const Stopwatch clock;
  std::unique_ptr<subscriber::DdsChannel> made;
  {
    const Lan::Visit visit = lan.visit(1);
    auto channel = subscriber::DdsChannel::create(options);
    if (!channel.is_ok()) throw std::runtime_error(channel.status().message());
    made = std::move(channel).value();
  }
  subscriber::DdsChannel& channel = *made;
  subscriber::Session session(std::move(made), {.publish_reports = false});
  const auto a = session.add_body({.name = "a", .model = "a"}).value();
  const auto b = session.add_body({.name = "b", .model = "b", .own = true}).value();
  if (!session.watch(a, b).is_ok() || !session.place_body(a, scene.poses[first].a).is_ok())
    throw std::runtime_error("not watched");
  Cold cold;
  bool is_matched = false, has_header = false, is_certain = false;
  Lan::Counters before;
  for (std::uint64_t frame = 0;; ++frame) {
    const double due_s = kFrame_s * static_cast<double>(frame);
    if (!scene.frames) {
      channel.wait(0.1);
    } else if (clock.seconds() < due_s) {
      std::this_thread::sleep_for(std::chrono::duration<double>(due_s - clock.seconds()));
    }
    if (clock.seconds() > kPatience_s) throw std::runtime_error("a pose took too long");
    const auto report =
        session.update(frame, due_s, {{b, motion_at(scene, first, cold.frames)}}, 1);
    if (!report.is_ok()) throw std::runtime_error(report.status().message());
    const subscriber::PairAnswer& answer = report.value().answers.front();
    if (!is_matched) {
      if (answer.reason.find("no publisher") != std::string::npos) continue;
      is_matched = true;
      cold.match_s = clock.seconds();
      before = lan.counters(1);
    }
    const double now_s = clock.seconds() - cold.match_s;
    if (!has_header && session.header_of(a) != nullptr && session.header_of(b) != nullptr) {
      has_header = true;
      cold.header_s = now_s;
    }
    ++cold.frames;
    if (report.value().all_certified()) ++cold.certified;
    if (report.value().all_certified() && !is_certain) {
      is_certain = true;
      cold.certified_s = now_s;
      const Lan::Counters after = lan.counters(1);
      cold.wire.received_bytes = after.received_bytes - before.received_bytes;
      cold.wire.sent_bytes = after.sent_bytes - before.sent_bytes;
      cold.stats = session.stats();
    }
    if (scene.frames ? cold.frames == kFrames : is_certain) return cold;
  }
}

}  // namespace

void measure_cold_starts(const MeasureOptions& options) {
  std::FILE* out = open_csv(options.out + "/cold.csv");
  std::fprintf(out,
               "scene,mbit_per_s,round_trip_s,pose,match_s,header_s,certified_s,frames,certified,"
               "requests,batch_bytes,header_bytes,wire_down_bytes,wire_up_bytes\n");
  for (const std::string& name : options.scenes) {
    std::optional<chart::Scene> scene;
    for (const chart::SceneInfo& info : chart::scenes())
      if (info.name == name) scene = info.make({.data = NEARMESH_TEST_DATA});
    if (!scene) throw std::runtime_error("no scene " + name);
    const Folder folder;
    write_models(*scene, folder);
    const std::size_t starts = scene->frames ? kFlights : scene->poses.size();
    for (const double mbit : options.mbit)
      for (const double round_trip_s : options.round_trips_s) {
        const Lan lan({{}, {.mbit_per_s = mbit, .delay_s = round_trip_s / 2}});
        const auto publisher =
            serve(lan, folder, {{folder.file("a.spm"), folder.file("b.spm")}, 0, options.domain});
        for (std::size_t i = 0; i < starts; ++i) {
          const std::size_t first =
              scene->frames ? 1 + i * (scene->poses.size() - kFrames / kSteps - 3) / kFlights : i;
          const Cold cold = start_cold(lan, *scene, first, options.domain);
          std::fprintf(out, "%s,%g,%g,%zu,%.4f,%.4f,%.4f,%zu,%zu,%llu,%llu,%llu,%llu,%llu\n",
                       name.c_str(), mbit, round_trip_s, first, cold.match_s, cold.header_s,
                       cold.certified_s, cold.frames, cold.certified,
                       static_cast<unsigned long long>(cold.stats.requests),
                       static_cast<unsigned long long>(cold.stats.batch_bytes),
                       static_cast<unsigned long long>(cold.stats.header_bytes),
                       static_cast<unsigned long long>(cold.wire.received_bytes),
                       static_cast<unsigned long long>(cold.wire.sent_bytes));
          std::fflush(out);
        }
        std::fprintf(stderr, "%s at %g Mbit/s, round trip %g s\n", name.c_str(), mbit,
                     round_trip_s);
      }
  }
  std::fclose(out);
}

}  // namespace nearmesh::test
