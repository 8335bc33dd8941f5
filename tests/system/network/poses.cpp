// SPDX-License-Identifier: Apache-2.0
#include <stdexcept>

#include "measures.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "scene_files.hpp"

namespace nearmesh::test {
namespace {

constexpr double kSettled_s = 1;

/// What the chart counts from the time when the headers are there.
struct Simulated {
  std::uint64_t bytes = 0, request_bytes = 0;
  std::uint32_t requests = 0;
  double compute_s = 0;
  [[nodiscard]] double seconds(double mbit) const {
    return 8e-6 * static_cast<double>(bytes + request_bytes) / mbit + compute_s;
  }
};
Simulated simulate(chart::Method& method, const chart::Scene& scene, const perf::PosePair& poses) {
  const PosedPair posed =
      pose_pair(scene.a.baked.header.grid, poses.a, "a", scene.b.baked.header.grid, poses.b, "b")
          .value();
  method.start();
  const chart::State state =
      method.receive({{.pose = poses.a}, {.pose = poses.b}}, posed, std::uint64_t{1} << 40);
  if (!state.claim || !is_certified(*state.claim))
    throw std::runtime_error("a pose is not certified");
  const std::uint64_t headers = chart::framed(encode_header(scene.a.baked.header).size()) +
                                chart::framed(encode_header(scene.b.baked.header).size());
  return {state.bytes - headers, state.request_bytes, state.requests,
          state.refine_s + state.tree_s + state.query_s + state.load_s};
}

struct Driven {
  double join_s = 0;  ///< from before the participant is made to the headers
  double seconds = 0;
  Lan::Counters wire;
  subscriber::SessionStats stats;
};
Driven drive(const Lan& lan, const perf::PosePair& poses, unsigned domain) {
  subscriber::DdsChannelOptions options;
  options.transport.domain = domain;
  const Stopwatch join;
  std::unique_ptr<subscriber::DdsChannel> made;
  {
    const Lan::Visit visit = lan.visit(1);
    auto channel = subscriber::DdsChannel::create(options);
    if (!channel.is_ok()) throw std::runtime_error(channel.status().message());
    made = std::move(channel).value();
  }
  subscriber::DdsChannel& channel = *made;
  subscriber::Session session(std::move(made), {.lookahead_s = 0, .publish_reports = false});
  const auto a = session.add_body({.name = "a", .model = "a"}).value();
  const auto b = session.add_body({.name = "b", .model = "b"}).value();
  if (!session.watch(a, b).is_ok()) throw std::runtime_error("not watched");
  const auto update_until = [&](const auto& done) {
    for (const Stopwatch watch;; channel.wait(0.005)) {
      const auto report = session.update(0, 0, {}, 1);
      if (!report.is_ok()) throw std::runtime_error(report.status().message());
      if (done(report.value())) return;
      if (watch.seconds() > kDeadline_s) throw std::runtime_error("a pose took too long");
    }
  };
  update_until([&](const subscriber::FrameReport&) {
    return session.header_of(a) != nullptr && session.header_of(b) != nullptr;
  });
  Driven driven{.join_s = join.seconds()};
  // The clock knows no discovery, the rest of which would take its share of the link.
  const Stopwatch settling;
  update_until([&](const subscriber::FrameReport&) { return settling.seconds() > kSettled_s; });
  const Lan::Counters before = lan.counters(1);
  const Stopwatch watch;
  if (!session.place_body(a, poses.a).is_ok() || !session.place_body(b, poses.b).is_ok())
    throw std::runtime_error("not placed");
  update_until([](const subscriber::FrameReport& report) { return report.all_certified(); });
  driven.seconds = watch.seconds();
  const Lan::Counters after = lan.counters(1);
  driven.wire.received_bytes = after.received_bytes - before.received_bytes;
  driven.wire.sent_bytes = after.sent_bytes - before.sent_bytes;
  driven.stats = session.stats();
  return driven;
}

}  // namespace

void measure_poses(const MeasureOptions& options) {
  std::optional<chart::Scene> scene;
  for (const chart::SceneInfo& info : chart::scenes())
    if (info.name == "terrain-grazing") scene = info.make({});
  scene->b_streamed = true;  // a publisher serves both
  const Folder folder;
  write_models(*scene, folder);
  std::unique_ptr<chart::Method> certified;
  for (const chart::MethodInfo& info : chart::methods())
    if (info.name == "certified") certified = info.make(*scene);
  std::FILE* out = open_csv(options.out + "/poses.csv");
  std::fprintf(
      out,
      "mbit_per_s,pose,simulated_s,driven_s,driven_join_s,simulated_bytes,driven_batch_bytes,"
      "wire_down_bytes,simulated_request_bytes,wire_up_bytes,simulated_requests,driven_requests,"
      "simulated_compute_s\n");
  for (const double mbit : options.mbit) {
    const Lan lan({{}, {.mbit_per_s = mbit}});
    const auto publisher =
        serve(lan, folder, {{folder.file("a.spm"), folder.file("b.spm")}, 0, options.domain});
    for (std::size_t i = 0; i < scene->poses.size(); ++i) {
      const Simulated simulated = simulate(*certified, *scene, scene->poses[i]);
      const Driven driven = drive(lan, scene->poses[i], options.domain);
      std::fprintf(out, "%g,%zu,%.4f,%.4f,%.4f,%llu,%llu,%llu,%llu,%llu,%u,%llu,%.4f\n", mbit, i,
                   simulated.seconds(mbit), driven.seconds, driven.join_s,
                   static_cast<unsigned long long>(simulated.bytes),
                   static_cast<unsigned long long>(driven.stats.batch_bytes),
                   static_cast<unsigned long long>(driven.wire.received_bytes),
                   static_cast<unsigned long long>(simulated.request_bytes),
                   static_cast<unsigned long long>(driven.wire.sent_bytes), simulated.requests,
                   static_cast<unsigned long long>(driven.stats.requests), simulated.compute_s);
      std::fflush(out);
    }
    std::fprintf(stderr, "poses at %g Mbit/s\n", mbit);
  }
  std::fclose(out);
}

}  // namespace nearmesh::test
