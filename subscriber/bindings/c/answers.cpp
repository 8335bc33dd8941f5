// SPDX-License-Identifier: Apache-2.0
#include "answers.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "handle.hpp"

namespace nearmesh::c {
namespace {

template <class Number, std::size_t kCount>
void copy(const std::array<Number, kCount>& from, Number (&to)[kCount]) {
  std::copy(from.begin(), from.end(), to);
}

template <class Number, std::size_t kCount>
std::array<Number, kCount> array_of(const Number (&from)[kCount]) {
  std::array<Number, kCount> to;
  std::copy(from, from + kCount, to.begin());
  return to;
}

// The numbers of the enums are those of the C++ ones.
static_assert(NEARMESH_FREE == static_cast<int>(AnswerStatus::kFree) &&
              NEARMESH_CONTACT == static_cast<int>(AnswerStatus::kContact) &&
              NEARMESH_PARTIAL == static_cast<int>(AnswerStatus::kPartial) &&
              NEARMESH_UNCERTAIN == static_cast<int>(AnswerStatus::kUncertain) &&
              NEARMESH_CONTAINED == static_cast<int>(AnswerStatus::kContained));
static_assert(NEARMESH_NOT_CONTAINED == static_cast<int>(Containment::kNone) &&
              NEARMESH_A_IN_B == static_cast<int>(Containment::kAInB) &&
              NEARMESH_B_IN_A == static_cast<int>(Containment::kBInA) &&
              NEARMESH_IN_EACH_OTHER == static_cast<int>(Containment::kBoth));
static_assert(NEARMESH_CLEARANCE_NONE == static_cast<int>(Clearance::kNone) &&
              NEARMESH_CLEARANCE_BOUND == static_cast<int>(Clearance::kBound) &&
              NEARMESH_CLEARANCE_EXACT == static_cast<int>(Clearance::kExact));

// What never changes, for programs have arrays of it.
static_assert(sizeof(nearmesh_error) == 1024 && sizeof(nearmesh_pose) == 96 &&
              sizeof(nearmesh_motion) == 144 && sizeof(nearmesh_face) == 8 &&
              sizeof(nearmesh_face_pair) == 16 && sizeof(nearmesh_contact_segment) == 72);

nearmesh_face face_of(const FaceKey& key) { return {key.split.value, key.index}; }

}  // namespace

nearmesh_face_pair to_c(const FacePair& pair) { return {face_of(pair.a), face_of(pair.b)}; }

nearmesh_pose to_c(const Pose& pose) {
  nearmesh_pose out;
  copy(pose.rotation, out.rotation);
  copy(pose.translation_m, out.translation_m);
  return out;
}

nearmesh_motion to_c(const Motion& motion) {
  nearmesh_motion out;
  out.pose = to_c(motion.pose);
  copy(motion.linear_velocity_mps, out.linear_velocity_mps);
  copy(motion.angular_velocity_radps, out.angular_velocity_radps);
  return out;
}

Pose from_c(const nearmesh_pose& pose) {
  return {array_of(pose.rotation), array_of(pose.translation_m)};
}

Motion from_c(const nearmesh_motion& motion) {
  return {from_c(motion.pose), array_of(motion.linear_velocity_mps),
          array_of(motion.angular_velocity_radps)};
}

nearmesh_swept to_c(const SweptAnswer& swept) {
  return {.status = static_cast<int32_t>(swept.status),
          .exhausted = swept.exhausted,
          .free_until_s = swept.free_until_s,
          .hit_s = swept.hit_s,
          .missing_a = swept.missing_a.size(),
          .missing_b = swept.missing_b.size()};
}

nearmesh_world_tile to_c(const WorldTile& tile) {
  nearmesh_world_tile out{};
  const std::string content = to_hex(tile.content);
  static_assert(sizeof out.content == 2 * sizeof(ContentHash) + 1);
  std::copy(content.begin(), content.end(), out.content);
  copy(tile.place, out.place);
  return out;
}

ContentText::ContentText(const ContentHash& content) {
  if (!content.is_set()) return;
  const std::string text = to_hex(content);
  std::memcpy(digits, text.c_str(), std::min(text.size(), sizeof digits - 1));
}

nearmesh_model_facts facts_of(const SpmHeader& header, const ContentText& content) {
  nearmesh_model_facts facts{};
  facts.content = content.digits;
  facts.vertex_count = header.vertex_count;
  facts.face_count = header.face_count;
  facts.component_count = header.surface.component_count;
  facts.boundary_edges = header.surface.boundary_edges;
  facts.disagreeing_edges = header.surface.disagreeing_edges;
  facts.is_closed = header.surface.is_closed();
  facts.cell_m = std::ldexp(1.0, header.grid.exponent);
  copy(header.grid.origin_m, facts.grid_origin_m);
  facts.grid_bits = header.grid.bits;
  facts.rounding_error_m = header.rounding_bound_m();
  return facts;
}

void OwnedContacts::fill(const Contacts& of) {
  all_segments.clear();
  all_segments.reserve(of.segments.size());
  for (const ContactSegment& segment : of.segments) {
    nearmesh_contact_segment& out = all_segments.emplace_back();
    copy(segment.p_m, out.p_m);
    copy(segment.q_m, out.q_m);
    out.pair = to_c(segment.pair);
    out.approximate = segment.approximate;
  }
  patches.clear();
  patches.reserve(of.patches.size());
  for (const ContactPatch& patch : of.patches) {
    nearmesh_contact_patch& out = patches.emplace_back();
    out.first = patch.first;
    out.count = patch.count;
    out.length_m = patch.length_m;
    copy(patch.centroid_m, out.centroid_m);
    copy(patch.normal, out.normal);
    out.normal_error_rad = patch.normal_error_rad;
    out.uncertainty_m = patch.uncertainty_m;
    out.normal_is_of_a = patch.normal_is_of_a;
    out.approximate = patch.approximate;
    for (std::size_t i = 0; i < patch.manifold_count; ++i)
      copy(patch.manifold_m[i], out.manifold_m[i]);
    out.manifold_count = patch.manifold_count;
    out.manifold_error_m = patch.manifold_error_m;
  }
  segment_count = all_segments.size();
  segments = all_segments.data();
  patch_count = patches.size();
  position_error_m = of.position_error_m;
  pair_total = of.pair_total;
  truncated = of.truncated;
}

void OwnedAnswer::fill(const Answer& of, const std::optional<Contacts>& of_contacts,
                       const std::optional<Depth>& of_depth) {
  pairs.clear();
  pairs.reserve(of.pairs.size());
  for (const FacePair& pair : of.pairs) pairs.push_back(to_c(pair));
  if (of_contacts) contacts.fill(*of_contacts);
  answer.status = static_cast<int32_t>(of.status);
  answer.is_certified = is_certified(of.status);
  answer.contained = static_cast<int32_t>(of.contained);
  answer.truncated = of.truncated;
  answer.pair_count = pairs.size();
  answer.pairs = pairs.data();
  answer.pair_total = of.pair_total;
  answer.clearance_m = of.clearance_m;
  answer.clearance_share = of.clearance_share;
  answer.uncertainty_m = of.uncertainty_m;
  answer.missing_a = of.missing_a.size();
  answer.missing_b = of.missing_b.size();
  answer.digest = digest(of);
  answer.contacts = of_contacts ? &contacts : nullptr;
  answer.exhausted = of.exhausted;
  answer.distance_at_most_m = of.distance_at_most_m;
  copy(of.nearest_a_m, answer.nearest_a_m);
  copy(of.nearest_b_m, answer.nearest_b_m);
  answer.depth = of_depth ? &depth : nullptr;
  if (!of_depth) return;
  copy(of_depth->direction, depth.direction);
  depth.at_least_m = of_depth->at_least_m;
  depth.at_most_m = of_depth->at_most_m;
  copy(of_depth->separation_m, depth.separation_m);
  depth.missing_a = of_depth->missing_a.size();
  depth.missing_b = of_depth->missing_b.size();
  depth.exhausted = of_depth->exhausted;
}

}  // namespace nearmesh::c

const nearmesh_contact_patch* nearmesh_contacts_patch(const nearmesh_contacts* contacts,
                                                      size_t index) noexcept {
  if (contacts == nullptr || index >= contacts->patch_count) return nullptr;
  return &static_cast<const nearmesh::c::OwnedContacts*>(contacts)->patches[index];
}

const char* nearmesh_answer_status_name(int32_t status) noexcept {
  using nearmesh::AnswerStatus;
  return status >= NEARMESH_FREE && status <= NEARMESH_CONTAINED
             ? to_string(static_cast<AnswerStatus>(status))
             : "unknown";
}
