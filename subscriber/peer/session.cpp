// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "pair_readiness.hpp"
#include "region_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// A sweep may take some twenty milliseconds, then it says what it knows.
constexpr std::uint64_t kMaxSweepTests = 200'000;

/// An own body at rest is published again after this share of max_pose_age_s: of the rest half may be lost on the way, and
/// the frames of neither side need to be frequent.
constexpr double kRepeatShare = 0.25;

Status no_such(BodyId body) {
  return {StatusCode::kNotFound, "body " + (body.is_valid() ? std::to_string(body.value) : "none") +
                                     " is not of this session"};
}

}  // namespace

bool FrameReport::all_certified() const {
  return std::all_of(answers.begin(), answers.end(),
                     [](const PairAnswer& a) { return is_certified(a.answer.status); });
}

Session::Session(std::unique_ptr<Channel> channel, SessionOptions options)
    : impl_(std::make_unique<Impl>()) {
  NEARMESH_ASSERT(options.sweep_s >= 0);
  NEARMESH_ASSERT(options.max_pose_age_s >= 0);
  impl_->channel = std::move(channel);
  impl_->replicas.use_cache(options.cache_folder);
  impl_->options = options;
  impl_->audits = Random(options.audit_seed != 0 ? options.audit_seed : std::random_device{}());
}
Session::~Session() { static_cast<void>(impl_->replicas.write_caches()); }

Status Session::write_cache() { return impl_->replicas.write_caches(); }

Result<BodyId> Session::add_body(BodyOptions options) {
  const FloatGuard guard;
  for (const std::string& text : {options.name, options.model})
    if (text.empty() || text.size() > wire::kMaxNameBytes)
      return Status{
          StatusCode::kInvalidArgument,
          "name '" + text + "': expected 1 to " + std::to_string(wire::kMaxNameBytes) + " bytes"};
  const double max_age_s = options.max_pose_age_s.value_or(
      options.own ? std::numeric_limits<double>::infinity() : impl_->options.max_pose_age_s);
  if (!(max_age_s >= 0))
    return Status{StatusCode::kInvalidArgument, "body " + options.name + ": max_pose_age_s is " +
                                                    std::to_string(max_age_s) +
                                                    ", expected seconds, not negative"};
  const BodyId id{static_cast<std::uint32_t>(impl_->bodies.size())};
  NEARMESH_RETURN_IF_ERROR(impl_->check_pin(options));
  if (!impl_->named.emplace(options.name, id).second)
    return Status{StatusCode::kConflict, "body " + options.name + " is declared twice"};
  PeerModel& model = impl_->replicas.add(options.model);
  if (options.content.is_set()) model.pinned = options.content;
  impl_->bodies.push_back({.id = id,
                           .name = std::move(options.name),
                           .model = &model,
                           .own = options.own,
                           .solid = options.solid,
                           .stamp = {.max_age_s = max_age_s}});
  impl_->has_news = true;
  return id;
}

/// One content for each model that is pinned, and one model for each content: a replica belongs to both.
Status Session::Impl::check_pin(const BodyOptions& body) const {
  if (!body.content.is_set()) return Status::ok();
  const std::string pins = "body " + body.name + " pins model " + body.model + " to content " +
                           to_hex(body.content) + ", another body ";
  for (const auto& [name, model] : replicas.all()) {
    if (name == body.model && model.pinned.is_set() && model.pinned != body.content)
      return {StatusCode::kConflict, pins + "to " + to_hex(model.pinned)};
    if (name != body.model && model.pinned == body.content)
      return {StatusCode::kConflict, pins + "model " + name + " to the same"};
  }
  return Status::ok();
}

