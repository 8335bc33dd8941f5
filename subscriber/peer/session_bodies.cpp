// SPDX-License-Identifier: Apache-2.0
// Bodies and pairs of a session: how they come and go, and which pairs may be near.
#include <bit>
#include <limits>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "pair_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// Bodies are expected to roam as far as they may go in the look-ahead and this much more, and up to twice that: not all at once
/// shall leave their roams.
constexpr double kRoam_s = 1;

Status check_names(std::initializer_list<std::string_view> names) {
  for (const std::string_view name : names)
    if (name.empty() || name.size() > wire::kMaxNameBytes)
      return {StatusCode::kInvalidArgument, "name '" + std::string(name) + "': expected 1 to " +
                                                std::to_string(wire::kMaxNameBytes) + " bytes"};
  return Status::ok();
}

/// Of a pair, whichever way round.
std::pair<std::uint32_t, std::uint32_t> key_of(BodyId a, BodyId b) {
  return std::minmax({a.value, b.value});
}

/// Of all that a body's bounds follow from; the same on every machine.
std::uint64_t digest_of(const Body& body) {
  std::uint64_t digest = 0;
  const auto add = [&digest](std::uint64_t bits) { digest = mix(digest ^ bits); };
  for (const char c : body.name) add(static_cast<unsigned char>(c));
  add(body.model->content_hash.high);
  add(body.model->content_hash.low);
  add(std::uint64_t{body.company.group} << 32 | body.company.mask);
  add(body.company.is_scenery ? 1 : 0);
  const auto add_all = [&](const auto& numbers) {
    for (const double number : numbers) add(std::bit_cast<std::uint64_t>(number));
  };
  add_all(body.motion->pose.rotation);
  add_all(body.motion->pose.translation_m);
  add_all(body.motion->linear_velocity_mps);
  add_all(body.motion->angular_velocity_radps);
  return digest;
}

}  // namespace

Status no_such(BodyId body) {
  return {StatusCode::kNotFound, "body " + (body.is_valid() ? std::to_string(body.value) : "none") +
                                     " is not of this session"};
}

Result<BodyId> Session::add_body(BodyOptions options) {
  const FloatGuard guard;
  return impl_->add_body(std::move(options));
}

Result<BodyId> Session::Impl::add_body(BodyOptions body_options) {
  NEARMESH_RETURN_IF_ERROR(check_names({body_options.name, body_options.model}));
  const double max_age_s = body_options.max_pose_age_s.value_or(
      body_options.own ? std::numeric_limits<double>::infinity() : options.max_pose_age_s);
  if (!(max_age_s >= 0))
    return Status{StatusCode::kInvalidArgument,
                  "body " + body_options.name + ": max_pose_age_s is " + std::to_string(max_age_s) +
                      ", expected seconds, not negative"};
  const BodyId id{next_body};
  NEARMESH_RETURN_IF_ERROR(check_pin(body_options.name, body_options.model, body_options.content));
  if (!named.emplace(body_options.name, id).second)
    return Status{StatusCode::kConflict, "body " + body_options.name + " is declared twice"};
  ++next_body;
  PeerModel& model = replicas.add(body_options.model);
  if (body_options.content.is_set()) model.pinned = body_options.content;
  bodies.emplace(id.value, Body{.id = id,
                                .name = std::move(body_options.name),
                                .model = &model,
                                .own = body_options.own,
                                .solid = body_options.solid,
                                .stamp = {.max_age_s = max_age_s},
                                .company = {body_options.group, body_options.mask, false}});
  if (body_options.own) {
    Body& own = *find(id);
    own.number = next_number++;
    own_bodies.emplace(own.number, id);
    untold_parts.insert(part_of(own));
  }
  has_news = true;
  return id;
}

/// One content for each model that is pinned, and one model for each content: a replica belongs to both.
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
  Body* placed = impl_->find(body);
  if (placed == nullptr) return no_such(body);
  NEARMESH_RETURN_IF_ERROR(check_pose(pose, placed->name));
  placed->motion = Motion{.pose = orthonormal(pose)};
  placed->stamp.mover = wire::Mover::kThere;
  placed->is_placed = true;
  impl_->ask_anew(*placed);
  return Status::ok();
}

Status Session::remove_body(BodyId body) {
  const FloatGuard guard;
  Body* removed = impl_->find(body);
  if (removed == nullptr) return no_such(body);
  impl_->remove_body(*removed);
  return Status::ok();
}

void Session::Impl::remove_body(Body& body) {
  forget_tiles(body);
  std::erase_if(pairs, [&](const auto& entry) { return entry.second.has(body); });
  listed.clear();
  if (body.slot) broad.remove(*body.slot);
  if (body.own) {
    own_bodies.erase(body.number);
    untold_parts.insert(part_of(body));
  }
  PeerModel& model = *body.model;
  named.erase(body.name);
  bodies.erase(body.id.value);
  leave_model(model);
}

