// SPDX-License-Identifier: Apache-2.0
// Bodies and pairs of a session: how they come and go, and which pairs may be near.
#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "pair_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// A promise says nothing of the way: a body of which that alone is known may go to all sides, so
/// its roam is for a quarter of the time.
constexpr double kRoamOfPromise = 0.25;

/// Full poses are asked for so long before a body may be near: for the way there and back, and two
/// frames.
constexpr double kLead_s = 0.3;

/// Of a pair, whichever way round.
std::pair<std::uint32_t, std::uint32_t> key_of(BodyId a, BodyId b) {
  return std::minmax({a.value, b.value});
}

PlacedBody placed(const Body& body) { return {body.name, body.model->content_hash, body.company}; }

}  // namespace

Status no_such(BodyId body) {
  return {StatusCode::kNotFound, "body " + (body.is_valid() ? std::to_string(body.value) : "none") +
                                     " is not of this session"};
}

Result<BodyId> Session::add_body(BodyOptions options) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  return impl_->add_body(std::move(options));
}

Result<BodyId> Session::Impl::add_body(BodyOptions body_options) {
  // As the bus has it: a part of the directory in which one name does not pass is not told, and its
  // other bodies are not known either.
  NEARMESH_RETURN_IF_ERROR(wire::check_name(body_options.name, "name of a body"));
  NEARMESH_RETURN_IF_ERROR(wire::check_name(body_options.model, "model name"));
  const double max_age_s = body_options.max_pose_age_s.value_or(
      body_options.own ? std::numeric_limits<double>::infinity() : options.max_pose_age_s);
  if (!(max_age_s >= 0))
    return Status{StatusCode::kInvalidArgument,
                  "body " + body_options.name + ": max_pose_age_s is " + std::to_string(max_age_s) +
                      ", expected seconds, not negative"};
  if (!(body_options.max_speed_mps >= 0 && body_options.max_speed_mps <= wire::kMaxSpeed_mps) ||
      (body_options.max_speed_mps > 0 && !body_options.own))
    return Status{StatusCode::kInvalidArgument,
                  "body " + body_options.name + ": max_speed_mps is " +
                      std::to_string(body_options.max_speed_mps) + ", expected 0 to " +
                      std::to_string(wire::kMaxSpeed_mps) + ", and 0 of a body that another moves"};
  const BodyId id{static_cast<std::uint32_t>(by_id.size())};
  NEARMESH_RETURN_IF_ERROR(check_pin(body_options.name, body_options.model, body_options.content));
  const Change change(*this);
  if (!named.emplace(body_options.name, id).second)
    return Status{
        StatusCode::kConflict,
        "body " + body_options.name + " is declared twice, expected a name that no other body has"};
  PeerModel& model = replicas.add(body_options.model);
  if (body_options.content.is_set()) model.pinned = body_options.content;
  const auto added =
      bodies.emplace(id.value, Body{.id = id,
                                    .name = std::move(body_options.name),
                                    .model = &model,
                                    .own = body_options.own,
                                    .solid = body_options.solid,
                                    .stamp = {.max_age_s = max_age_s},
                                    .max_speed_mps = body_options.max_speed_mps,
                                    .company = {body_options.group, body_options.mask, false,
                                                watches_only_own && !body_options.own}});
  by_id.push_back(&added.first->second);
  present.push_back(&added.first->second);
  has_promised |= body_options.max_speed_mps > 0;
  if (body_options.own) {
    Body& own = *find(id);
    own.number = next_number++;
    own.mover = channel->own_id();
    own_bodies.push_back(&own);
    untold_parts.insert(part_of(own));
  }
  has_news = true;
  return id;
}

/// One content for each model that is pinned, and one model for each content: a replica belongs to
/// both.
Status Session::Impl::check_pin(const std::string& body, const std::string& model_name,
                                const ContentHash& content) const {
  if (!content.is_set()) return Status::ok();
  const std::string pins = "body " + body + " pins model " + model_name + " to content " +
                           to_hex(content) + ", another body ";
  for (const auto& [name, model] : replicas.all()) {
    if (name == model_name && model.pinned.is_set() && model.pinned != content)
      return {StatusCode::kConflict, pins + "to " + to_hex(model.pinned)};
    if (name != model_name && model.pinned == content)
      return {StatusCode::kConflict, pins + "model " + name + " to the same"};
  }
  return Status::ok();
}