Status Session::place_body(BodyId body, const Pose& pose) {
  const FloatGuard guard;
  Body* placed = impl_->find(body);
  if (placed == nullptr) return no_such(body);
  NEARMESH_RETURN_IF_ERROR(check_pose(pose, placed->name));
  placed->motion = Motion{.pose = pose};
  placed->stamp.mover = wire::Mover::kThere;
  placed->is_placed = true;
  for (Impl::Pair& pair : impl_->pairs)
    if (pair.has(*placed)) pair.last = not_asked(pair.names());
  return Status::ok();
}

Result<PairId> Session::watch(BodyId a, BodyId b) {
  for (const BodyId body : {a, b})
    if (impl_->find(body) == nullptr) return no_such(body);
  if (a == b) return Status{StatusCode::kInvalidArgument, "body " + name_of(a) + " against itself"};
  Impl::Pair pair{.a = impl_->find(a), .b = impl_->find(b)};
  pair.last = not_asked(pair.names());
  impl_->pairs.push_back(std::move(pair));
  return PairId{static_cast<std::uint32_t>(impl_->pairs.size() - 1)};
}

std::string Session::name_of(BodyId body) const {
  const Body* named = impl_->find(body);
  return named == nullptr ? std::string() : named->name;
}

Result<FrameReport> Session::update(std::uint64_t frame, double time_s,
                                    const std::vector<OwnMotion>& motions, double budget_s) {
  const FloatGuard guard;
  Impl& impl = *impl_;
  for (const OwnMotion& own : motions) {
    const Body* body = impl.find(own.body);
    if (body == nullptr) return no_such(own.body);
    if (!body->own)
      return Status{StatusCode::kNotFound, body->name + " is not a body that this peer moves"};
    NEARMESH_RETURN_IF_ERROR(check_motion(own.motion, body->name));
  }
  if (!wire::is_time(time_s))  // it goes out with every pose
    return Status{StatusCode::kInvalidArgument, "time_s of frame " + std::to_string(frame) +
                                                    " is " + std::to_string(time_s) +
                                                    ", expected seconds, at most " +
                                                    std::to_string(wire::kMaxTime_s) + " from 0"};
  const Stopwatch spent;
  FrameReport report;
  if (impl.has_updated && time_s < impl.time_s)
    report.complaints.push_back("time_s of frame " + std::to_string(frame) + " is " +
                                std::to_string(time_s) + ", before it was " +
                                std::to_string(impl.time_s) + ": the exercise's clock went back");
  impl.frame_s = impl.has_updated ? std::max(0.0, time_s - impl.time_s) : 0;
  impl.has_updated = true;
  impl.time_s = time_s;
  for (const OwnMotion& own : motions) {
    Body& body = *impl.find(own.body);
    body.motion = own.motion;
    body.is_placed = false;
    body.stamp.mover = wire::Mover::kThere;
    body.stamp.time_s = time_s;
    impl.publish(body, frame);
  }
  for (Body& body : impl.bodies)
    if (body.own && body.motion && !body.is_placed && is_at_rest(*body.motion) &&
        std::abs(time_s - body.published_s) >= kRepeatShare * impl.options.max_pose_age_s)
      impl.publish(body, frame);
  impl.take_inbox(report);
  impl.replicas.read_caches(report.complaints);
  while (impl.replicas.apply_one(report) && spent.seconds() < budget_s) {
  }
  for (const auto& [name, model] : impl.replicas.all())
    report.batches_waiting += model.waiting.size();
  for (const auto& [name, model] : impl.replicas.all())
    report.state_digest =
        mix(report.state_digest ^ (model.is_ready() ? model.replica->mesh().state_hash() + 1 : 0));
  for (std::uint32_t i = 0; i < impl.pairs.size(); ++i) impl.answer_pair(PairId{i}, frame, report);
  impl.ask(report);
  if (impl.options.max_held_splits > 0)
    for (auto& [name, model] : impl.replicas.all())
      if (model.is_ready() && model.replica->mesh().split_count() > impl.options.max_held_splits)
        impl.give_up(model, report);
  impl.tell_held(report);
  for (const std::string& line : report.complaints) impl.keeper.note(line, impl.clock.seconds());
  if (impl.keeper.is_due(impl.clock.seconds())) impl.tell_status(report, stats());
  return report;
}