Status Session::replace_model(BodyId body, const std::string& model, const ContentHash& content) {
  const FloatGuard guard;
  Body* changed = impl_->find(body);
  if (changed == nullptr) return no_such(body);
  NEARMESH_RETURN_IF_ERROR(check_names({model}));
  NEARMESH_RETURN_IF_ERROR(impl_->check_pin(changed->name, model, content));
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

/// Its detail is given up where no body has the model any more. The model stays: recordings count its batches.
void Session::Impl::leave_model(PeerModel& model) {
  const bool is_used = std::any_of(bodies.begin(), bodies.end(),
                                   [&](const auto& entry) { return entry.second.model == &model; });
  if (is_used) return;
  model.pinned = {};
  if (model.is_ready() && model.replica->mesh().split_count() > 0) {
    model.replica->give_up({});
    model.tells_held = true;
    model.is_too_much_to_tell = false;
  }
}

void Session::watch_all() { impl_->watches_all = true; }
void Session::discover_bodies() { impl_->discovers = true; }

Status Session::watch(BodyId a, BodyId b) {
  for (const BodyId body : {a, b})
    if (impl_->find(body) == nullptr) return no_such(body);
  if (a == b) return {StatusCode::kInvalidArgument, "body " + name_of(a) + " against itself"};
  Impl::Pair& pair = impl_->pairs[key_of(a, b)];
  if (std::exchange(pair.is_by_name, true)) return Status::ok();
  pair.a = impl_->find(a);
  pair.b = impl_->find(b);
  pair.last = not_asked(pair.names());
  return Status::ok();
}

Status Session::unwatch(BodyId a, BodyId b) {
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
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  return BodyOptions{.name = asked->name,
                     .model = asked->model->name,
                     .own = asked->own,
                     .solid = asked->solid,
                     .content = asked->model->pinned,
                     .max_pose_age_s = asked->stamp.max_age_s,
                     .group = asked->company.group,
                     .mask = asked->company.mask};
}

/// Why nothing can be said of where the body is; empty where it can.
std::string Session::Impl::why_unknown(const Body& body) const {
  if (!body.model->is_ready() && !(body.model->world && body.model->world->root() != nullptr))
    return "model " + body.model->name + " of body " + body.name + ": " + why_no_mesh(*body.model);
  return wire::why_stale(stamp_of(body), time_s, body.name);
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
  const double late = 1 + static_cast<double>(mix(body.id.value) % 16) / 16;
  broad.place(*body.slot, model.around(*body.motion, horizon_s(), options.margin_m), [&] {
    return model.around(*body.motion, horizon_s() + kRoam_s * late, options.margin_m);
  });
  body.way_m = model.way_m(*body.motion, horizon_s());
  body.digest = digest_of(body);
}

/// Which pairs this update answers; what is said of all others.
void Session::Impl::find_near(FrameReport& report) {
  const Stopwatch watch;
  ++updates;
  listed.clear();
  if (watches_all) {
    for (auto& [id, body] : bodies) bound(body, report);
    for (const auto& [one, two] : broad.find_near()) {
      const auto [lower, higher] = std::minmax({by_slot[one]->id, by_slot[two]->id});
      const auto [at, is_new] = pairs.try_emplace(key_of(lower, higher));
      Pair& pair = at->second;
      if (is_new) {
        pair.a = find(lower);
        pair.b = find(higher);
      }
      pair.near_in = updates;
    }
    for (auto at = pairs.begin(); at != pairs.end();) {
      Pair& pair = at->second;
      // That a body is unknown does not end what it touched.
      const bool is_proved = pair.contacts.is_empty() ||
                             (broad.is_placed(*pair.a->slot) && broad.is_placed(*pair.b->slot));
      if (pair.is_by_name || pair.near_in == updates || !is_proved) {
        ++at;
      } else {
        end_contacts(pair, report);
        at = pairs.erase(at);
      }
    }
  }
  for (auto& [key, pair] : pairs) listed.push_back(&pair);
  if (watches_all) tell_free(report);
  report.broad_s = watch.seconds();
}

void Session::Impl::tell_free(FrameReport& report) {
  FreeByBounds& free = report.free_by_bounds;
  free.pairs = broad.placed_pair_count();
  report.unknown_pairs = broad.pair_count() - free.pairs;
  for (const Pair* pair : listed) {
    const BroadPhase::Slot a = *pair->a->slot, b = *pair->b->slot;
    if (!broad.wants(a, b)) continue;
    --(broad.is_placed(a) && broad.is_placed(b) ? free.pairs : report.unknown_pairs);
  }
  // Boxes that do not meet are farther apart than both ways and margins.
  double least_way_m = std::numeric_limits<double>::infinity(), next_way_m = least_way_m;
  double oldest_s = 0;
  for (const auto& [id, body] : bodies) {
    if (!broad.is_placed(*body.slot)) continue;
    free.digest += body.digest;
    if (body.way_m < next_way_m) next_way_m = std::max(body.way_m, least_way_m);
    least_way_m = std::min(least_way_m, body.way_m);
    if (body.way_m > 0) oldest_s = std::max(oldest_s, wire::age_s(stamp_of(body), time_s));
  }
  if (free.pairs == 0) {
    free = {};
    return;
  }
  free.clearance_m = (least_way_m + next_way_m + 2 * options.margin_m) * (1 - 0x1p-40);
  free.horizon_s = std::max(0.0, horizon_s() - oldest_s);
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