Status Session::place_body(BodyId body, const Pose& pose) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  Body* placed = impl_->find(body);
  if (placed == nullptr) return no_such(body);
  NEARMESH_RETURN_IF_ERROR(check_pose(pose, placed->name));
  if (placed->max_speed_mps > 0)
    return {StatusCode::kInvalidArgument,
            "body " + placed->name + " has a max_speed_mps: others are promised where it stays"};
  if (placed->links > 1)
    return {StatusCode::kInvalidArgument,
            "body " + placed->name + " is a link of a robot, and moves with the others"};
  const Impl::Change change(*impl_);
  placed->motion = Motion{.pose = orthonormal(pose)};
  placed->stamp.mover = wire::Mover::kThere;
  placed->is_placed = true;
  impl_->forget_heard(*placed);
  impl_->ask_anew(*placed);
  return Status::ok();
}

Status Session::remove_body(BodyId body) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  Body* removed = impl_->find(body);
  if (removed == nullptr) return no_such(body);
  const Impl::Change change(*impl_);
  const std::uint32_t first = removed->links > 1 ? removed->first_link : removed->number,
                      links = removed->links;
  if (links == 1) {
    impl_->remove_body(*removed);
    return Status::ok();
  }
  for (std::uint32_t number = first; number < first + links; ++number)
    impl_->remove_body(**impl_->own_from(number));
  return Status::ok();
}

/// Others hear that the number is gone, and with it all that was said of it. Who has not heard yet
/// rests on what was promised, so `made` stays.
Status Session::forget_pose(BodyId body) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  Body* lost = impl_->find(body);
  if (lost == nullptr) return no_such(body);
  if (!lost->own || lost->links > 1)
    return {StatusCode::kInvalidArgument,
            "body " + lost->name + ": expected one that this peer moves, and no link of a robot"};
  if (!lost->motion) return Status::ok();
  const Impl::Change change(*impl_);
  impl_->untold_parts.insert(part_of(*lost));
  impl_->own_bodies.erase(impl_->own_from(lost->number));
  lost->number = impl_->next_number++;
  impl_->own_bodies.push_back(lost);
  impl_->untold_parts.insert(part_of(*lost));
  Impl::forget_pose(*lost);
  lost->mover = impl_->channel->own_id();
  lost->is_placed = false;
  impl_->ask_anew(*lost);
  return Status::ok();
}

/// What the host heard of it before it was placed or removed is of no body of that name that is
/// there later.
void Session::Impl::forget_heard(const Body& body) {
  std::erase_if(heard_by_host, [&](const wire::BodyPose& pose) { return pose.body == body.name; });
}

void Session::Impl::remove_body(Body& body) {
  looks_at_told |= !body.is_discovered;
  forget_heard(body);
  forget_tiles(body);
  forget_robot(body);
  std::erase_if(pairs, [&](const auto& entry) { return entry.second.has(body); });
  listed.clear();
  note_told(body, {});
  if (body.slot) broad.remove(*body.slot);
  if (body.own) {
    own_bodies.erase(own_from(body.number));
    untold_parts.insert(part_of(body));
  }
  PeerModel& model = *body.model;
  named.erase(body.name);
  by_id[body.id.value] = nullptr;
  std::erase(present, &body);
  bodies.erase(body.id.value);
  leave_model(model);
}

Status Session::replace_model(BodyId body, const std::string& model, const ContentHash& content) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  Body* changed = impl_->find(body);
  if (changed == nullptr) return no_such(body);
  NEARMESH_RETURN_IF_ERROR(wire::check_name(model, "model name"));
  NEARMESH_RETURN_IF_ERROR(impl_->check_pin(changed->name, model, content));
  const Impl::Change change(*impl_);
  PeerModel& before = *std::exchange(changed->model, &impl_->replicas.add(model));
  if (content.is_set()) changed->model->pinned = content;
  if (changed->own) impl_->untold_parts.insert(part_of(*changed));
  impl_->has_news = true;
  impl_->ask_anew(*changed);
  impl_->leave_model(before);
  return Status::ok();
}

