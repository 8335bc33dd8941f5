// SPDX-License-Identifier: Apache-2.0
#include "probe_peer.hpp"

#include <chrono>
#include <cmath>
#include <stdexcept>
#include <thread>

#include "nearmesh/core/query/query.hpp"

namespace nearmesh::test {

ProbePeer::Full ProbePeer::load(const std::string& path) {
  Result<ModelFile> file = ModelFile::open(path);
  if (!file.is_ok()) throw std::runtime_error(file.status().message());
  if (const Status status = file.value().require_all(); !status.is_ok())
    throw std::runtime_error(status.message());
  auto tree = build_full_tree(file.value().header(), file.value().store());
  if (!tree) throw std::runtime_error(path + ": a split is missing");
  return {std::make_unique<ModelFile>(std::move(file).value()), std::move(*tree)};
}

ProbePeer::ProbePeer(const Lan& lan, std::size_t host, const Exercise& exercise)
    : ground_(load(exercise.models.at(0))), aircraft_(load(exercise.models.at(1))) {
  subscriber::DdsChannelOptions options;
  options.transport.domain = exercise.domain;
  const Lan::Visit visit = lan.visit(host);
  auto channel = subscriber::DdsChannel::create(options);
  if (!channel.is_ok()) throw std::runtime_error(channel.status().message());
  session_ = std::make_unique<subscriber::Session>(std::move(channel).value());
  const auto ground = session_->add_body({.name = "ground", .model = "terrain"}).value();
  own_ = session_->add_body({.name = "probe", .model = "aircraft", .own = true}).value();
  for (const Status& status : {session_->place_body(ground, {}), session_->watch(ground, own_)})
    if (!status.is_ok()) throw std::runtime_error(status.message());
}

double ProbePeer::certify_at(std::uint32_t number, double seconds) {
  const SplitStore& store = ground_.file->store();
  const Grid& grid = ground_.tree.grid;
  // A step of an odd prime through the vertices, which are numbered along the surface.
  const VertexId vertex{static_cast<std::uint32_t>(number * 7919ULL * 31 % store.vertex_count())};
  const GridPoint place = store.position(vertex);
  Motion motion;
  for (std::size_t k = 0; k < 3; ++k)
    motion.pose.translation_m[k] =
        grid.origin_m[k] + std::ldexp(static_cast<double>(place.v[k]), grid.exponent);
  const Stopwatch watch;
  for (bool moved = false;; moved = true) {
    std::vector<subscriber::Session::OwnMotion> motions;
    if (!moved) motions.push_back({own_, motion});
    auto report = session_->update(++frame_, clock_.seconds(), motions, 0.01);
    if (!report.is_ok()) throw std::runtime_error(report.status().message());
    const subscriber::PairAnswer& answer = report.value().answers.at(0);
    if (is_certified(answer.answer.status)) {
      check(answer);
      return watch.seconds();
    }
    reason_ = answer.reason;
    if (watch.seconds() > seconds) return -1;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

void ProbePeer::check(const subscriber::PairAnswer& answer) {
  const auto posed =
      pose_pair(ground_.tree.grid, answer.pose_a, "a", aircraft_.tree.grid, answer.pose_b, "b");
  if (!posed.is_ok()) throw std::runtime_error(posed.status().message());
  const Answer full = query(ground_.tree.view(), posed.value().a, aircraft_.tree.view(),
                            posed.value().b, {.clearance = Clearance::kNone});
  if (full.status != answer.answer.status || full.pairs != answer.answer.pairs) ++wrong_;
}

}  // namespace nearmesh::test
