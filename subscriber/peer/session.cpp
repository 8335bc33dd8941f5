// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "host_jobs.hpp"
#include "pair_readiness.hpp"
#include "region_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// An own body at rest is published again after this share of max_pose_age_s: of the rest half may
/// be lost on the way, and the frames of neither side need to be frequent. After kRepeat_s at most,
/// since whoever joins has no pose until then.
constexpr double kRepeatShare = 0.25, kRepeat_s = 0.5;

}  // namespace

bool FrameReport::all_certified() const {
  return unknown_pairs == 0 && std::all_of(answers.begin(), answers.end(), [](const PairAnswer& a) {
           return is_certified(a.answer.status);
         });
}

const PairAnswer* FrameReport::find(BodyId a, BodyId b) const {
  const auto wanted = std::minmax(a, b);
  const auto at = std::lower_bound(answers.begin(), answers.end(), wanted,
                                   [](const PairAnswer& answer, const auto& key) {
                                     return std::minmax(answer.a, answer.b) < key;
                                   });
  return at != answers.end() && std::minmax(at->a, at->b) == wanted ? &*at : nullptr;
}

Session::Session(std::unique_ptr<Channel> channel, SessionOptions options)
    : impl_(std::make_unique<Impl>()) {
  impl_->channel = std::move(channel);
  impl_->replicas.use_cache(options.cache_folder);
  impl_->options_status = check(options);
  impl_->options = options;
  impl_->audits = Random(options.audit_seed != 0 ? options.audit_seed : std::random_device{}());
}
Session::~Session() {
  try {
    static_cast<void>(write_cache());
  } catch (...) {  // for want of memory: what leaves a destructor ends the host
  }
}

Status Session::write_cache() {
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  return impl_->replicas.write_caches();
}