void Session::Impl::publish(Body& body, std::uint64_t frame) {
  wire::BodyPose pose;
  pose.peer = channel->own_id();
  pose.body = body.name;
  pose.frame = frame;
  pose.time_s = time_s;
  pose.pose = body.motion->pose;
  pose.linear_velocity_mps = body.motion->linear_velocity_mps;
  pose.angular_velocity_radps = body.motion->angular_velocity_radps;
  channel->send(pose);
  body.published_s = time_s;
}

/// A body in place is where it is, and so is an own one at rest until the host moves it: their poses are of now.
wire::PoseStamp Session::Impl::stamp_of(const Body& body) const {
  wire::PoseStamp stamp = body.stamp;
  if (body.is_placed || (body.own && body.motion && is_at_rest(*body.motion)))
    stamp.time_s = time_s;
  return stamp;
}

void Session::Impl::give_up(PeerModel& model, FrameReport& report) {
  const Replica::Times times = model.replica->give_up(kept_of(model, report));
  model.tells_held = true;
  model.is_too_much_to_tell = false;
  report.refine_s += times.refine_s;
  report.tree_s += times.tree_s;
}

/// Why no base mesh of a model is here.
std::string Session::Impl::why_no_mesh(const PeerModel& model) const {
  const bool is_served = std::any_of(publishers.begin(), publishers.end(), [&](const auto& entry) {
    return entry.second.serves(model.content_hash) && replicas.refused_of(model.content_hash) == 0;
  });
  if (is_served) return "its header has not come";
  if (!model.conflict.empty()) return model.conflict;
  if (publishers.empty()) return "no publisher found";
  if (!model.pinned.is_set()) return "no publisher serves it";
  return "no publisher serves content " + to_hex(model.pinned) + ", which is pinned";
}

std::string Session::Impl::why_not_ready(const Body& body) const {
  if (!body.model->is_ready())
    return "model " + body.model->name + " of body " + body.name + ": " + why_no_mesh(*body.model);
  if (body.solid)
    if (const Status status = check_solid(body.model->replica->header().surface, body.name);
        !status.is_ok())
      return status.message();
  return wire::why_stale(stamp_of(body), time_s, body.name);
}

namespace {

void take_answer(Answered&& all, PairAnswer& result, std::vector<std::string>& complaints) {
  result.answer = std::move(all.answer);
  result.contacts = std::move(all.contacts);
  result.safe_horizon_s = all.safe_horizon_s;
  if (!all.swept) return;
  if (all.swept->is_ok()) {
    result.swept = std::move(*all.swept).value();
  } else {
    complaints.push_back("no swept answer: " + all.swept->status().message());
  }
}

}  // namespace