/// What was said of the body's pairs says nothing of it now.
void Session::Impl::ask_anew(Body& body) {
  body.is_new_to_bounds = true;
  forget_tiles(body);
  for (auto& [key, pair] : pairs) {
    if (!pair.has(body)) continue;
    pair.last = not_asked(pair.names());
    pair.is_put_off = false;
    pair.certified.reset();
    pair.asked = {};
  }
}

/// Its detail is given up where no body has the model any more.
void Session::Impl::leave_model(PeerModel& model) {
  const bool is_used = std::any_of(bodies.begin(), bodies.end(),
                                   [&](const auto& entry) { return entry.second.model == &model; });
  if (is_used) return;
  model.pinned = {};
  FrameReport none;
  if (model.is_ready()) give_up(model, {}, none);
  for (const ContentHash& content : replicas.leave(model)) outstanding.erase(content);
}

void Session::watch_all() { impl_->watch_many(false); }
void Session::watch_own() { impl_->watch_many(true); }

/// Who is a pair may have changed: all bodies are told to the broad phase anew.
void Session::Impl::watch_many(bool only_own) {
  const Change change(*this);
  watches_all = true;
  watches_only_own = only_own;
  for (auto& [id, body] : bodies) {
    if (body.slot) broad.remove(*body.slot);
    body.slot.reset();
    body.company.is_other = only_own && !body.own;
  }
}

void Session::discover_bodies() {
  impl_->discovers = true;
  impl_->looks_at_told = true;
}

Status Session::watch(BodyId a, BodyId b) {
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  for (const BodyId body : {a, b})
    if (impl_->find(body) == nullptr) return no_such(body);
  if (a == b) return {StatusCode::kInvalidArgument, "body " + name_of(a) + " against itself"};
  const Impl::Change change(*impl_);
  Impl::Pair& pair = impl_->pairs[key_of(a, b)];
  if (pair.is_by_name) return Status::ok();
  if (pair.a != impl_->find(a)) pair = {};  // what is kept of it has the other order
  pair.is_by_name = true;
  pair.a = impl_->find(a);
  pair.b = impl_->find(b);
  pair.last = not_asked(pair.names());
  return Status::ok();
}

Status Session::unwatch(BodyId a, BodyId b) {
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  for (const BodyId body : {a, b})
    if (impl_->find(body) == nullptr) return no_such(body);
  const auto at = impl_->pairs.find(key_of(a, b));
  if (at == impl_->pairs.end() || !at->second.is_by_name)
    return {StatusCode::kNotFound,
            "bodies " + name_of(a) + " and " + name_of(b) + " are not watched"};
  impl_->pairs.erase(at);
  impl_->listed.clear();
  return Status::ok();
}

std::string Session::name_of(BodyId body) const {
  const Body* named = impl_->find(body);
  return named == nullptr ? std::string() : named->name;
}

Result<BodyOptions> Session::options_of(BodyId body) const {
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  return BodyOptions{.name = asked->name,
                     .model = asked->model->name,
                     .own = asked->own,
                     .solid = asked->solid,
                     .content = asked->model->pinned,
                     .max_pose_age_s = asked->stamp.max_age_s,
                     .max_speed_mps = !asked->own && asked->promises[0]
                                          ? asked->promises[0]->max_speed_mps
                                          : asked->max_speed_mps,
                     .group = asked->company.group,
                     .mask = asked->company.mask};
}

/// Why nothing can be said of where the body is; empty where it can.
std::string Session::Impl::why_unknown(const Body& body) const {
  if (std::string reason = why_no_bounds(body); !reason.empty()) return reason;
  std::string reason = wire::why_stale(stamp_of(body), time_s, body.name);
  if (reason.empty() || body.own || body.is_placed || !body.promises[0]) return reason;
  if (std::string why = why_unpromised(body); !why.empty()) return why;
  return "body " + body.name + " is known by a promise alone, its full poses are asked for";
}

/// Of its model alone.
std::string Session::Impl::why_no_bounds(const Body& body) const {
  if (body.model->is_ready() || (body.model->world && body.model->world->root() != nullptr))
    return {};
  return "model " + body.model->name + " of body " + body.name + ": " + why_no_mesh(*body.model);
}

