// SPDX-License-Identifier: Apache-2.0
// What a session tells others of itself: what it holds, what it was asked and answered, how it
// fares.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/hash.hpp"
#include "core/replica/held_nodes.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {

/// To each recorder that comes, and when detail was given up. Not while batches of the model wait:
/// what is said to have come must have been taken in. Nor where it distrusts a publisher: of what
/// comes, recorders would not know what it drops.
void Session::Impl::tell_held(FrameReport& report) {
  replicas.note_given_up();
  for (auto& [name, model] : replicas.all()) {
    const bool is_told = model.told_recorders == recorders && model.told_era == model.era;
    if (recorders == 0 || is_told || !model.is_ready() || !model.waiting.empty() ||
        model.replica->parked_splits() > 0 || !model.replica->distrusted().empty())
      continue;
    model.told_recorders = recorders;
    model.told_era = model.era;
    HeldNodes held = held_nodes(*model.replica);
    if (held.bits.size() > wire::kMaxHeldBytes) {
      report.complaints.push_back(
          "model " + name + ": what is held takes " + std::to_string(held.bits.size()) +
          " bytes to tell a recorder, at most " + std::to_string(wire::kMaxHeldBytes) +
          " are sent: one that came late cannot prove what follows");
      continue;
    }
    wire::HeldDetail message{.peer = channel->own_id(),
                             .content_hash = model.content_hash,
                             .model = model.is_tile ? model.of_world : name,
                             .era = model.era,
                             .applied_batches = model.replica->taken_batches(),
                             .last_request = last_request,
                             .state_digest = model.replica->mesh().state_hash(),
                             .box_digest = held.box_digest,
                             .heard = asked_publishers.heard(),
                             .nodes = std::move(held.bits)};
    channel->tell_held(message);
  }
}

/// `world`: what it rests on where one of the two is a world, and it was asked.
void Session::Impl::report_pair(Pair& pair, const PairAnswer& answer, const Reported& now,
                                wire::ContactReport::World* world) {
  if (pair.reported == now || (answer.put_off && pair.is_told_put_off)) return;
  pair.reported = now;
  pair.is_told_put_off = answer.put_off;
  wire::ContactReport report;
  report.peer = channel->own_id();
  report.body_a = pair.a->name;
  report.body_b = pair.b->name;
  report.frame = now.first;
  report.time_s = time_s;
  report.status = static_cast<std::uint8_t>(answer.answer.status);
  // The wire carries finite numbers; "cannot be bounded" is the largest of them.
  const auto finite = [](double x) { return std::min(x, std::numeric_limits<double>::max()); };
  report.clearance_m = finite(answer.answer.clearance_m);
  report.uncertainty_m = finite(answer.answer.uncertainty_m);
  report.pair_count = static_cast<std::uint32_t>(answer.answer.pair_total);
  report.asked = answer.asked;
  report.put_off = answer.put_off;
  report.cut = is_cut(answer.answer, {.any = options.any});
  report.answer_digest = now.second;
  if (report.asked) {
    const auto as_asked = [](const Body& body, const Pose& pose) {
      wire::ContactReport::Asked asked{
          .content_hash = body.model->content_hash, .solid = body.solid, .pose = pose, .stamp = {}};
      if (body.model->world) return asked;
      asked.state_digest = body.model->replica->mesh().state_hash();
      asked.applied_batches = body.model->replica->taken_batches();
      asked.era = body.model->era;
      return asked;
    };
    report.a = as_asked(*pair.a, answer.pose_a);
    report.b = as_asked(*pair.b, answer.pose_b);
  }
  report.a.stamp = stamp_of(*pair.a);
  report.b.stamp = stamp_of(*pair.b);
  for (const FacePair& faces : answer.answer.pairs) {
    if (report.pairs.size() == wire::kMaxReportPairs) break;
    report.pairs.push_back({faces.a, faces.b});
  }
  if (world != nullptr && world->tiles.size() <= wire::kMaxReportTiles &&
      world->missing_pages.size() <= wire::kMaxReportPages)
    report.world = std::move(*world);
  channel->send(report);
}

/// Which bodies this peer moves, and how old what it knows of the others is.
void Session::Impl::tell_bodies(wire::ProcessStatus& now) const {
  for (const auto& [id, body] : bodies) {
    if (body.own) {
      ++now.moved_bodies;
      if (now.moved.size() < wire::kMaxStatusBodies) now.moved.push_back(body.name);
      continue;
    }
    if (body.is_placed) continue;
    ++now.heard_bodies;
    if (body.is_by_promise) continue;
    const wire::PoseStamp stamp = stamp_of(body);
    if (!wire::why_stale(stamp, time_s, body.name).empty()) ++now.stale_bodies;
    if (const double age_s = wire::age_s(stamp, time_s);
        now.oldest_body.empty() || age_s > now.oldest_age_s) {
      now.oldest_body = body.name;
      now.oldest_age_s = age_s;
    }
  }
}

void Session::Impl::tell_status(const FrameReport& report, const SessionStats& counted) {
  wire::ProcessStatus now;
  now.session = channel->own_id();
  now.requests = counted.requests;
  now.refused = refused;
  now.batches = counted.batches;
  now.bytes = counted.batch_bytes;
  now.lost_batches = counted.sequence_gaps;
  now.waiting_batches = report.batches_waiting;
  const auto capped = [](std::uint64_t n) {
    return static_cast<std::uint32_t>(std::min<std::uint64_t>(n, 0xffffffffU));
  };
  now.watched_pairs =
      capped(report.answers.size() + report.free_by_bounds.pairs + report.unknown_pairs);
  now.certified_pairs = capped(report.free_by_bounds.pairs);
  for (const PairAnswer& pair : report.answers) {
    if (is_certified(pair.answer.status)) {
      ++now.certified_pairs;
    } else {
      now.uncertainty_m = std::max(now.uncertainty_m, std::min(pair.answer.uncertainty_m,
                                                               std::numeric_limits<double>::max()));
    }
  }
  tell_bodies(now);
  // Those of bodies that are here first: models stay when their bodies are gone, and all may be
  // more than can be told.
  std::set<const PeerModel*> used;
  for (const Body* body : present) used.insert(body->model);
  for (const bool is_used : {true, false})
    for (const auto& [name, model] : replicas.all()) {
      if (now.models.size() == wire::kMaxModels) break;
      if (model.is_tile || used.contains(&model) != is_used) continue;
      wire::ProcessStatus::Model entry{.name = name, .content_hash = model.content_hash};
      if (model.is_ready()) {
        const SpmHeader& header = model.replica->header();
        entry.faces = header.face_count;
        entry.held_splits = model.replica->mesh().split_count();
        entry.splits = header.split_count();
      }
      now.models.push_back(std::move(entry));
    }
  for (const auto& [name, model] : replicas.all())  // as long as it lasts
    if (!model.conflict.empty())
      keeper.note("model " + name + ": " + model.conflict, clock.seconds());
  keeper.complete(now, clock.seconds());
  channel->tell(now);
  told = std::move(now);
}

}  // namespace nearmesh::subscriber
