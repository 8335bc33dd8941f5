// SPDX-License-Identifier: Apache-2.0
// What it takes to say on a bus, and to prove again, that bodies are free by bounds: one peer that
// moves all bodies at 20 Hz, recorded without DDS as a recorder hears it, and verified.
//   nearmesh-bench-bounds --bodies 200 --seconds 2 -o bodies.db3
//   nearmesh-bench-bounds --bodies 300 --seconds 2 --ground -o ground.db3
//   nearmesh-bench-bounds --bodies 1000 --seconds 2 --side 400 -o far.db3

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "core/base/hash.hpp"
#include "subscriber/recorded/verify.hpp"
#include "taped_session.hpp"

using namespace nearmesh;

namespace {

constexpr wire::SessionId kServer = 0xa1, kPeer = 0xb1;
constexpr double kFrame_s = 0.05;

struct Plan {
  std::size_t bodies = 200;
  double seconds = 2, side_km = 10;
  bool has_ground = false;
  std::string path;
};

/// Fly straight on at 100 to 200 m/s, level or nearly so.
std::vector<Motion> make_motions(const Plan& plan) {
  Random random(7);
  std::vector<Motion> motions(plan.bodies);
  const double side_m = plan.side_km * 1e3;
  for (Motion& motion : motions) {
    const double course = random.between(0, 6.283), speed = random.between(100, 200);
    motion.pose.translation_m = {random.between(0, side_m), random.between(0, side_m),
                                 random.between(100, 3000)};
    motion.linear_velocity_mps = {speed * std::cos(course), speed * std::sin(course),
                                  random.between(-5, 5)};
  }
  return motions;
}

struct Figures {
  std::uint64_t frames = 0, certified = 0, answers = 0, free = 0, messages = 0;
  std::size_t report_bytes = 0;  // of the last frame
};

/// Keeps the size of what it hears last of bounds.
class Sized final : public subscriber::Channel {
 public:
  Sized(std::unique_ptr<subscriber::Channel> inner, std::size_t& bytes)
      : inner_(std::move(inner)), bytes_(bytes) {}
  wire::SessionId own_id() const override { return inner_->own_id(); }
  void send(const wire::RegionSubscription& message) override { inner_->send(message); }
  void send(const wire::BodyPoses& message) override { inner_->send(message); }
  void send(const wire::BodyDirectory& message) override { inner_->send(message); }
  void send(const wire::ContactReport& message) override { inner_->send(message); }
  void tell_held(const wire::HeldDetail& message) override { inner_->tell_held(message); }
  void tell_watched(const wire::WatchedBodies& message) override { inner_->tell_watched(message); }
  void tell_bounds(const wire::BoundsReport& message) override {
    bytes_ = wire::encode_payload(message).size();
    inner_->tell_bounds(message);
  }
  Inbox take() override { return inner_->take(); }