/// Whether full poses of those of the two that are promised are of use.
bool Session::Impl::is_near_soon(const Body& a, const Body& b) {
  return (!a.soon || a.soon->meets(b.place.box)) && (!b.soon || b.soon->meets(a.place.box));
}

/// Of one that is known by a promise, or was: full poses count while they are wanted, for then they
/// come.
void Session::Impl::bound_promised(Body& body, FrameReport& report) {
  std::string reason = why_no_bounds(body);
  const wire::BodyPromise* promise = promise_of(body);
  const bool is_posed = reason.empty() && wants_poses(body) &&
                        body.stamp.time_s >= body.wanted_since_s &&
                        wire::why_stale(stamp_of(body), time_s, body.name).empty();
  body.is_new_to_bounds = true;  // a ball grows with time
  body.is_by_promise = false;
  body.soon.reset();
  note_known(body);
  if (reason.empty() && promise == nullptr && !is_posed) reason = why_unpromised(body);
  if (!reason.empty()) {
    broad.lose(*body.slot);
    report.unknown.push_back({body.id, std::move(reason)});
    return;
  }
  body.is_new_to_bounds = false;
  body.bounded = body.model->content_hash;
  const ModelBounds& model = body.model->bounds;
  WorldBox around;
  double speed_mps = 0;
  if (promise != nullptr) {
    const Ball ball{promise->place_m, *promise->radius_m(time_s)};
    speed_mps = promise->max_speed_mps;
    body.place = place_by_promise(placed(body), model, ball, speed_mps, ahead());
    // Who may be near soon is asked for its poses before.
    const double lead_m = (speed_mps + fastest_mps) * kLead_s;
    around = model.around_ball(ball.center_m, ball.radius_m + body.place.way_m + lead_m,
                               options.margin_m);
    body.soon = ball_in(around, ball.center_m);
  }
  if (is_posed) {
    body.place = place_by_pose(placed(body), model, *body.motion, ahead());
    around = promise != nullptr ? hull(around, body.place.box) : body.place.box;
    if (promise == nullptr) note_near(body);  // they are all that is known
  }
  body.is_by_promise = !is_posed;
  report.promised += body.is_by_promise ? 1U : 0U;
  broad.place(*body.slot, around, [&] {
    return roam_along(around, {},
                      (speed_mps + fastest_mps) * kRoamOfPromise * roam_s(body.id.value));
  });
}

/// Tells the broad phase where the body may be, if it does not know yet.
void Session::Impl::bound(Body& body, FrameReport& report) {
  if (body.slot && body.company.is_scenery != body.is_placed) {
    broad.remove(*body.slot);
    body.slot.reset();
  }
  if (!body.slot) {
    body.company.is_scenery = body.is_placed;
    body.slot = broad.add(body.company);
    by_slot.resize(std::max<std::size_t>(by_slot.size(), *body.slot + 1));
    by_slot[*body.slot] = &body;
    body.is_new_to_bounds = true;
  }
  if (!body.own && !body.is_placed && body.promises[0]) {
    bound_promised(body, report);
    return;
  }
  note_known(body);
  std::string reason = why_unknown(body);
  if (!reason.empty()) {
    broad.lose(*body.slot);
    body.is_new_to_bounds = true;
    report.unknown.push_back({body.id, std::move(reason)});
    return;
  }
  if (!std::exchange(body.is_new_to_bounds, false) && body.bounded == body.model->content_hash)
    return;
  body.bounded = body.model->content_hash;
  const ModelBounds& model = body.model->bounds;
  body.place = place_by_pose(placed(body), model, *body.motion, ahead());
  broad.place(*body.slot, body.place.box, [&] {
    const double duration_s = roam_s(body.id.value);
    std::array<double, 3> way_m = body.motion->linear_velocity_mps;
    for (double& along : way_m) along *= duration_s;
    return roam_along(body.place.box, way_m, kRoamAside * model.way_m(*body.motion, duration_s));
  });
}