Result<FrameReport> Session::update(std::uint64_t frame, double time_s,
                                    const std::vector<OwnMotion>& motions, double budget_s) {
  const FloatGuard guard;
  Impl& impl = *impl_;
  NEARMESH_RETURN_IF_ERROR(impl.options_status);
  NEARMESH_RETURN_IF_ERROR(impl.check_whole());
  if (!(budget_s >= 0))
    return Status{StatusCode::kInvalidArgument, "budget_s of frame " + std::to_string(frame) +
                                                    " is " + std::to_string(budget_s) +
                                                    ", expected seconds, at least 0"};
  for (const OwnMotion& own : motions) {
    const Body* body = impl.find(own.body);
    if (body == nullptr) return no_such(own.body);
    if (!body->own)
      return Status{StatusCode::kNotFound, "motion of body " + body->name +
                                               ": expected a body that this peer moves "
                                               "(BodyOptions::own), found one that others move"};
    NEARMESH_RETURN_IF_ERROR(check_motion(own.motion, body->name));
    if (impl.has_promised) NEARMESH_RETURN_IF_ERROR(impl.check_promised(*body, own.motion, time_s));
  }
  NEARMESH_RETURN_IF_ERROR(impl.check_links(motions));
  if (!wire::is_time(time_s))  // it goes out with every pose
    return Status{StatusCode::kInvalidArgument, "time_s of frame " + std::to_string(frame) +
                                                    " is " + std::to_string(time_s) +
                                                    ", expected seconds, at most " +
                                                    std::to_string(wire::kMaxTime_s) + " from 0"};
  const FrameBudget budget(budget_s);
  std::optional<Impl::Change> change(impl);
  FrameReport report;
  if (impl.has_updated && time_s < impl.time_s)
    report.complaints.push_back("time_s of frame " + std::to_string(frame) + " is " +
                                std::to_string(time_s) + ", before it was " +
                                std::to_string(impl.time_s) + ": the exercise's clock went back");
  impl.frame_s = impl.has_updated ? std::max(0.0, time_s - impl.time_s) : 0;
  impl.has_updated = true;
  impl.time_s = time_s;
  impl.has_recorder = impl.channel->has_recorder();
  std::vector<std::uint32_t> parts;  // that go out
  for (const OwnMotion& own : motions) {
    Body& body = *impl.find(own.body);
    body.motion = own.motion;
    body.motion->pose = orthonormal(own.motion.pose);
    body.is_placed = false;
    body.is_new_to_bounds = true;
    body.stamp.mover = wire::Mover::kThere;
    body.stamp.time_s = time_s;
    const std::uint32_t part = part_of(body);
    if (parts.empty() || parts.back() != part) parts.push_back(part);
  }
  const double repeat_s = std::min(kRepeatShare * impl.options.max_pose_age_s, kRepeat_s);
  impl.fastest_mps = 0;
  for (const Body* own : impl.own_bodies) {
    const Body& body = *own;
    if (!body.motion) continue;
    impl.fastest_mps = std::max(impl.fastest_mps, length_bound(body.motion->linear_velocity_mps));
    if (!body.is_placed && is_at_rest(*body.motion) &&
        std::abs(time_s - body.published_s) >= repeat_s &&
        (body.max_speed_mps == 0 || impl.has_recorder || !impl.who_wants(body).empty()))
      impl.add_parts_of(body, parts);
  }
  impl.tell_directory();
  impl.make_promises();
  std::sort(parts.begin(), parts.end());
  parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
  for (const std::uint32_t part : parts) impl.publish(part, frame);
  impl.take_inbox(report);
  for (const std::uint32_t part : std::exchange(impl.unserved_parts, {}))
    impl.publish(part, frame, true);
  impl.replicas.read_caches(report.complaints);
  // What comes after it is to have its time: half of all, and of the end of the update, if it needs
  // that.
  const double answers_s =
      std::min(impl.answers_cost.seconds(), (budget_s + impl.ending_s(budget)) / 2);
  const auto apply_one = [&] {
    const Stopwatch watch;
    const bool is_applied = impl.replicas.apply_one(report);
    if (is_applied) impl.batch_cost.add(watch.seconds());
    return is_applied;
  };
  while (apply_one() && budget.left_s() > answers_s + impl.batch_cost.seconds()) {
  }
  impl.replicas.note_given_up();
  const Stopwatch since_batches;
  for (const auto& [name, model] : impl.replicas.all())
    report.batches_waiting += model.waiting.size();
  for (const auto& [name, model] : impl.replicas.all())
    report.state_digest =
        mix(report.state_digest ^ (model.is_ready() ? model.replica->mesh().state_hash() + 1 : 0));
  impl.find_near(frame, report);
  impl.tell_wishes();
  impl.join_tiles(report);
  impl.answer_pairs(frame, budget, report);
  impl.fold_worlds(frame, report);
  const double answered_s = budget.spent_s();
  impl.channel->allow(budget.left_s());
  const double allowed_s = budget.spent_s();
  impl.ask(budget, report);
  impl.give_up(budget, report);
  impl.tell_held(report);
  impl.put_folded(report);
  // The channel's own work is set aside for apart.
  impl.rest_cost.add(budget.spent_s() - allowed_s + answered_s - impl.asked_by_s);
  impl.note_overrun(budget);
  impl.answers_cost.add(since_batches.seconds());
  for (const std::string& line : report.complaints) impl.keeper.note(line, impl.clock.seconds());
  if (impl.keeper.is_due(impl.clock.seconds())) impl.tell_status(report, stats());
  change.reset();
  if (impl.fault_of_host) std::rethrow_exception(std::exchange(impl.fault_of_host, nullptr));
  return report;
}

/// Mesh and tree of a model may have parted in an update that was left by an exception, or what is
/// kept of a pair and its bodies in another call: answers from them would be certified, and wrong.
Status Session::Impl::check_whole() const {
  if (!is_half_way) return Status::ok();
  return {StatusCode::kConflict,
          "an earlier call ended half-way, for want of memory say; end the session"};
}

/// The own body of this number, or the next one.
std::vector<Body*>::iterator Session::Impl::own_from(std::uint32_t number) {
  return std::lower_bound(own_bodies.begin(), own_bodies.end(), number,
                          [](const Body* body, std::uint32_t its) { return body->number < its; });
}

template <class Use>
void Session::Impl::for_each_of_part(std::uint32_t part, const Use& use) {
  const std::uint32_t first = part * wire::kBodiesPerPart;
  for (auto at = own_from(first);
       at != own_bodies.end() && (*at)->number < first + wire::kBodiesPerPart; ++at)
    use(**at);
}

