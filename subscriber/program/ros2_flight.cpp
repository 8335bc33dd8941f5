// SPDX-License-Identifier: Apache-2.0
#include "ros2_flight.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "ros2_marks.hpp"

namespace nearmesh::subscriber::program {
namespace {

bool are_equal(const Pose& a, const Pose& b) {
  return a.rotation == b.rotation && a.translation_m == b.translation_m;
}

}  // namespace

std::int64_t stamp_after(std::int64_t shown_ns, std::int64_t heard_ns) {
  constexpr std::int64_t kAnew_ns = 1'000'000'000;
  if (heard_ns == 0) return shown_ns;
  return heard_ns > shown_ns || shown_ns - heard_ns > kAnew_ns ? heard_ns : shown_ns;
}

void Ros2Jumps::take_out(Session& session, double time_s, std::vector<Session::OwnMotion>& motions,
                         std::vector<std::string>& complaints) {
  std::erase_if(motions, [&](const Session::OwnMotion& own) {
    const Status kept = session.check_promised(own.body, own.motion, time_s);
    if (kept.is_ok()) {
      jumped_.erase(own.body);
      return false;
    }
    if (!jumped_.insert(own.body).second) return true;
    const Status forgotten = session.forget_pose(own.body);
    complaints.push_back("ros2: " + kept.message() +
                         (forgotten.is_ok() ? "; nothing about it is certified until these end"
                                            : "; " + forgotten.message()));
    return true;
  });
}

Result<std::unique_ptr<Ros2Flight>> Ros2Flight::create(const RunOptions& options,
                                                       const Scene& scene) {
  if (!options.ros2.is_wanted && options.ros2_poses.empty()) return std::unique_ptr<Ros2Flight>();
  std::unique_ptr<Ros2Flight> flight(new Ros2Flight(options, scene));
  Ros2Options wanted{.transport = options.channel.transport,
                     .frame = options.ros2.frame,
                     .writes = options.ros2.is_wanted,
                     .moved = {}};
  if (options.ros2.domain) wanted.transport.domain = *options.ros2.domain;
  for (const std::string& text : options.ros2_poses) {
    auto parsed = parse_ros2_body(text);
    if (!parsed.is_ok())
      return Status{parsed.status().code(), "--ros2-poses " + parsed.status().message()};
    Ros2Body& body = wanted.moved.emplace_back(std::move(parsed).value());
    const auto at =
        std::find_if(scene.bodies.begin(), scene.bodies.end(),
                     [&](const BodyOfScene& of_scene) { return of_scene.name == body.body; });
    if (at == scene.bodies.end())
      return Status{StatusCode::kInvalidArgument,
                    "--ros2-poses: no body of the scene is named " + body.body};
    if (!at->trajectory.empty() || at->fixed_pose)
      return Status{StatusCode::kInvalidArgument,
                    "--ros2-poses: the scene itself says where " + body.body + " is"};
    const auto place = static_cast<std::size_t>(at - scene.bodies.begin());
    if (!flight->moved_.emplace(place, wanted.moved.size() - 1).second)
      return Status{StatusCode::kInvalidArgument, "--ros2-poses: " + body.body + " is named twice"};
  }
  for (std::size_t i = 0; i < scene.bodies.size(); ++i)
    flight->bodies_[BodyId{static_cast<std::uint32_t>(i)}] = {};
  auto bridge = Ros2Bridge::create(wanted);
  NEARMESH_RETURN_IF_ERROR(bridge);
  flight->bridge_ = std::move(bridge).value();
  return flight;
}

bool Ros2Flight::moves(std::size_t body) const { return moved_.contains(body); }

void Ros2Flight::add_motions(std::vector<Session::OwnMotion>& motions) {
  for (const Ros2Bridge::Heard& heard : bridge_->take_heard()) {
    heard_stamp_ns_ = stamp_after(heard_stamp_ns_, heard.stamp_ns);
    for (const auto& [body, moved] : moved_)
      if (moved == heard.moved)
        motions.push_back({BodyId{static_cast<std::uint32_t>(body)}, heard.motion});
  }
}

std::vector<std::string> Ros2Flight::take_complaints() {
  std::vector<std::string> all = std::exchange(complaints_, {});
  for (std::string& line : bridge_->take_complaints()) all.push_back(std::move(line));
  return all;
}

/// Those of which it is known where they are now. One that falls silent is not shown where it was.
std::vector<BodyId> Ros2Flight::fresh_bodies(const FrameReport& report, const Session& session) {
  std::set<BodyId> known;
  for (const PairAnswer& pair : report.answers)
    if (pair.asked || pair.put_off) known.insert({pair.a, pair.b});
  if (scene_.watches_all) {
    std::set<BodyId> unknown;
    for (const UnknownBody& one : report.unknown) unknown.insert(one.body);
    for (const auto& [body, shown] : bodies_)
      if (!unknown.contains(body)) known.insert(body);
  }
  std::vector<BodyId> fresh;
  for (auto& [body, shown] : bodies_) {
    const std::optional<Motion> motion = session.motion_of(body);
    if (!motion) continue;
    if (known.contains(body) || !shown.has_pose || !are_equal(shown.pose, motion->pose))
      fresh.push_back(body);
    shown.pose = motion->pose;
    shown.has_pose = true;
  }
  return fresh;
}

void Ros2Flight::show(const FrameReport& report, const Session& session) {
  for (const BodyId body : report.went) {
    bodies_.erase(body);
    std::erase_if(pairs_, [body](const auto& entry) {
      return entry.first.first == body || entry.first.second == body;
    });
  }
  for (const BodyId body : report.came) bodies_[body];
  if (!options_.ros2.is_wanted || clock_.seconds() - shown_s_ < 1 / kMostShown_hz) return;
  shown_s_ = clock_.seconds();
  // Where poses come from ROS 2, so does its time: that of a simulator, perhaps.
  Ros2View view{.stamp_ns = heard_stamp_ns_ != 0 ? heard_stamp_ns_ : ros2_now_ns()};
  for (const BodyId body : fresh_bodies(report, session)) {
    const ros2::Transform at{session.name_of(body), session.motion_of(body)->pose};
    const std::size_t place = body.value;
    if (place < scene_.bodies.size() && scene_.bodies[place].fixed_pose) {
      view.placed.push_back(at);
      continue;
    }
    // Who is on /tf already is left to those who say it.
    const auto moved = moved_.find(place);
    if (moved == moved_.end() ||
        parse_ros2_body(options_.ros2_poses[moved->second]).value().frame != at.child_frame)
      view.moving.push_back(at);
  }
  for (const PairAnswer& pair : report.answers) add_marks(pair, session, view);
  for (const UnknownBody& unknown : report.unknown) add_cross(unknown.body, session, view);
  add_mesh(session, view);
  bridge_->tell(std::move(view));
}

void Ros2Flight::add_marks(const PairAnswer& pair, const Session& session, Ros2View& view) {
  const auto [numbered, is_new] = pairs_.try_emplace({pair.a, pair.b});
  if (is_new) numbered->second = ++numbered_;
  LineMark mark{.frame = options_.ros2.frame,
                .name = session.name_of(pair.a) + " " + session.name_of(pair.b),
                .id = numbered->second};
  const SpmHeader *a = session.header_of(pair.a), *b = session.header_of(pair.b);
  if (a != nullptr && b != nullptr)
    mark.width_m = line_width_m(std::min(a->grid.exponent, b->grid.exponent));
  if (pair.contacts && !pair.contacts->segments.empty())
    view.contacts.push_back(contact_mark(mark, pair.contacts->segments));
  const auto motion_a = session.motion_of(pair.a), motion_b = session.motion_of(pair.b);
  if (is_certified(pair.answer.status) || !motion_a || !motion_b) return;
  view.contacts.push_back(
      uncertain_mark(mark, motion_a->pose.translation_m, motion_b->pose.translation_m));
}

/// Where a body was last, of which nothing is known now: its pairs are not in the answers, and all
/// are uncertain.
void Ros2Flight::add_cross(BodyId body, const Session& session, Ros2View& view) const {
  const std::optional<Motion> motion = session.motion_of(body);
  if (!motion) return;
  const SpmHeader* header = session.header_of(body);
  LineMark mark{.frame = options_.ros2.frame, .name = session.name_of(body)};
  if (header != nullptr) mark.width_m = line_width_m(header->grid.exponent);
  const double span_m = header == nullptr ? 10 : std::ldexp(1, 21 + header->grid.exponent);
  view.contacts.push_back(unknown_mark(mark, motion->pose.translation_m, span_m));
}

/// Of one body at most, since it costs more than all the rest.
void Ros2Flight::add_mesh(const Session& session, Ros2View& view) {
  const Ros2Bridge::MeshReaders readers = bridge_->mesh_readers();
  if (!readers.are_there) return;
  const double now_s = clock_.seconds();
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    auto at = bodies_.upper_bound(BodyId{next_mesh_});
    if (at == bodies_.end()) at = bodies_.begin();
    auto& [body, shown] = *at;
    next_mesh_ = body.value;
    const std::uint64_t state = session.held_state(body);
    if (state == 0 || (state == shown.state && readers.came == shown.readers) ||
        now_s - shown.at_s < kRos2MeshStep_s)
      continue;
    shown.state = state;
    shown.readers = readers.came;
    shown.at_s = now_s;
    auto held = session.held_mesh(body);
    if (!held.is_ok()) continue;
    view.meshes = mesh_marks(session.name_of(body), std::move(held.value().exact_m),
                             std::move(held.value().coarse_m));
    if (view.meshes.empty()) continue;
    return;
  }
}

}  // namespace nearmesh::subscriber::program
