// SPDX-License-Identifier: Apache-2.0
#include "ros2_watch.hpp"

#include <algorithm>

#include "core/query/answer.hpp"
#include "ros2_marks.hpp"

namespace nearmesh::subscriber::program {
namespace {

/// An answer holds for so long when no other follows: as long as the lines about it would stay by
/// themselves.
constexpr std::int64_t kHolds_ns = 2'000'000'000;
/// What a peer answers about a body may come before what its mover says. Bodies at rest are spoken
/// of twice a second.
constexpr double kUntilPlaced_s = 2;

bool is_same(const Pose& a, const Pose& b) {
  return a.rotation == b.rotation && a.translation_m == b.translation_m;
}

}  // namespace

Result<std::unique_ptr<Ros2Watch>> Ros2Watch::create(const WatchOptions& options) {
  Ros2Options wanted{
      .transport = options.transport, .frame = options.ros2.frame, .writes = true, .moved = {}};
  if (options.ros2.domain) wanted.transport.domain = *options.ros2.domain;
  std::unique_ptr<Ros2Watch> watch(new Ros2Watch(options));
  auto bridge = Ros2Bridge::create(wanted);
  NEARMESH_RETURN_IF_ERROR(bridge);
  watch->bridge_ = std::move(bridge).value();
  return watch;
}

void Ros2Watch::see(const std::string& name, const Pose& pose, std::int64_t received_ns) {
  latest_ns_ = std::max(latest_ns_, received_ns);
  Body& body = bodies_[name];
  body.pose = pose;
  body.has_mover = body.is_new = true;
  body.is_placed = false;
}

/// Of bodies that no mover speaks of on this bus: they are in place, or a host hears of them
/// otherwise.
void Ros2Watch::place(const std::string& name, const wire::ContactReport::Asked& asked) {
  const auto [at, is_new] = bodies_.try_emplace(name);
  Body& body = at->second;
  if (body.has_mover) return;
  if (is_new) body.since_s = clock_.seconds();
  body.is_placed = body.is_placed && (is_new || is_same(body.pose, asked.pose));
  body.pose = asked.pose;
  body.is_new = true;
}

void Ros2Watch::see(const wire::ContactReport& report, std::int64_t received_ns,
                    const std::optional<Held>& held) {
  latest_ns_ = std::max(latest_ns_, received_ns);
  if (report.asked) {
    place(report.body_a, report.a);
    place(report.body_b, report.b);
  }
  Peer& peer = peers_[report.peer];
  peer.at_ns = received_ns;
  peer.pairs[{report.body_a, report.body_b}] = {received_ns, report.put_off,
                                                marks_of(report, held)};
  if (!held) return;
  draw(report.body_a, report.peer, held->a);
  draw(report.body_b, report.peer, held->b);
}

std::vector<ros2::Marker> Ros2Watch::marks_of(const wire::ContactReport& report,
                                              const std::optional<Held>& held) {
  const auto number = numbers_
                          .try_emplace({report.peer, report.body_a, report.body_b},
                                       static_cast<std::int32_t>(numbers_.size() + 1))
                          .first->second;
  LineMark mark{.frame = frame_, .name = report.body_a + " " + report.body_b, .id = number};
  if (held) mark.width_m = line_width_m(std::min(held->a.exponent(), held->b.exponent()));
  const auto at = [&](const std::string& name, const wire::ContactReport::Asked& asked) {
    if (report.asked) return std::optional(asked.pose.translation_m);
    const auto known = bodies_.find(name);
    return known == bodies_.end() ? std::nullopt : std::optional(known->second.pose.translation_m);
  };
  const auto a_m = at(report.body_a, report.a), b_m = at(report.body_b, report.b);
  std::vector<ros2::Marker> marks;
  if (report.asked && report.pair_count > 0) {
    // That they touch is known where the place is not.
    const bool has_place = held && held->contacts != nullptr && !held->contacts->segments.empty();
    ContactSegment across;
    across.p_m = *a_m;
    across.q_m = *b_m;
    marks.push_back(contact_mark(mark, has_place ? held->contacts->segments : std::vector{across}));
  }
  if (!is_certified(static_cast<AnswerStatus>(report.status)) && a_m && b_m)
    marks.push_back(uncertain_mark(mark, *a_m, *b_m));
  return marks;
}

/// As one peer holds it: who spoke of it first, until he falls silent.
void Ros2Watch::draw(const std::string& name, wire::SessionId peer, const HeldBody& held) {
  const Ros2Bridge::MeshReaders readers = bridge_->mesh_readers();
  if (!readers.are_there) return;
  Body& body = bodies_[name];
  if (body.of != peer && peers_.contains(body.of)) return;
  const std::uint64_t state = held.state();
  if ((body.of == peer && body.state == state && body.readers == readers.came) ||
      clock_.seconds() - body.drawn_s < kRos2MeshStep_s)
    return;
  body.of = peer;
  body.state = state;
  body.readers = readers.came;
  body.drawn_s = clock_.seconds();
  std::vector<std::array<double, 3>> exact_m, coarse_m;
  held.add_triangles(exact_m, coarse_m);
  for (ros2::Marker& mark : mesh_marks(name, std::move(exact_m), std::move(coarse_m)))
    meshes_.push_back(std::move(mark));
}

void Ros2Watch::show() {
  if (latest_ns_ == 0) return;
  const std::int64_t since_ns = ros2_now_ns() - kHolds_ns;
  std::erase_if(peers_, [&](const auto& peer) { return peer.second.at_ns < since_ns; });
  Ros2View view{.stamp_ns = latest_ns_};
  for (auto& [name, body] : bodies_) {
    if (body.is_placed) {
      if (clock_.seconds() - body.since_s > kUntilPlaced_s)
        view.placed.push_back({name, body.pose});
    } else if (body.is_new) {
      view.moving.push_back({name, body.pose});
    }
    body.is_new = false;
  }
  for (auto& [id, peer] : peers_) {
    // A pair that is put off is said once, until its turn comes.
    std::erase_if(peer.pairs, [&](const auto& pair) {
      return pair.second.at_ns < since_ns && !pair.second.is_put_off;
    });
    for (const auto& [bodies, said] : peer.pairs)
      view.contacts.insert(view.contacts.end(), said.marks.begin(), said.marks.end());
  }
  view.meshes = std::move(meshes_);
  meshes_.clear();
  bridge_->tell(std::move(view));
}

}  // namespace nearmesh::subscriber::program
