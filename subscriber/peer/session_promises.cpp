// SPDX-License-Identifier: Apache-2.0
// Promises (docs/worlds.md): where own bodies stay, as others are told; where others' bodies stay;
// whose full poses are wanted, here and elsewhere. What follows from a promise: core/THEOREM.md,
// "Free by promise".
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/float_guard.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// A promise is made anew after this share of its time: the rest is for losses on the way, and for
/// frames that are late.
constexpr double kRenewShare = 0.5;
/// Full poses are wanted so long after they last were of use: who turns away and back is not asked
/// twice.
constexpr double kLinger_s = 0.6;
/// What is wanted is said again, since it may be lost, seconds by the machine's clock.
constexpr double kRepeatWish_s = 0.5;
constexpr std::size_t kMaxWishes = 4096;
/// Promises of an own body that are remembered: each other body of its part may come in a frame of
/// its own, and has a promise made of all.
constexpr std::size_t kMostMade = 2 * wire::kBodiesPerPromise;

/// A quantum is some 64th of the way that the slowest body may go: it hardly widens a promise, and
/// its places are small numbers.
constexpr double kQuantumShare = 0x1p-6;

/// Of places up to that far from 0 on each axis, of bodies of that speed at least.
int quantum_of(double farthest_m, double slowest_mps, double promise_s) {
  const int of_way = std::ilogb(slowest_mps * promise_s * kQuantumShare);
  // Doubles count quanta exactly.
  const int of_place = std::ilogb(std::max(farthest_m, 1.0)) - 50;
  return std::clamp(std::max(of_way, of_place), wire::kMinQuantum, wire::kMaxQuantum);
}

double distance_m(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
  return std::sqrt(sum);
}

/// The latest first. Those of another mover, or of another body of the name, are void. What comes
/// late may still hold for now.
void keep(wire::BodyPromise&& promise, double now_s,
          std::array<std::optional<wire::BodyPromise>, 2>& promises) {
  auto& [latest, before] = promises;
  if (latest && !is_promise_of(*latest, promise.peer, promise.number)) promises = {};
  if (!latest || promise.from_s >= latest->from_s) {
    before = std::exchange(latest, std::move(promise));
  } else if (!before || promise.from_s >= before->from_s || !before->radius_m(now_s)) {
    before = std::move(promise);
  }
}

/// One that has ended is held to for as long again: the clock may go back, and who has heard no
/// later one then rests on it. More than kMostMade there are only where the clock goes back again
/// and again; then nobody who hears anything has the first any more.
void note_made(wire::BodyPromise&& promise, double now_s, std::vector<wire::BodyPromise>& made) {
  std::erase_if(made, [now_s](const wire::BodyPromise& before) {
    return now_s - before.until_s > before.until_s - before.from_s;
  });
  if (made.size() == kMostMade) made.erase(made.begin());
  made.push_back(std::move(promise));
}

}  // namespace

/// The one that says where it may be at the frame's time; null where none does.
const wire::BodyPromise* Session::Impl::promise_of(const Body& body) const {
  if (body.promiser != wire::Mover::kThere) return nullptr;
  for (const std::optional<wire::BodyPromise>& promise : body.promises)
    if (promise && promise->radius_m(time_s)) return &*promise;
  return nullptr;
}

/// Why no promise says where it is; empty where one does. Precondition: one was made.
std::string Session::Impl::why_unpromised(const Body& body) const {
  if (body.promiser != wire::Mover::kThere)
    return wire::why_stale({body.promiser, time_s, 0}, time_s, body.name);
  if (promise_of(body) != nullptr) return {};
  const wire::BodyPromise& latest = *body.promises[0];
  const bool has_ended = time_s > latest.until_s;
  return "the promise of where body " + body.name + " stays " + (has_ended ? "ended " : "begins ") +
         std::to_string(has_ended ? time_s - latest.until_s : latest.from_s - time_s) + " s " +
         (has_ended ? "before" : "after") + " the frame's time";
}

/// Others rest certified answers on promises, so nothing may break one: none, for who has not heard
/// the latest rests on an earlier one.
Status Session::Impl::check_promised(const Body& own, const Motion& motion, double at_s) const {
  for (const wire::BodyPromise& promise : own.made) {
    const std::optional<double> radius_m = promise.radius_m(at_s);
    const double way_m = distance_m(motion.pose.translation_m, promise.place_m);
    // radius_m rounds up.
    if (!radius_m || way_m <= *radius_m * (1 - 0x1p-46)) continue;
    return {StatusCode::kInvalidArgument,
            "body " + own.name + " is " + std::to_string(way_m) + " m from where it was " +
                std::to_string(at_s - promise.from_s) + " s ago, farther than max_speed_mps, " +
                std::to_string(promise.max_speed_mps) +
                ", allows: others were promised that it is not"};
  }
  return Status::ok();
}

Status Session::check_promised(BodyId body, const Motion& motion, double time_s) const {
  const FloatGuard guard;
  const Body* own = impl_->find(body);
  return own == nullptr ? no_such(body) : impl_->check_promised(*own, motion, time_s);
}

