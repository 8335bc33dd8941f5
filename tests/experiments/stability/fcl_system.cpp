// SPDX-License-Identifier: Apache-2.0
// FCL: BVHModel<OBBRSSd>, collide() for all contacts without contact geometry (one contact a pair of triangles).
#include <fcl/fcl.h>

#include <set>

#include "contact_check.hpp"
#include "held.hpp"
#include "system.hpp"

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;
using FclModel = fcl::BVHModel<fcl::OBBRSSd>;

constexpr std::size_t kAllContacts = 100'000'000;

std::shared_ptr<FclModel> build(const IndexedMesh& mesh) {
  std::vector<fcl::Vector3d> points;
  for (const auto& p : mesh.positions_m) points.emplace_back(p[0], p[1], p[2]);
  std::vector<fcl::Triangle> triangles;
  for (const auto& f : mesh.faces) triangles.emplace_back(f[0], f[1], f[2]);
  auto model = std::make_shared<FclModel>();
  if (model->beginModel() != fcl::BVH_OK || model->addSubModel(points, triangles) != fcl::BVH_OK ||
      model->endModel() != fcl::BVH_OK)
    return nullptr;
  return model;
}

fcl::Transform3d transform(const Pose& pose) {
  fcl::Transform3d t = fcl::Transform3d::Identity();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c)
      t.linear()(r, c) = pose.rotation[static_cast<std::size_t>(3 * r + c)];
    t.translation()[r] = pose.translation_m[static_cast<std::size_t>(r)];
  }
  return t;
}

Verdict sweep(const Case& asked, const FclModel& a, const FclModel& b) {
  fcl::ContinuousCollisionRequestd request;
  request.ccd_solver_type = fcl::CCDC_NAIVE;
  request.ccd_motion_type = fcl::CCDM_LINEAR;
  request.num_max_iterations = 1000;
  fcl::ContinuousCollisionResultd result;
  Pose end = asked.end_b;
  if (asked.half_turn) end.rotation = {-1, 0, 0, 0, -1, 0, 0, 0, 1};
  fcl::continuousCollide(&a, transform(asked.a.pose), transform(asked.a.pose), &b,
                         transform(asked.b.pose), transform(end), request, result);
  return {.kind = result.is_collide ? Kind::kTouches : Kind::kFree};
}

Verdict contacts(const Case& asked, const FclModel& a, const FclModel& b) {
  const fcl::CollisionRequestd request(kAllContacts, true);
  fcl::CollisionResultd result;
  fcl::collide(&a, transform(asked.a.pose), &b, transform(asked.b.pose), request, result);
  std::vector<ContactPoint> points;
  for (std::size_t i = 0; i < result.numContacts(); ++i) {
    const auto& contact = result.getContact(i);
    points.push_back({{contact.pos[0], contact.pos[1], contact.pos[2]},
                      {contact.normal[0], contact.normal[1], contact.normal[2]}});
  }
  return judge_contacts(asked, points);
}

class Fcl : public System {
 public:
  [[nodiscard]] std::string name() const override { return "FCL"; }
  [[nodiscard]] std::string version() const override { return FCL_VERSION; }
  [[nodiscard]] std::string call() const override {
    return "BVHModel<OBBRSSd>, collide() with num_max_contacts 1e8 (F18: the limit) and "
           "enable_contact false; "
           "pairs are distinct (b1, b2). F7: continuousCollide(), CCDC_NAIVE with 1000 steps, "
           "CCDM_LINEAR (of its "
           "settings the one that finds most of these hits). "
           "F8, F9: enable_contact true, Contact::pos and normal";
  }

  [[nodiscard]] Verdict answer(const Case& asked) const override {
    if (asked.question == Question::kBounds || asked.question == Question::kIncremental) return {};
    if (asked.question == Question::kFile) return {};
    const auto a = build(held_of(asked)), b = build(*asked.b.mesh);
    if (!a || !b) return {.kind = Kind::kRefused};
    if (asked.question == Question::kSweep) return sweep(asked, *a, *b);
    if (asked.question == Question::kContacts) return contacts(asked, *a, *b);
    const fcl::CollisionRequestd request(
        asked.question == Question::kLimit ? asked.limit : kAllContacts, false);
    fcl::CollisionResultd result;
    fcl::collide(a.get(), transform(asked.a.pose), b.get(), transform(asked.b.pose), request,
                 result);
    std::set<std::pair<std::intptr_t, std::intptr_t>> pairs;
    for (std::size_t i = 0; i < result.numContacts(); ++i)
      pairs.emplace(result.getContact(i).b1, result.getContact(i).b2);
    return {.kind = result.isCollision() ? Kind::kTouches : Kind::kFree,
            .has_pairs = true,
            .pairs = pairs.size()};
  }
};

}  // namespace

std::unique_ptr<System> make_fcl() { return std::make_unique<Fcl>(); }

}  // namespace nearmesh::stability