void Session::Impl::answer_pair(PairId id, std::uint64_t frame, FrameReport& report) {
  Pair& pair = pairs[id.value];
  PairAnswer result{.pair = id, .a = pair.a->id, .b = pair.b->id, .answer = nothing_known()};
  result.content_a = pair.a->model->content_hash;
  result.content_b = pair.b->model->content_hash;
  result.age_a_s = wire::age_s(stamp_of(*pair.a), time_s);
  result.age_b_s = wire::age_s(stamp_of(*pair.b), time_s);
  result.reason = why_not_ready(*pair.a);
  if (result.reason.empty()) result.reason = why_not_ready(*pair.b);
  if (result.reason.empty()) {
    const Stopwatch watch;
    const auto body = [](const Body& of, double age_s) {
      return AskedBody{of.model->replica->view(), *of.motion, of.name, of.solid, age_s};
    };
    const AskedBody a = body(*pair.a, result.age_a_s), b = body(*pair.b, result.age_b_s);
    result.pose_a = a.motion.pose;
    result.pose_b = b.motion.pose;
    Result<Answered> asked = answer(a, b,
                                    {.contacts = options.contacts,
                                     .sweep_s = options.sweep_s,
                                     .max_sweep_tests = kMaxSweepTests});
    if (asked.is_ok()) {
      result.asked = true;
      take_answer(std::move(asked).value(), result, report.complaints);
      if (is_beyond_detail(result.answer))
        result.reason = "body " + (a.view.surface->has_seeds() ? pair.b : pair.a)->name +
                        " has more than " + std::to_string(kMaxComponentSeeds) +
                        " parts: whether one is inside the other body cannot be told";
    } else {
      result.reason = asked.status().message();
    }
    report.query_s += watch.seconds();
  }
  if (result.reason.empty() && !is_certified(result.answer.status)) {
    result.awaited = awaited_of(*pair.a->model, result.answer.missing_a.size());
    const std::string more = awaited_of(*pair.b->model, result.answer.missing_b.size());
    if (!result.awaited.empty() && !more.empty()) result.awaited += "; ";
    result.awaited += more;
  }
  pair.last = readiness_of(result, pair.names());
  const std::uint64_t answer_digest = digest(result.answer);
  report.answers_digest = mix(report.answers_digest ^ answer_digest);
  if (options.publish_reports) report_pair(pair, result, {frame, answer_digest});
  report.answers.push_back(std::move(result));
}

Result<Readiness> Session::readiness(BodyId body) const {
  const FloatGuard guard;
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  Readiness all{.stage = ReadyStage::kCertified};
  for (const Impl::Pair& pair : impl_->pairs)
    if (pair.has(*asked)) add_pair(all, pair.last);
  if (all.pairs == 0)
    return Readiness{.reason = "body " + asked->name + " is watched against nothing"};
  return all;
}

Result<RegionReadiness> Session::region_readiness(BodyId body, const std::array<double, 3>& lo_m,
                                                  const std::array<double, 3>& hi_m) const {
  const FloatGuard guard;
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  for (std::size_t k = 0; k < 3; ++k)
    if (!std::isfinite(lo_m[k]) || !std::isfinite(hi_m[k]) || lo_m[k] > hi_m[k])
      return Status{StatusCode::kInvalidArgument,
                    "region of body " + asked->name + ": from " + std::to_string(lo_m[k]) + " to " +
                        std::to_string(hi_m[k]) + " m on axis " + std::to_string(k) +
                        ", expected finite numbers in ascending order"};
  const PeerModel& model = *asked->model;
  if (!model.is_ready())
    return RegionReadiness{.uncertainty_m = std::numeric_limits<double>::infinity(),
                           .reason = impl_->why_not_ready(*asked)};
  return lacks_in_box(model.replica->view(), lo_m, hi_m);
}

const SpmHeader* Session::header_of(BodyId body) const {
  const Body* asked = impl_->find(body);
  if (asked == nullptr || !asked->model->is_ready()) return nullptr;
  return &asked->model->replica->header();
}

std::optional<Motion> Session::motion_of(BodyId body) const {
  const Body* asked = impl_->find(body);
  return asked == nullptr ? std::nullopt : asked->motion;
}

std::optional<double> Session::heard_time_s() const { return impl_->heard_time_s; }

const wire::ProcessStatus& Session::status() const { return impl_->told; }

SessionStats Session::stats() const {
  SessionStats stats = impl_->stats;
  for (const auto& [name, model] : impl_->replicas.all()) {
    stats.mesh_bytes += model.mesh_bytes;
    if (!model.is_ready()) continue;
    const AbTreeStats tree = model.replica->tree().stats();
    stats.held_splits += model.replica->mesh().split_count();
    stats.slots += tree.slots;
    stats.exact_faces += tree.exact_faces;
    stats.tree_bytes += tree.bytes;
  }
  return stats;
}

}  // namespace nearmesh::subscriber