/// Of all bodies of a part at once, as soon as one is due.
void Session::Impl::make_promises() {
  if (!has_promised) return;
  const double promise_s = std::clamp(options.promise_s, 0.1, wire::kMaxPromise_s);
  std::map<std::uint32_t, std::vector<Body*>> parts;
  std::set<std::uint32_t> due;
  for (Body* its : own_bodies) {
    Body& own = *its;
    if (own.max_speed_mps <= 0 || !own.motion || own.is_placed || stamp_of(own).time_s != time_s)
      continue;
    if (std::any_of(own.motion->pose.translation_m.begin(), own.motion->pose.translation_m.end(),
                    [](double x) { return std::abs(x) > wire::kMaxPlace_m / 2; }))
      continue;
    const std::uint32_t part = own.number / wire::kBodiesPerPromise;
    parts[part].push_back(&own);
    const double since_s = own.made.empty() ? 0 : time_s - own.made.back().from_s;
    if (own.made.empty() || since_s < 0 || since_s >= kRenewShare * promise_s) due.insert(part);
  }
  for (const std::uint32_t part : due) {
    double farthest_m = 0, slowest_mps = wire::kMaxSpeed_mps;
    for (const Body* own : parts[part]) {
      slowest_mps = std::min(slowest_mps, own->max_speed_mps);
      for (const double x : own->motion->pose.translation_m)
        farthest_m = std::max(farthest_m, std::abs(x));
    }
    wire::BodyPromises promises{
        .peer = channel->own_id(),
        .part = part,
        .from_s = time_s,
        .steps = static_cast<std::uint16_t>(promise_s / wire::kPromiseStep_s),
        .sequence = count_up(promise_samples),
        .quantum = static_cast<std::int8_t>(quantum_of(farthest_m, slowest_mps, promise_s))};
    for (Body* own : parts[part]) {
      wire::BodyPromises::Body entry{.number = own->number};
      for (std::size_t k = 0; k < 3; ++k)
        entry.place[k] =
            std::llround(std::ldexp(own->motion->pose.translation_m[k], -promises.quantum));
      wire::BodyDirectory::Body who;
      who.name = own->name;
      who.max_speed_mps = own->max_speed_mps;
      note_made(wire::promise_of(promises, entry, who), time_s, own->made);
      promises.bodies.push_back(entry);
    }
    channel->promise(promises);
  }
}

void Session::Impl::take_promises(const Channel::Inbox& inbox,
                                  std::vector<std::string>& complaints) {
  for (const wire::BodyPromise& promise : inbox.promises) {
    hear_time(promise.from_s, promise.body, complaints);
    hears_promises = true;
    std::uint32_t& last = last_promises[promise.peer];
    if (is_after(promise.sequence, last)) last = promise.sequence;
    const auto at = named.find(promise.body);
    if (at == named.end()) continue;
    Body& body = *find(at->second);
    if (body.own) {
      if (!std::exchange(body.contested, true))
        complaints.push_back("another peer also moves body " + promise.body +
                             "; its promises are ignored");
      continue;
    }
    // Where the body before it was is not where this one is, however fresh that pose is.
    if (!body.is_placed && body.posed_by != 0 &&
        !is_promise_of(promise, body.posed_by, body.number))
      forget_pose(body);
    body.promiser = wire::Mover::kThere;
    keep(wire::BodyPromise(promise), time_s, body.promises);
  }
}

void Session::Impl::take_wishes(const Channel::Inbox& inbox) {
  const double now_s = clock.seconds();
  std::erase_if(
      wishes, [&](const auto& entry) { return now_s - entry.second.heard_s > wire::kWantedFor_s; });
  for (const wire::WantedPoses& wanted : inbox.wanted) {
    if (wanted.mover != channel->own_id()) continue;
    if (wanted.parts.empty()) {
      wishes.erase(wanted.peer);
      continue;
    }
    if (wishes.size() >= kMaxWishes && !wishes.contains(wanted.peer)) continue;
    Wish& wish = wishes[wanted.peer];
    // Who did not want them has none, so that they go out even of a body at rest.
    for (const wire::WantedPoses::Part& part : wanted.parts)
      if (std::find(wish.wanted.parts.begin(), wish.wanted.parts.end(), part) ==
          wish.wanted.parts.end())
        unserved_parts.insert(part.part);
    wish = {wanted, now_s};
  }
}

std::vector<wire::SessionId> Session::Impl::who_wants(const Body& own) const {
  std::vector<wire::SessionId> who;
  for (const auto& [peer, wish] : wishes)
    if (wish.wanted.wants(own.number)) who.push_back(peer);
  return who;
}

/// In this update it is near, or may be soon.
void Session::Impl::note_near(Body& body) const {
  if (!body.promises[0] || body.own || body.is_placed) return;
  if (!wants_poses(body)) body.wanted_since_s = time_s;
  body.wanted_s = time_s;
}

bool Session::Impl::wants_poses(const Body& body) const {
  return std::abs(time_s - body.wanted_s) <= kLinger_s;
}

void Session::Impl::tell_wishes() {
  if (!hears_promises) return;
  std::map<wire::SessionId, std::map<std::uint32_t, std::uint8_t>> wanted;
  for (const Body* body : present) {
    if (body->own || body->promiser != wire::Mover::kThere || !wants_poses(*body)) continue;
    const wire::BodyPromise& promise = *body->promises[0];
    wanted[promise.peer][promise.number / wire::kBodiesPerPart] |=
        static_cast<std::uint8_t>(1U << (promise.number % wire::kBodiesPerPart));
  }
  for (const auto& [mover, wish] : told_wishes) wanted[mover];
  const double now_s = clock.seconds();
  for (const auto& [mover, parts] : wanted) {
    wire::WantedPoses wish{.peer = channel->own_id(), .mover = mover};
    for (const auto& [part, places] : parts)
      if (wish.parts.size() < wire::kMaxWantedParts) wish.parts.push_back({part, places});
    ToldWish& last = told_wishes[mover];
    if (wish.parts == last.parts && now_s - last.told_s < kRepeatWish_s) continue;
    last = {wish.parts, now_s};
    channel->want(wish);
    if (wish.parts.empty()) told_wishes.erase(mover);
  }
}

}  // namespace nearmesh::subscriber
