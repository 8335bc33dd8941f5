// SPDX-License-Identifier: Apache-2.0
// What a session tells recorders of the pairs that bounds prove apart: which bodies it knows of,
// when that changes, and in each frame a few numbers. Recorded poses make up the rest.
#include <algorithm>
#include <limits>
#include <utility>

#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

[[nodiscard]] std::uint32_t watched_part_of(BodyId body) {
  return body.value / wire::kWatchedPerPart;
}

using Told = Body::Told;

/// Of a body that its mover's number names.
[[nodiscard]] bool is_numbered(const Told& told) {
  return told.known == Told::Known::kByPose || told.known == Told::Known::kPromised;
}

[[nodiscard]] wire::WatchedBodies::Run run_of(const Body& body) {
  return {.known = body.told.known == Told::Known::kPromised ? wire::WatchedBodies::Known::kPromised
                                                             : wire::WatchedBodies::Known::kByPose,
          .mover = body.told.mover,
          .first = body.told.number,
          .count = 1,
          .content = body.told.content,
          .group = body.company.group,
          .mask = body.company.mask,
          .max_age_s = body.stamp.max_age_s};
}

}  // namespace

/// By what the body's place is known, but for the age of its pose, which follows from the pose.
void Session::Impl::note_known(Body& body) {
  Told now;
  const bool has_model =
      body.model->is_ready() || (body.model->world && body.model->world->root() != nullptr);
  const bool is_posed = body.motion && body.stamp.mover == wire::Mover::kThere;
  const bool is_promised = !body.own && !body.is_placed && body.promises[0];
  const ContentHash& content = body.model->content_hash;
  if (has_model && is_promised && (is_posed || body.promiser == wire::Mover::kThere)) {
    now = {Told::Known::kPromised, body.promises[0]->peer, body.promises[0]->number, content};
  } else if (has_model && is_posed && body.is_placed) {
    now = {Told::Known::kInPlace, 0, 0, content};
  } else if (has_model && is_posed && body.mover != 0) {
    now = {body.max_speed_mps > 0 ? Told::Known::kPromised : Told::Known::kByPose, body.mover,
           body.number, content};
  }
  // A stranger that takes this session's name moves nothing of its own.
  if (is_numbered(now) && body.own != (now.mover == channel->own_id())) now = {};
  note_told(body, now);
}

void Session::Impl::note_told(Body& body, const Told& now) {
  const bool is_replaced = now.known == Told::Known::kInPlace && body.is_new_to_bounds;
  if (now == body.told && !is_replaced) return;
  untold_watched.insert(watched_part_of(body.id));
  if (is_numbered(body.told))
    if (const auto at = watched_movers.find(body.told.mover); --at->second == 0)
      watched_movers.erase(at);
  if (is_numbered(now)) ++watched_movers[now.mover];
  body.told = now;
}

void Session::Impl::tell_watched() {
  if (untold_watched.empty()) return;
  ++watched_edition;
  for (const std::uint32_t part : std::exchange(untold_watched, {})) {
    wire::WatchedBodies watched{.peer = channel->own_id(),
                                .part = part,
                                .edition = watched_edition,
                                .horizon_s = horizon_s(),
                                .margin_m = options.margin_m,
                                .only_own = watches_only_own};
    for (auto at = bodies.lower_bound(part * wire::kWatchedPerPart);
         at != bodies.end() && watched_part_of(at->second.id) == part; ++at) {
      const Body& body = at->second;
      if (body.told.known == Told::Known::kInPlace) {
        watched.placed.push_back({body.name, body.told.content, body.company.group,
                                  body.company.mask, body.own, body.motion->pose});
      } else if (is_numbered(body.told)) {
        wire::WatchedBodies::Run run = run_of(body);
        if (!watched.runs.empty()) {
          wire::WatchedBodies::Run& last = watched.runs.back();
          wire::WatchedBodies::Run next = last;
          next.first += last.count;
          next.count = 1;
          if (next == run) {
            ++last.count;
            continue;
          }
        }
        watched.runs.push_back(std::move(run));
      }
    }
    channel->tell_watched(watched);
  }
}

/// Whether the last sample of its mover that came does not tell which one its pose came in.
bool Session::Impl::is_posed_apart(const Body& body) const {
  if (body.own || !is_numbered(body.told)) return false;
  if (body.told.known == Told::Known::kPromised)
    return !body.is_by_promise && broad.is_placed(*body.slot);
  // Also where it is too old: a later one would not be.
  const auto heard = last_pose_samples.find(body.told.mover);
  return heard != last_pose_samples.end() && heard->second.lost != 0 &&
         is_after(heard->second.lost, body.pose_sequence);
}

/// What the bodies are known by, of each mover.
std::vector<wire::BoundsReport::Heard> Session::Impl::heard_of_movers() {
  std::vector<wire::BoundsReport::Heard> heard;
  std::map<wire::SessionId, std::size_t> places;
  for (const auto& [mover, count] : watched_movers) {
    const bool is_own = mover == channel->own_id();
    places.emplace(mover, heard.size());
    heard.push_back({.poses = is_own ? pose_samples : last_pose_samples[mover].last,
                     .promises = is_own ? 0 : last_promises[mover],
                     .near = is_own ? near_samples : 0,
                     .posed = {}});
  }
  const bool has_lost_any = std::any_of(last_pose_samples.begin(), last_pose_samples.end(),
                                        [](const auto& entry) { return entry.second.lost != 0; });
  // What does not fit into a report is not proved; the rest is.
  std::size_t room = hears_promises || has_lost_any ? wire::kMaxWatchedPosed : 0;
  for (auto at = present.begin(); at != present.end() && room > 0; ++at) {
    const Body& body = **at;
    if (!is_posed_apart(body)) continue;
    heard[places.at(body.told.mover)].posed.push_back({body.told.number, body.pose_sequence});
    --room;
  }
  for (wire::BoundsReport::Heard& one : heard)
    std::sort(one.posed.begin(), one.posed.end(),
              [](const auto& a, const auto& b) { return a.number < b.number; });
  return heard;
}

/// `free`: how many pairs of bodies that have boxes do not meet. Nothing is said where there are
/// none.
void Session::Impl::tell_bounds(std::uint64_t frame, std::uint64_t free, const Bounded& bounded) {
  tell_watched();
  if (free == 0) return;
  wire::BoundsReport report{
      .peer = channel->own_id(),
      .edition = watched_edition,
      .frame = frame,
      .time_s = time_s,
      .places_digest = bounded.places_digest,
      .pairs = static_cast<std::uint32_t>(
          std::min<std::uint64_t>(free, std::numeric_limits<std::uint32_t>::max())),
      .clearance_m = float_at_most(bounded.pairs.clearance_m(options.margin_m)),
      .horizon_s = float_at_most(bounded.pairs.horizon_s(horizon_s())),
      .rests_on_more = bounded.rests_on_more,
      .heard = heard_of_movers()};
  channel->tell_bounds(report);
}

}  // namespace nearmesh::subscriber
