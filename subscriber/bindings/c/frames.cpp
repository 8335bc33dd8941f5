// SPDX-License-Identifier: Apache-2.0
// What a frame says, as C reads it.
#include <utility>

#include "session.hpp"

namespace nearmesh::c {

void OwnedWorld::fill(const subscriber::WorldAnswer& of) {
  text = ContentText(of.world);
  content = text.digits;
  tiles.clear();
  for (const subscriber::NearTile& tile : of.tiles)
    tiles.push_back({.tile = to_c(tile.tile),
                     .is_here = tile.is_here,
                     .asked = tile.asked,
                     .status = static_cast<int32_t>(tile.status),
                     .pairs = tile.pairs,
                     .missing = tile.missing.size()});
  tile_count = tiles.size();
  missing_page_count = of.missing_pages.size();
}

void OwnedPair::fill(const subscriber::PairAnswer& of) {
  answer.fill(of.answer, of.contacts, of.depth);
  content_a = ContentText(of.content_a);
  content_b = ContentText(of.content_b);
  pair.a = of.a.value;
  pair.b = of.b.value;
  pair.answer = &answer.answer;
  pair.reason = of.reason.c_str();
  pair.awaited = of.awaited.c_str();
  pair.asked = of.asked;
  pair.age_a_s = of.age_a_s;
  pair.age_b_s = of.age_b_s;
  pair.pose_a = to_c(of.pose_a);
  pair.pose_b = to_c(of.pose_b);
  pair.content_a = content_a.digits;
  pair.content_b = content_b.digits;
  pair.safe_horizon_s = of.safe_horizon_s;
  pair.put_off = of.put_off;
  if (of.last_certified)
    last_certified = {.status = static_cast<int32_t>(of.last_certified->status),
                      .contained = static_cast<int32_t>(of.last_certified->contained),
                      .pair_total = of.last_certified->pair_total,
                      .age_s = of.last_certified->age_s,
                      .clearance_m = of.last_certified->clearance_m,
                      .safe_s = of.last_certified->safe_s};
  pair.last_certified = of.last_certified ? &last_certified : nullptr;
  if (of.swept) swept = to_c(*of.swept);
  pair.swept = of.swept ? &swept : nullptr;
  pair.contact_ids = of.contact_ids.data();
  if (of.world) world.fill(*of.world);
  pair.world = of.world ? &world : nullptr;
}

void OwnedFrame::fill(subscriber::FrameReport of) {
  report = std::move(of);
  while (pairs.size() < report.answers.size()) pairs.emplace_back();
  for (std::size_t i = 0; i < report.answers.size(); ++i) pairs[i].fill(report.answers[i]);
  contact_events.clear();
  for (const subscriber::ContactEvent& event : report.contact_events)
    contact_events.push_back({.change = static_cast<int32_t>(event.change),
                              .patch = event.patch,
                              .id = event.id,
                              .a = event.a.value,
                              .b = event.b.value});
  unknown.clear();
  for (const subscriber::UnknownBody& body : report.unknown)
    unknown.push_back({body.body.value, 0, body.reason.c_str()});
  frame.answer_count = report.answers.size();
  frame.unknown_count = report.unknown.size();
  frame.complaint_count = report.complaints.size();
  frame.all_certified = report.all_certified();
  frame.free_by_bounds = report.free_by_bounds.pairs;
  frame.free_clearance_m = report.free_by_bounds.clearance_m;
  frame.free_horizon_s = report.free_by_bounds.horizon_s;
  frame.free_digest = report.free_by_bounds.digest;
  frame.unknown_pairs = report.unknown_pairs;
  frame.load_s = report.load_s;
  frame.refine_s = report.refine_s;
  frame.tree_s = report.tree_s;
  frame.broad_s = report.broad_s;
  frame.query_s = report.query_s;
  frame.batches_waiting = report.batches_waiting;
  frame.state_digest = report.state_digest;
  frame.answers_digest = report.answers_digest;
  frame.pairs_put_off = report.pairs_put_off;
  frame.contact_event_count = contact_events.size();
  frame.came_count = report.came.size();
  frame.went_count = report.went.size();
  frame.promised = report.promised;
}

}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C
using subscriber::BodyId;

const nearmesh_pair_answer* nearmesh_session_answer(const nearmesh_session* session,
                                                    size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->frame.answer_count)
    return nullptr;
  return &session->frame->pairs[index].pair;
}

const nearmesh_near_tile* nearmesh_world_answer_tile(const nearmesh_world_answer* answer,
                                                     size_t index) noexcept {
  if (answer == nullptr || index >= answer->tile_count) return nullptr;
  return &static_cast<const c::OwnedWorld*>(answer)->tiles[index];
}

const nearmesh_pair_answer* nearmesh_session_find(const nearmesh_session* session, nearmesh_body a,
                                                  nearmesh_body b) noexcept {
  if (!c::is_handle(session) || !session->frame) return nullptr;
  const auto* found = session->frame->report.find(BodyId{a}, BodyId{b});
  if (found == nullptr) return nullptr;
  return &session->frame
              ->pairs[static_cast<std::size_t>(found - session->frame->report.answers.data())]
              .pair;
}

const nearmesh_contact_event* nearmesh_session_contact_event(const nearmesh_session* session,
                                                             size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->contact_events.size())
    return nullptr;
  return &session->frame->contact_events[index];
}

const nearmesh_unknown_body* nearmesh_session_unknown(const nearmesh_session* session,
                                                      size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->unknown.size())
    return nullptr;
  return &session->frame->unknown[index];
}

nearmesh_body nearmesh_session_came(const nearmesh_session* session, size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->report.came.size())
    return NEARMESH_NONE;
  return session->frame->report.came[index].value;
}

nearmesh_body nearmesh_session_went(const nearmesh_session* session, size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->report.went.size())
    return NEARMESH_NONE;
  return session->frame->report.went[index].value;
}

const char* nearmesh_session_complaint(const nearmesh_session* session, size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame ||
      index >= session->frame->report.complaints.size())
    return nullptr;
  return session->frame->report.complaints[index].c_str();
}
