// SPDX-License-Identifier: Apache-2.0
// What a session tells recorders of the pairs that bounds prove apart: which bodies it knows of, when that changes, and in each frame a
// few numbers. Recorded poses make up the rest.
#include <algorithm>
#include <limits>
#include <utility>

#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

[[nodiscard]] std::uint32_t watched_part_of(BodyId body) {
  return body.value / wire::kWatchedPerPart;
}

/// Of a body that is known by its poses.
[[nodiscard]] wire::WatchedBodies::Run run_of(const Body& body) {
  return {.known = wire::WatchedBodies::Known::kByPose,
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
  Body::Told now;
  const bool has_model =
      body.model->is_ready() || (body.model->world && body.model->world->root() != nullptr);
  if (has_model && body.motion && body.stamp.mover == wire::Mover::kThere) {
    if (body.is_placed) {
      now = {Body::Told::Known::kInPlace, 0, 0, body.model->content_hash};
    } else if (body.mover != 0) {
      now = {Body::Told::Known::kByPose, body.mover, body.number, body.model->content_hash};
    }
  }
  note_told(body, now);
}

void Session::Impl::note_told(Body& body, const Body::Told& now) {
  const bool is_replaced = now.known == Body::Told::Known::kInPlace && body.is_new_to_bounds;
  if (now == body.told && !is_replaced) return;
  untold_watched.insert(watched_part_of(body.id));
  if (body.told.known == Body::Told::Known::kByPose)
    if (const auto at = watched_movers.find(body.told.mover); --at->second == 0)
      watched_movers.erase(at);
  if (now.known == Body::Told::Known::kByPose) ++watched_movers[now.mover];
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
                                .margin_m = options.margin_m};
    for (auto at = bodies.lower_bound(part * wire::kWatchedPerPart);
         at != bodies.end() && watched_part_of(at->second.id) == part; ++at) {
      const Body& body = at->second;
      if (body.told.known == Body::Told::Known::kInPlace) {
        watched.placed.push_back({body.name, body.told.content, body.company.group,
                                  body.company.mask, body.motion->pose});
      } else if (body.told.known == Body::Told::Known::kByPose) {
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

/// `free`: how many pairs of bodies that have boxes do not meet. Nothing is said where there are none.
void Session::Impl::tell_bounds(std::uint64_t frame, std::uint64_t free,
                                std::uint64_t places_digest, const FreePairs& bounds) {
  tell_watched();
  if (free == 0) return;
  wire::BoundsReport report{.peer = channel->own_id(),
                            .edition = watched_edition,
                            .frame = frame,
                            .time_s = time_s,
                            .places_digest = places_digest,
                            .pairs = static_cast<std::uint32_t>(std::min<std::uint64_t>(
                                free, std::numeric_limits<std::uint32_t>::max())),
                            .clearance_m = float_at_most(bounds.clearance_m(options.margin_m)),
                            .horizon_s = float_at_most(bounds.horizon_s(horizon_s()))};
  for (const auto& [mover, count] : watched_movers)
    report.heard.push_back(mover == channel->own_id() ? pose_samples : last_pose_samples[mover]);
  channel->tell_bounds(report);
}

}  // namespace nearmesh::subscriber