void Session::Impl::tell_directory() {
  for (const std::uint32_t part : std::exchange(untold_parts, {})) {
    wire::BodyDirectory directory{.peer = channel->own_id(), .part = part};
    for_each_of_part(part, [&](const Body& body) {
      directory.bodies.push_back({.number = body.number,
                                  .name = body.name,
                                  .model = body.model->name,
                                  .content = body.model->pinned,
                                  .solid = body.solid,
                                  .group = body.company.group,
                                  .mask = body.company.mask,
                                  .max_speed_mps = body.max_speed_mps,
                                  .links = body.links,
                                  .first_link = body.first_link});
    });
    channel->send(directory);
  }
}

/// All of the part that have a pose: the sample stands for those before it. Of bodies that promises
/// are made of, those that somebody wants, apart; recorders hear them all.
void Session::Impl::publish(std::uint32_t part, std::uint64_t frame, bool only_near) {
  wire::BodyPoses poses{.peer = channel->own_id(), .part = part, .frame = frame};
  const wire::NearPoses none{poses};
  std::map<std::vector<wire::SessionId>, wire::NearPoses> near;  // by who wants them
  for_each_of_part(part, [&](Body& body) {
    if (!body.motion || body.is_placed) return;
    const bool is_promised = body.max_speed_mps > 0;
    const std::vector<wire::SessionId> wanted_by = who_wants(body);
    if (is_promised ? wanted_by.empty() && !has_recorder : only_near) return;
    wire::BodyPoses& sample = is_promised ? near.try_emplace(wanted_by, none).first->second : poses;
    if (sample.bodies.empty()) sample.bodies.reserve(wire::kBodiesPerPart);
    sample.bodies.push_back(
        {.number = body.number, .time_s = stamp_of(body).time_s, .motion = *body.motion});
    body.published_s = time_s;
  });
  if (!poses.bodies.empty()) {
    poses.sequence = count_up(pose_samples);
    channel->send(poses);
  }
  for (auto& [wanted_by, sample] : near) {
    sample.sequence = count_up(near_samples);
    channel->send_near(sample);
  }
}

/// It has heard nothing of bodies at rest of which promises are made.
void Session::Impl::note_recorder() {
  ++recorders;
  has_recorder = channel->has_recorder();
  for (const Body* own : own_bodies)
    if (own->max_speed_mps > 0) unserved_parts.insert(part_of(*own));
}

/// A body in place is where it is, and so is an own one at rest until the host moves it: their
/// poses are of now.
wire::PoseStamp Session::Impl::stamp_of(const Body& body) const {
  wire::PoseStamp stamp = body.stamp;
  if (body.is_placed || (body.own && body.motion && is_at_rest(*body.motion)))
    stamp.time_s = time_s;
  return stamp;
}

/// Whether the boxes of two bodies meet within the look-ahead, as far as both are known.
bool Session::Impl::may_meet(const Pair& pair) const {
  if (!pair.is_ready) return false;
  if (!pair.is_by_name) return true;  // listed for that
  const auto box_of = [this](const Body& body) {
    return body.model->bounds.around(*body.motion, horizon_s(), options.margin_m);
  };
  return box_of(*pair.a).meets(box_of(*pair.b));
}

/// All detail of models that nothing was near for long, as tiles are given up. With a cache it
/// stays, for what came out of one does not come again.
void Session::Impl::give_up_unused(FrameReport& report) {
  constexpr double kBetweenLooks_s = 1;
  if (!options.cache_folder.empty() || std::abs(time_s - looked_for_use_s) < kBetweenLooks_s)
    return;
  looked_for_use_s = time_s;
  for (const Pair* pair : listed)
    if (may_meet(*pair)) pair->a->model->needed_s = pair->b->model->needed_s = time_s;
  for (auto& [name, model] : replicas.all()) {
    if (!model.is_ready() || model.is_tile) continue;
    if (!model.needed_s) model.needed_s = time_s;
    if (std::abs(time_s - *model.needed_s) <= kUnused_s) continue;
    model.needed_s = time_s;
    give_up(model, {}, report);
  }
}

