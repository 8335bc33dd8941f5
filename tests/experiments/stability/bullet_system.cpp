// SPDX-License-Identifier: Apache-2.0
// Bullet in double precision: btGImpactMeshShape without margin, contacts as found by its algorithm; one counts at
// distance <= 0.
#include <BulletCollision/CollisionDispatch/btDefaultCollisionConfiguration.h>
#include <BulletCollision/Gimpact/btGImpactCollisionAlgorithm.h>
#include <BulletCollision/Gimpact/btGImpactShape.h>
#include <btBulletCollisionCommon.h>

#include <set>

#include "contact_check.hpp"
#include "held.hpp"
#include "system.hpp"

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;

/// A shape and the arrays that it refers to.
struct BulletMesh {
  explicit BulletMesh(const IndexedMesh& mesh) {
    for (const auto& p : mesh.positions_m) points.insert(points.end(), p.begin(), p.end());
    for (const auto& f : mesh.faces)
      for (const std::uint32_t corner : f) corners.push_back(static_cast<int>(corner));
    array = std::make_unique<btTriangleIndexVertexArray>(
        static_cast<int>(mesh.faces.size()), corners.data(), static_cast<int>(3 * sizeof(int)),
        static_cast<int>(mesh.positions_m.size()), points.data(),
        static_cast<int>(3 * sizeof(btScalar)));
    shape = std::make_unique<btGImpactMeshShape>(array.get());
    shape->setMargin(0);
    shape->updateBound();
  }
  std::vector<btScalar> points;
  std::vector<int> corners;
  std::unique_ptr<btTriangleIndexVertexArray> array;
  std::unique_ptr<btGImpactMeshShape> shape;
};

btTransform transform(const Pose& pose) {
  const auto& r = pose.rotation;
  const auto& t = pose.translation_m;
  return btTransform(btMatrix3x3(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]),
                     btVector3(t[0], t[1], t[2]));
}

/// Takes every contact point as the algorithm finds it, before a manifold thins them out to four.
struct Pairs : btManifoldResult {
  using btManifoldResult::btManifoldResult;
  /// The normal is on B, towards A; the point is on B.
  void addContactPoint(const btVector3& normal, const btVector3& at, btScalar depth) override {
    if (depth > 0) return;
    found.emplace(m_index0, m_index1);
    points.push_back({{at[0], at[1], at[2]}, {-normal[0], -normal[1], -normal[2]}});
  }
  std::set<std::pair<int, int>> found;
  std::vector<ContactPoint> points;
};

/// The moving body's hull (it is convex in every scene) against the mesh of the other.
Verdict sweep(const Case& asked, BulletMesh& a, const BulletMesh& b) {
  btBvhTriangleMeshShape target(a.array.get(), true);
  target.setMargin(0);
  btConvexHullShape hull(b.points.data(), static_cast<int>(b.points.size() / 3),
                         static_cast<int>(3 * sizeof(btScalar)));
  hull.setMargin(0);
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btDbvtBroadphase broadphase;
  btCollisionWorld world(&dispatcher, &broadphase, &configuration);
  btCollisionObject object;
  object.setCollisionShape(&target);
  object.setWorldTransform(transform(asked.a.pose));
  world.addCollisionObject(&object);
  Pose end = asked.end_b;
  if (asked.half_turn) end.rotation = {-1, 0, 0, 0, -1, 0, 0, 0, 1};
  const btTransform from = transform(asked.b.pose), to = transform(end);
  btCollisionWorld::ClosestConvexResultCallback result(from.getOrigin(), to.getOrigin());
  world.convexSweepTest(&hull, from, to, result);
  world.removeCollisionObject(&object);
  return {.kind = result.hasHit() ? Kind::kTouches : Kind::kFree};
}

class Bullet : public System {
 public:
  [[nodiscard]] std::string name() const override { return "Bullet"; }
  [[nodiscard]] std::string version() const override {
    return std::to_string(BT_BULLET_VERSION / 100) + "." + std::to_string(BT_BULLET_VERSION % 100);
  }
  [[nodiscard]] std::string call() const override {
    return "double precision, btGImpactMeshShape with margin 0, "
           "btGImpactCollisionAlgorithm::processCollision; contacts at distance <= 0, pairs are "
           "distinct (triangle, triangle). F7: convexSweepTest of the moving body's hull against "
           "btBvhTriangleMeshShape. F8, F9: "
           "the points and normals that the algorithm reports";
  }

  [[nodiscard]] Verdict answer(const Case& asked) const override {
    if (asked.question == Question::kBounds || asked.question == Question::kIncremental) return {};
    if (asked.question == Question::kFile || asked.question == Question::kLimit) return {};
    BulletMesh a(held_of(asked)), b(*asked.b.mesh);
    if (asked.question == Question::kSweep) return sweep(asked, a, b);
    btDefaultCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher(&configuration);
    btGImpactCollisionAlgorithm::registerAlgorithm(&dispatcher);
    btDbvtBroadphase broadphase;
    btCollisionWorld world(&dispatcher, &broadphase, &configuration);
    btCollisionObject object_a, object_b;
    object_a.setCollisionShape(a.shape.get());
    object_b.setCollisionShape(b.shape.get());
    object_a.setWorldTransform(transform(asked.a.pose));
    object_b.setWorldTransform(transform(asked.b.pose));
    const btCollisionObjectWrapper wrapped_a(nullptr, a.shape.get(), &object_a,
                                             object_a.getWorldTransform(), -1, -1);
    const btCollisionObjectWrapper wrapped_b(nullptr, b.shape.get(), &object_b,
                                             object_b.getWorldTransform(), -1, -1);
    // What contactPairTest does, with the algorithm that a step of the world uses: GImpact registers no other.
    btCollisionAlgorithm* algorithm =
        dispatcher.findAlgorithm(&wrapped_a, &wrapped_b, nullptr, BT_CONTACT_POINT_ALGORITHMS);
    Pairs pairs(&wrapped_a, &wrapped_b);
    algorithm->processCollision(&wrapped_a, &wrapped_b, world.getDispatchInfo(), &pairs);
    algorithm->~btCollisionAlgorithm();
    dispatcher.freeCollisionAlgorithm(algorithm);
    if (asked.question == Question::kContacts) return judge_contacts(asked, pairs.points);
    return {.kind = pairs.found.empty() ? Kind::kFree : Kind::kTouches,
            .has_pairs = true,
            .pairs = pairs.found.size()};
  }
};

}  // namespace

std::unique_ptr<System> make_bullet() { return std::make_unique<Bullet>(); }

}  // namespace nearmesh::stability