/// Which pairs this update answers; what is said of all others.
void Session::Impl::find_near(std::uint64_t frame, FrameReport& report) {
  const Stopwatch watch;
  ++updates;
  listed.clear();
  std::uint64_t near = 0;
  Bounded bounded;
  if (watches_all) {
    for (Body* body : present) {
      bound(*body, report);
      if (broad.is_placed(*body->slot)) note_bounded(*body, bounded);
    }
    for (const auto& [one, two] : broad.find_near()) {
      if (is_near_soon(*by_slot[one], *by_slot[two])) {
        note_near(*by_slot[one]);
        note_near(*by_slot[two]);
      }
      if (!may_be_near(by_slot[one]->place, by_slot[two]->place)) continue;  // soon, perhaps
      const auto [lower, higher] = std::minmax({by_slot[one]->id, by_slot[two]->id});
      const auto [at, is_new] = pairs.try_emplace(key_of(lower, higher));
      Pair& pair = at->second;
      if (is_new) {
        pair.a = find(lower);
        pair.b = find(higher);
      }
      pair.near_in = updates;
      ++near;
    }
    for (auto at = pairs.begin(); at != pairs.end();) {
      Pair& pair = at->second;
      // That a body is unknown does not end what it touched.
      const bool is_proved = pair.contacts.is_empty() ||
                             (broad.is_placed(*pair.a->slot) && broad.is_placed(*pair.b->slot));
      if (pair.is_by_name || pair.near_in == updates) {
        ++at;
      } else if (!broad.wants(*pair.a->slot, *pair.b->slot)) {
        at = pairs.erase(at);  // it is watched no more, and its contacts may go on
      } else if (!is_proved) {
        ++at;
      } else {
        end_contacts(pair, report);
        at = pairs.erase(at);
      }
    }
  }
  for (auto& [key, pair] : pairs) {
    listed.push_back(&pair);
    note_near(*pair.a);
    note_near(*pair.b);
  }
  if (watches_all) tell_free(frame, near, bounded, report);
  report.broad_s = watch.seconds();
}

/// Precondition: its place is known.
void Session::Impl::note_bounded(const Body& body, Bounded& bounded) const {
  bounded.places_digest += body.place.digest;
  bounded.pairs.add(body.place.way_m, body.is_by_promise ? 0 : wire::age_s(stamp_of(body), time_s));
  const bool is_elsewhere = body.told.known == Body::Told::Known::kPromised && !body.own &&
                            !body.is_by_promise && (body.pose_sequence == 0 || !body.is_near_pose);
  bounded.rests_on_more |= body.told.known == Body::Told::Known::kNot || is_elsewhere;
}

void Session::Impl::tell_free(std::uint64_t frame, std::uint64_t near, const Bounded& bounded,
                              FrameReport& report) {
  FreeByBounds& free = report.free_by_bounds;
  free.pairs = broad.placed_pair_count();
  report.unknown_pairs = broad.pair_count() - free.pairs;
  for (const Pair* pair : listed) {
    const BroadPhase::Slot a = *pair->a->slot, b = *pair->b->slot;
    if (!broad.wants(a, b)) continue;
    --(broad.is_placed(a) && broad.is_placed(b) ? free.pairs : report.unknown_pairs);
  }
  if (options.publish_reports) tell_bounds(frame, broad.placed_pair_count() - near, bounded);
  if (free.pairs == 0) return;
  free.clearance_m = bounded.pairs.clearance_m(options.margin_m);
  free.horizon_s = bounded.pairs.horizon_s(horizon_s());
  free.digest = bounded.places_digest;
  for (const std::uint64_t bits : {free.pairs, std::bit_cast<std::uint64_t>(free.clearance_m),
                                   std::bit_cast<std::uint64_t>(free.horizon_s)})
    free.digest = mix(free.digest ^ bits);
}

/// The pairs of a body that are not listed, and that its bounds do not prove free either.
void Session::Impl::add_unbounded(Readiness& all, const Body& body) {
  const auto is_bounded = [this](const Body& its) {
    return its.slot && broad.is_placed(*its.slot) && !its.is_new_to_bounds;
  };
  for (const auto& [id, other] : bodies) {
    if (&other == &body || !other.company.wants(body.company) ||
        (is_bounded(body) && is_bounded(other)) || pairs.contains(key_of(body.id, other.id)))
      continue;
    const std::string names = body.name + " and " + other.name;
    Readiness unbounded = not_asked(names);
    for (const Body* one : {&body, &other})
      if (const std::string why = why_unknown(*one); !why.empty())
        unbounded.reason = names + ": " + why;
    add_pair(all, unbounded);
  }
}

}  // namespace nearmesh::subscriber