/// Where time is left, or the limit is passed by much; and what nothing needs.
void Session::Impl::give_up(const FrameBudget& budget, FrameReport& report) {
  give_up_unused(report);
  const std::uint64_t most = options.max_held_splits;
  if (most == 0) return;
  for (auto& [name, model] : replicas.all()) {
    if (!model.is_ready()) continue;
    const std::uint64_t held = model.replica->mesh().split_count();
    if (held <= most || (held <= most + most / 8 && budget.left_s() < give_up_cost.seconds()))
      continue;
    const Stopwatch watch;
    give_up(model, kept_of(model, report), report);
    give_up_cost.add(watch.seconds());
  }
}

void Session::Impl::give_up(PeerModel& model, const std::vector<RegionPart>& kept,
                            FrameReport& report) {
  if (model.replica->mesh().split_count() == 0) return;
  const Replica::Times times = model.replica->give_up(kept);
  model.tells_held = true;
  model.is_too_much_to_tell = false;
  report.refine_s += times.refine_s;
  report.tree_s += times.tree_s;
}

/// Why no base mesh of a model is here.
std::string Session::Impl::why_no_mesh(const PeerModel& model) const {
  if (model.world) return "its first page has not come";
  const bool is_served = std::any_of(publishers.begin(), publishers.end(), [&](const auto& entry) {
    return entry.second.serves(model.content_hash) && !replicas.is_refused(model.content_hash);
  });
  if (is_served) return "its header has not come";
  if (!model.conflict.empty()) return model.conflict;
  if (publishers.empty()) return "no publisher found";
  if (!model.pinned.is_set()) return "no publisher serves it";
  return "no publisher serves content " + to_hex(model.pinned) + ", which is pinned";
}

std::string Session::Impl::why_not_ready(const Body& body) const {
  if (body.model->world && body.model->world->root() != nullptr)
    return "body " + body.name +
           " is a world, of which only answers about pairs and probes are given";
  if (body.model->is_ready() && body.solid)
    if (const Status status = check_solid(body.model->replica->header().surface, body.name);
        !status.is_ok())
      return status.message();
  return why_unknown(body);
}

namespace {

void take_answer(Answered&& all, PairAnswer& result, std::vector<std::string>& complaints) {
  result.answer = std::move(all.answer);
  result.contacts = std::move(all.contacts);
  result.depth = std::move(all.depth);
  result.safe_horizon_s = all.safe_horizon_s;
  if (!all.swept) return;
  if (all.swept->is_ok()) {
    result.swept = std::move(*all.swept).value();
  } else {
    complaints.push_back("no swept answer: " + all.swept->status().message());
  }
}

}  // namespace

/// What the host's scheduler throws is kept until the update is over; it is not called again
/// before.
void Session::Impl::run_jobs(std::size_t count, const std::function<void(std::size_t)>& job) {
  if (options.run_jobs && count > 1 && !fault_of_host) {
    fault_of_host = HostJobs(count, job).run_on(options.run_jobs);
  } else {
    for (std::size_t i = 0; i < count; ++i) job(i);
  }
}

AnswerOptions Session::Impl::answer_options_of(const Pair& pair) const {
  return {.clearance = options.clearance,
          .any = options.any,
          .max_pairs = options.max_pairs,
          .max_tests = options.max_tests,
          .contacts = options.contacts,
          .depth = options.depth && !pair.is_of_tile,
          .sweep_s = options.sweep_s,
          .max_sweep_tests = options.max_sweep_tests,
          .max_depth_tests = options.max_depth_tests,
          .was_free = pair.certified && pair.certified->said.pair_total == 0};
}

/// Precondition: it is ready.
AskedBody Session::Impl::asked_body_of(const Body& body) const {
  return {body.view(), *body.motion, body.name, body.solid, wire::age_s(stamp_of(body), time_s)};
}

