// SPDX-License-Identifier: Apache-2.0
#include "flyers.hpp"

#include <stdexcept>
#include <utility>

#include "nearmesh/subscriber/peer/session.hpp"
#include "trajectory.hpp"

namespace nearmesh::test {
namespace {

/// To the side of the one before, and of the same peer's last time round: nobody flies where it
/// holds the detail already.
constexpr double kApart_m = 20, kRound_m = 170;
constexpr double kFlyRows_hz = 2;  ///< of the trajectory: 80 m a row

void must(const Status& status) {
  if (!status.is_ok()) throw std::runtime_error(status.message());
}

}  // namespace

Flyers::Flyers(const Lan& lan, std::size_t host, const Exercise& exercise,
               std::vector<Motion> trajectory, const FlyersOptions& options)
    : options_(options), trajectory_(std::move(trajectory)) {
  const Lan::Visit visit = lan.visit(host);
  for (int peer = 0; peer < options.peers; ++peer) {
    subscriber::DdsChannelOptions channel_options;
    channel_options.transport.domain = exercise.domain;
    if (!exercise.security.empty())
      channel_options.transport.security = exercise.security + "/alice";
    auto channel = subscriber::DdsChannel::create(channel_options);
    must(channel.status());
    threads_.emplace_back(
        [this, peer, made = std::move(channel).value()]() mutable { fly(peer, std::move(made)); });
  }
}

Flyers::~Flyers() {
  ending_ = true;
  for (std::thread& thread : threads_) thread.join();
}

void Flyers::fly(int peer, std::unique_ptr<subscriber::DdsChannel> made) {
  subscriber::DdsChannel& channel = *made;
  subscriber::Session session(std::move(made), {.lookahead_s = 0, .max_held_splits = 3000});
  const auto ground = session.add_body({.name = "ground", .model = "terrain"});
  const auto own =
      session.add_body({.name = "flyer" + std::to_string(peer), .model = "aircraft", .own = true});
  must(ground.status());
  must(own.status());
  must(session.place_body(ground.value(), {}));
  must(session.watch(ground.value(), own.value()));
  const std::size_t rows = trajectory_.size();
  for (std::uint64_t frame = 0; !ending_; ++frame) {
    const double due_s = (static_cast<double>(frame) + static_cast<double>(peer) / options_.peers) /
                         options_.rate_hz;
    while (now_s() < due_s && !ending_)  // not wait(): the poses of the others would end it
      std::this_thread::sleep_for(std::chrono::duration<double>(std::min(due_s - now_s(), 0.1)));
    const std::size_t row =
        static_cast<std::size_t>(peer) * rows / static_cast<std::size_t>(options_.peers) + frame;
    Motion motion = trajectory_[row % rows];
    motion.pose.translation_m[1] += kApart_m * peer + kRound_m * static_cast<double>(row / rows);
    Answer answer{.peer = peer, .asked_s = now_s()};
    std::vector<subscriber::Session::OwnMotion> motions{{own.value(), motion}};
    while (!ending_) {
      const auto report = session.update(frame, due_s, motions, 0.01);
      must(report.status());
      motions.clear();
      answer.certified = report.value().all_certified();
      answer.certified_s = now_s();
      if (answer.certified || now_s() - answer.asked_s > options_.patience_s) break;
      answer.waited = true;
      channel.wait(0.02);
    }
    const std::lock_guard lock(mutex_);
    if (!ending_) answers_.push_back(answer);
  }
}

std::vector<Flyers::Answer> Flyers::take_answers() {
  const std::lock_guard lock(mutex_);
  return std::exchange(answers_, {});
}
Airspace::Airspace(const Exercise& exercise) : lan({{}, {}, {}}) {
  write_flights(folder, exercise, 200, kFlyRows_hz);
  publisher = serve(lan, folder, exercise);
  flyers = std::make_unique<Flyers>(
      lan, 1, exercise, read_trajectory(folder.file("flight1.csv"), kFlyRows_hz), FlyersOptions{});
}

}  // namespace nearmesh::test
