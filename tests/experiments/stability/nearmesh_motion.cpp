// SPDX-License-Identifier: Apache-2.0
// nearmesh's answers about insides, paths and places of contact.
#include "contact_check.hpp"
#include "fault_of.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "nearmesh/core/query/sweep.hpp"
#include "nearmesh_questions.hpp"

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;

constexpr double kHalfTurn_rad = 3.14159265358979323846;

Kind kind_of(AnswerStatus status) {
  switch (status) {
    case AnswerStatus::kFree:
      return Kind::kFree;
    case AnswerStatus::kContact:
    case AnswerStatus::kPartial:
    case AnswerStatus::kContained:
      return Kind::kTouches;
    case AnswerStatus::kUncertain:
      return Kind::kUndecided;
  }
  return Kind::kContradicts;
}

}  // namespace

NearmeshAnswer ask_solids(const Case& asked, const Model& model_a, const Model& model_b,
                          const PosedPair& posed) {
  const SpmHeader &header_a = model_a.baked.header, &header_b = model_b.baked.header;
  if (asked.solid_a && !check_solid(header_a.surface, "a").is_ok())
    return {.verdict = {.kind = Kind::kRefused}};
  if (asked.solid_b && !check_solid(header_b.surface, "b").is_ok())
    return {.verdict = {.kind = Kind::kRefused}};
  const QueryOptions options{.solid_a = asked.solid_a, .solid_b = asked.solid_b};
  LocalModel a(model_a.baked.store, header_a.grid), b(model_b.baked.store, header_b.grid);
  const Answer base = query(a.view(), posed.a, b.view(), posed.b, options);
  refine(a, every_split(model_a.baked.store));
  refine(b, every_split(model_b.baked.store));
  const Answer full = query(a.view(), posed.a, b.view(), posed.b, options);
  NearmeshAnswer out{.verdict = {.kind = kind_of(full.status)}};
  if (const std::string fault = test::fault_of(base, full); !fault.empty())
    out.trouble = "the base: " + fault;
  LocalModel part_a(model_a.baked.store, header_a.grid), part_b(model_b.baked.store, header_b.grid);
  const auto require = [](NodeSpan) { return Status::ok(); };
  const Result<Answer> certified =
      certify(part_a, posed.a, require, part_b, posed.b, require, options);
  if (!certified.is_ok()) {
    out.trouble = certified.status().message();
  } else if (!is_certified(certified.value().status)) {
    out.trouble = "certify: not certified";
  } else if (const std::string fault = test::fault_of(certified.value(), full); !fault.empty()) {
    out.trouble = "certify: " + fault;
  }
  return out;
}

NearmeshAnswer ask_sweep(const Case& asked, const Model& model_a, const Model& model_b) {
  const SplitStore &store_a = model_a.baked.store, &store_b = model_b.baked.store;
  LocalModel a(store_a, model_a.baked.header.grid), b(store_b, model_b.baked.header.grid);
  const Motion still{.pose = asked.a.pose};
  Motion moving{.pose = asked.b.pose};
  for (std::size_t k = 0; k < 3; ++k)
    moving.linear_velocity_mps[k] = asked.end_b.translation_m[k] - asked.b.pose.translation_m[k];
  if (asked.half_turn) moving.angular_velocity_radps[2] = kHalfTurn_rad;
  const SweepOptions options{.duration_s = 1, .time_levels = kMaxTimeLevels};
  const auto ask = [&] { return sweep(a.view(), still, "a", b.view(), moving, "b", options); };
  const Result<SweptAnswer> base = ask();
  refine(a, every_split(store_a));
  refine(b, every_split(store_b));
  const Result<SweptAnswer> full = ask();
  if (!base.is_ok() || !full.is_ok()) return {.verdict = {.kind = Kind::kRefused}};
  NearmeshAnswer out{.verdict = {.kind = kind_of(full.value().status)}};
  if (base.value().status == AnswerStatus::kFree && full.value().status != AnswerStatus::kFree)
    out.trouble = "the base says free";
  if (base.value().free_until_s > full.value().hit_s)
    out.trouble = "the base is free beyond the instant of the hit";
  return out;
}

NearmeshAnswer ask_contacts(const Case& asked, const Model& model_a, const Model& model_b,
                            const PosedPair& posed) {
  const SplitStore &store_a = model_a.baked.store, &store_b = model_b.baked.store;
  LocalModel a(store_a, model_a.baked.header.grid), b(store_b, model_b.baked.header.grid);
  refine(a, asked.model_a ? asked.held_a : every_split(store_a));
  refine(b, every_split(store_b));
  Contacts contacts;
  if (asked.model_a) {
    contacts = approximate_contacts(a.mesh, posed.a, b.mesh, posed.b);
  } else {
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    contacts = find_contacts(a.view(), posed.a, b.view(), posed.b, answer);
  }
  std::vector<ContactPoint> points;
  for (const ContactPatch& patch : contacts.patches)
    for (std::uint32_t i = patch.first; i < patch.first + patch.count; ++i)
      for (const auto& end : {contacts.segments[i].p_m, contacts.segments[i].q_m})
        points.push_back({end, patch.normal});
  NearmeshAnswer out{.verdict = judge_contacts(asked, points)};
  for (const ContactPatch& patch : contacts.patches)
    if (patch.normal_error_rad == kNoNormal_rad) out.trouble = "a patch without a normal";
  return out;
}

}  // namespace nearmesh::stability