// Changes nothing of the session's, so that pairs may be asked at once. `take_turn` is called where
// it could be asked.
void Session::Impl::ask_pair(const Pair& pair, PairAnswer& result, AskedPair& asked_pair,
                             const std::function<Turn()>& take_turn, const IsOver& is_over) const {
  result.a = pair.a->id;
  result.b = pair.b->id;
  result.answer = nothing_known();
  result.content_a = pair.a->model->content_hash;
  result.content_b = pair.b->model->content_hash;
  result.age_a_s = wire::age_s(stamp_of(*pair.a), time_s);
  result.age_b_s = wire::age_s(stamp_of(*pair.b), time_s);
  if (!pair.is_ready) result.reason = why_not_ready(*pair.a);
  if (!pair.is_ready && result.reason.empty()) result.reason = why_not_ready(*pair.b);
  if (const Answered* known = pair.known(); result.reason.empty() && known != nullptr) {
    result.asked = true;
    result.pose_a = pair.a->motion->pose;
    result.pose_b = pair.b->motion->pose;
    take_answer(Answered(*known), result, asked_pair.complaints);
    return;
  }
  if (!result.reason.empty()) return;
  const Turn turn = take_turn();
  if (turn == Turn::kPutOff) {
    put_off(pair, result);
    return;
  }
  const Stopwatch watch;
  const AskedBody a = asked_body_of(*pair.a), b = asked_body_of(*pair.b);
  AnswerOptions with = answer_options_of(pair);
  if (turn == Turn::kTimed) with.is_over = &is_over;
  Result<Answered> asked = answer(a, b, with);
  asked_pair.query_s = watch.seconds();
  if (!asked.is_ok()) {
    result.reason = asked.status().message();
    return;
  }
  asked_pair.is_cut_short = asked.value().is_cut_short;
  if (asked_pair.is_cut_short) {
    put_off(pair, result);
    return;
  }
  result.asked = true;
  result.pose_a = a.motion.pose;
  result.pose_b = b.motion.pose;
  take_answer(std::move(asked).value(), result, asked_pair.complaints);
  if (is_beyond_detail(result.answer))
    result.reason = "body " + (a.view.surface->has_seeds() ? pair.b : pair.a)->name +
                    " has more than " + std::to_string(kMaxComponentSeeds) +
                    " parts: whether one is inside the other body cannot be told";
}

void Session::Impl::settle_pair(Pair& pair, PairAnswer& result, const AskedPair& asked,
                                std::uint64_t frame, FrameReport& report) {
  report.query_s += asked.query_s;
  report.complaints.insert(report.complaints.end(), asked.complaints.begin(),
                           asked.complaints.end());
  if (result.reason.empty() && !is_certified(result.answer.status)) {
    result.awaited = awaited_of(*pair.a->model, result.answer.missing_a.size());
    const std::string more = awaited_of(*pair.b->model, result.answer.missing_b.size());
    if (!result.awaited.empty() && !more.empty()) result.awaited += "; ";
    result.awaited += more;
    if (result.answer.exhausted)
      result.awaited +=
          (result.awaited.empty() ? "the search was ended after " : "; it was ended after ") +
          std::to_string(options.max_tests) + " tests";
  }
  if (pair.known() != nullptr) {
    note_known(pair);
  } else {
    note_turn(pair, result, asked);
  }
  if (pair.is_of_tile) return;  // told with the others of its world
  report.pairs_put_off += result.put_off ? 1 : 0;
  if (options.contacts || options.depth) follow_contacts(pair, result, report);
  if (result.depth) ask_for_depth(pair, result);
  if (!result.put_off) pair.last = readiness_of(result, pair.names());
  const std::uint64_t answer_digest = digest_of(pair, result);
  report.answers_digest = mix(report.answers_digest ^ answer_digest);
  if (options.publish_reports) report_pair(pair, result, {frame, answer_digest});
}

Result<Readiness> Session::readiness(BodyId body) const {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  Readiness all{.stage = ReadyStage::kCertified};
  for (const auto& [key, pair] : impl_->pairs)
    if (pair.has(*asked)) add_pair(all, pair.is_put_off ? put_off(pair.names()) : pair.last);
  if (impl_->watches_all) {
    impl_->add_unbounded(all, *asked);
    return all;
  }
  if (all.pairs == 0)
    return Readiness{.reason = "body " + asked->name + " is watched against nothing"};
  return all;
}

Result<RegionReadiness> Session::region_readiness(BodyId body, const std::array<double, 3>& lo_m,
                                                  const std::array<double, 3>& hi_m) const {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
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