 private:
  std::unique_ptr<subscriber::Channel> inner_;
  std::size_t& bytes_;
};

Result<Figures> record(const Plan& plan) {
  constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
  constexpr int kRounds = 8;  // of messages in a frame, while some answer is not certified
  constexpr double kSquare_m = 32;
  const auto squares = static_cast<std::uint32_t>(plan.side_km * 1e3 / kSquare_m);
  const auto aircraft = test::write_model(test::bake_mesh(generate_aircraft(800, 7), 64));
  auto writer = RecordingWriter::create(
      plan.path, {0x5e55, 0, wire::kWireVersion, "nearmesh", wire::idl_text()});
  NEARMESH_RETURN_IF_ERROR(writer);
  test::Tape tape(std::move(writer).value(), "nearmesh");
  tape.now_ns = kStart_ns;
  test::MemoryBus bus;
  test::TapedPublisher channel(bus.make_publisher(kServer), kServer, tape);
  publisher::Service service(channel, kServer);
  Result<ModelFile> file = ModelFile::open(aircraft->path());
  NEARMESH_RETURN_IF_ERROR(file);
  NEARMESH_RETURN_IF_ERROR(service.add_model("aircraft", std::move(file).value()));
  Figures figures;
  subscriber::Session session(
      std::make_unique<Sized>(std::make_unique<test::TapedPeer>(bus.make_peer(kPeer), tape),
                              figures.report_bytes),
      {.request_timeout_s = 0.0005});
  session.watch_all();
  std::unique_ptr<test::TempFile> terrain;
  if (plan.has_ground) {
    terrain = test::write_model(test::bake_mesh(generate_terrain(squares, 7), 64));
    Result<ModelFile> ground = ModelFile::open(terrain->path());
    NEARMESH_RETURN_IF_ERROR(ground);
    NEARMESH_RETURN_IF_ERROR(service.add_model("terrain", std::move(ground).value()));
    const auto id = session.add_body({.name = "ground", .model = "terrain"});
    NEARMESH_RETURN_IF_ERROR(id);
    NEARMESH_RETURN_IF_ERROR(session.place_body(id.value(), {}));
  }
  service.announce();
  std::vector<subscriber::Session::OwnMotion> own;
  for (const Motion& motion : make_motions(plan)) {
    const auto id = session.add_body(
        {.name = "body_" + std::to_string(own.size()), .model = "aircraft", .own = true});
    NEARMESH_RETURN_IF_ERROR(id);
    own.push_back({id.value(), motion});
  }
  // The headers come first: a frame without them is no measure of bounds.
  for (int i = 0; i < 4; ++i) {
    bus.tick();
    service.step(0);
    NEARMESH_RETURN_IF_ERROR(session.update(0, -kFrame_s, {}, 1));
  }
  const auto frames = static_cast<std::uint64_t>(std::llround(plan.seconds / kFrame_s));
  for (; figures.frames < frames && tape.status.is_ok(); ++figures.frames) {
    const double time_s = static_cast<double>(figures.frames) * kFrame_s;
    for (subscriber::Session::OwnMotion& body : own)
      for (std::size_t k = 0; k < 3; ++k)
        body.motion.pose.translation_m[k] += body.motion.linear_velocity_mps[k] * kFrame_s;
    bool is_certified = false;
    for (int round = 0; round < kRounds && !is_certified; ++round) {
      const double now_s = time_s + round * kFrame_s / kRounds;
      tape.now_ns = kStart_ns + static_cast<std::int64_t>(now_s * 1e9);
      bus.tick();
      service.step(now_s);
      const auto report =
          session.update(figures.frames, time_s,
                         round == 0 ? own : std::vector<subscriber::Session::OwnMotion>(), 1);
      NEARMESH_RETURN_IF_ERROR(report);
      is_certified = report.value().all_certified();
      if (!is_certified && round + 1 < kRounds) continue;
      figures.certified += is_certified ? 1 : 0;
      figures.answers += report.value().answers.size();
      figures.free += report.value().free_by_bounds.pairs;
    }
    bus.reports.clear();
    bus.bounds.clear();
    bus.subscriptions.clear();
  }
  NEARMESH_RETURN_IF_ERROR(tape.close());
  figures.messages = tape.messages();
  return figures;
}

Status measure(const Plan& plan) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  const Stopwatch watch;
  const Result<Figures> recorded = record(plan);
  NEARMESH_RETURN_IF_ERROR(recorded);
  const Figures& figures = recorded.value();
  std::printf("session: %zu bodies, %llu frames in %.2f s; all certified in %llu of them\n",
              plan.bodies, count(figures.frames), watch.seconds(), count(figures.certified));
  std::printf(
      "answers a frame: %.1f of pairs that are near, %.1f free by bounds, in a report of %zu "
      "bytes\n",
      static_cast<double>(figures.answers) / static_cast<double>(figures.frames),
      static_cast<double>(figures.free) / static_cast<double>(figures.frames),
      figures.report_bytes);
  std::printf("file: %.2f MB, %llu messages\n",
              static_cast<double>(std::filesystem::file_size(plan.path)) / 1e6,
              count(figures.messages));
  auto reader = RecordingReader::open(plan.path);
  NEARMESH_RETURN_IF_ERROR(reader);
  const Stopwatch clock;
  const auto report = subscriber::verify(*reader.value(), {.threads = 1});
  NEARMESH_RETURN_IF_ERROR(report);
  const subscriber::VerifyReport& found = report.value();
  std::printf(
      "verify: %.2f s; %llu of %llu answers proved, %llu different; free by bounds: %llu of %llu "
      "answers proved, %llu reports wrong, %llu not provable, digest %s\n",
      clock.seconds(), count(found.verified), count(found.answers()), count(found.different),
      count(found.bounds.proved_pairs), count(found.bounds.pairs), count(found.bounds.wrong),
      count(found.bounds.unprovable), to_hex(found.digest).c_str());
  return Status::ok();
}

}  // namespace

int main(int argc, char** argv) {
  Plan plan;
  CLI::App app{"Records a session that watches all pairs, and proves it"};
  app.add_option("--bodies", plan.bodies, "Bodies, all of one peer")->capture_default_str();
  app.add_option("--seconds", plan.seconds, "Simulated time, at 20 Hz")->capture_default_str();
  app.add_option("--side", plan.side_km, "Kilometres along a side of where they fly")
      ->capture_default_str();
  app.add_flag("--ground", plan.has_ground, "A terrain below them, in place");
  app.add_option("-o,--output", plan.path, "File to create")->required();
  CLI11_PARSE(app, argc, argv);
  const Status done = measure(plan);
  if (done.is_ok()) return 0;
  std::fprintf(stderr, "nearmesh-bench-bounds: %s\n", done.message().c_str());
  return 1;
}
