// SPDX-License-Identifier: Apache-2.0
#include "ros2_flight.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "idl/program/logging.hpp"

namespace nearmesh::subscriber::program {
namespace {

// Colours of the player: exact faces, coarse faces, contacts; and what is not known.
constexpr std::array<float, 4> kExact{0.13F, 0.27F, 0.60F, 1};
constexpr std::array<float, 4> kCoarse{0.78F, 0.82F, 0.86F, 1};
constexpr std::array<float, 4> kContact{1, 0, 1, 1};
constexpr std::array<float, 4> kUncertain{1, 0.65F, 0, 1};
constexpr double kWidthShare = 0.001;  ///< of lines, of what the smaller model's grid spans
constexpr double kMeshStep_s = 1;      ///< a body's mesh is drawn anew after this
constexpr std::size_t kMostFaces = 200'000;
constexpr std::uint32_t kLifetime_s = 2;  ///< of what is drawn each frame, if the frames end

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

bool are_equal(const Pose& a, const Pose& b) {
  return a.rotation == b.rotation && a.translation_m == b.translation_m;
}

}  // namespace

Result<std::unique_ptr<Ros2Flight>> Ros2Flight::create(const RunOptions& options,
                                                       const Scene& scene) {
  if (!options.ros2 && options.ros2_poses.empty()) return std::unique_ptr<Ros2Flight>();
  std::unique_ptr<Ros2Flight> flight(new Ros2Flight(options, scene));
  Ros2Options wanted{.transport = options.channel.transport,
                     .frame = options.ros2_frame,
                     .writes = options.ros2,
                     .moved = {}};
  if (options.ros2_domain) wanted.transport.domain = *options.ros2_domain;
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
    heard_stamp_ns_ = std::max(heard_stamp_ns_, heard.stamp_ns);
    for (const auto& [body, moved] : moved_)
      if (moved == heard.moved)
        motions.push_back({BodyId{static_cast<std::uint32_t>(body)}, heard.motion});
  }
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
  for (const BodyId body : report.went) bodies_.erase(body);
  for (const BodyId body : report.came) bodies_[body];
  if (!options_.ros2 || clock_.seconds() - shown_s_ < 1 / kMostShown_hz) return;
  shown_s_ = clock_.seconds();
  // Where poses come from ROS 2, so does its time: that of a simulator, perhaps.
  Ros2View view{.stamp_ns = heard_stamp_ns_ != 0 ? heard_stamp_ns_ : now_ns()};
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

/// Where they touch; and a line from one body to the other where that is not certified, since nothing is drawn where all is free.
void Ros2Flight::add_marks(const PairAnswer& pair, const Session& session, Ros2View& view) {
  const std::string name = session.name_of(pair.a) + " " + session.name_of(pair.b);
  const auto number =
      pairs_.try_emplace({pair.a, pair.b}, static_cast<std::int32_t>(pairs_.size() + 1))
          .first->second;
  double width_m = 0.01;
  const SpmHeader *a = session.header_of(pair.a), *b = session.header_of(pair.b);
  if (a != nullptr && b != nullptr)
    width_m = kWidthShare * std::ldexp(1, 21 + std::min(a->grid.exponent, b->grid.exponent));
  ros2::Marker marker{.frame = options_.ros2_frame,
                      .name_space = name,
                      .id = number,
                      .kind = ros2::Marker::Kind::kLineList,
                      .width_m = width_m,
                      .rgba = kContact,
                      .lifetime_s = kLifetime_s,
                      .points_m = {}};
  if (pair.contacts)
    for (const ContactSegment& segment : pair.contacts->segments) {
      marker.points_m.push_back(segment.p_m);
      marker.points_m.push_back(segment.q_m);
    }
  if (!marker.points_m.empty()) view.contacts.push_back(marker);
  const auto motion_a = session.motion_of(pair.a), motion_b = session.motion_of(pair.b);
  if (is_certified(pair.answer.status) || !motion_a || !motion_b) return;
  marker.name_space = name + " uncertain";
  marker.rgba = kUncertain;
  marker.points_m = {motion_a->pose.translation_m, motion_b->pose.translation_m};
  view.contacts.push_back(std::move(marker));
}

/// Where a body was last, of which nothing is known now: its pairs are not in the answers, and all are uncertain.
void Ros2Flight::add_cross(BodyId body, const Session& session, Ros2View& view) const {
  const std::optional<Motion> motion = session.motion_of(body);
  if (!motion) return;
  const SpmHeader* header = session.header_of(body);
  const double span_m = header == nullptr ? 10 : std::ldexp(1, 21 + header->grid.exponent);
  ros2::Marker marker{.frame = options_.ros2_frame,
                      .name_space = session.name_of(body) + " unknown",
                      .id = 0,
                      .kind = ros2::Marker::Kind::kLineList,
                      .width_m = kWidthShare * span_m,
                      .rgba = kUncertain,
                      .lifetime_s = kLifetime_s,
                      .points_m = {}};
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const double side : {-0.1, 0.1}) {
      marker.points_m.push_back(motion->pose.translation_m);
      marker.points_m.back()[axis] += side * span_m;
    }
  view.contacts.push_back(std::move(marker));
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
        now_s - shown.at_s < kMeshStep_s)
      continue;
    shown.state = state;
    shown.readers = readers.came;
    shown.at_s = now_s;
    auto held = session.held_mesh(body);
    if (!held.is_ok()) continue;
    const std::string name = session.name_of(body);
    ros2::Marker exact{.frame = name,
                       .name_space = name + " exact",
                       .id = 0,
                       .kind = ros2::Marker::Kind::kTriangleList,
                       .rgba = kExact,
                       .points_m = std::move(held.value().exact_m)};
    ros2::Marker coarse = exact;
    coarse.name_space = name + " coarse";
    coarse.rgba = kCoarse;
    coarse.points_m = std::move(held.value().coarse_m);
    if (exact.points_m.size() + coarse.points_m.size() > 3 * kMostFaces) {
      wire::program::log("session").warn("ros2: {} has more than {} faces here: not drawn", name,
                                         kMostFaces);
      continue;
    }
    view.meshes = {std::move(exact), std::move(coarse)};
    return;
  }
}

}  // namespace nearmesh::subscriber::program
