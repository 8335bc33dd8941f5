// SPDX-License-Identifier: Apache-2.0
// Bullet GImpact without margin, by its collision algorithm directly: contactPairTest finds nothing
// for such shapes. It has no early out, and its triangle test is a conservative one, so it reports
// more pairs than touch.
#include <BulletCollision/Gimpact/btGImpactCollisionAlgorithm.h>
#include <BulletCollision/Gimpact/btGImpactShape.h>
#include <btBulletCollisionCommon.h>

#include <set>

#include "peers.hpp"

namespace nearmesh::peers {
namespace {

btTransform transform(const Pose& pose) {
  btTransform out;
  const auto& r = pose.rotation;
  const auto f = [](double x) { return static_cast<btScalar>(x); };
  out.setBasis(
      btMatrix3x3(f(r[0]), f(r[1]), f(r[2]), f(r[3]), f(r[4]), f(r[5]), f(r[6]), f(r[7]), f(r[8])));
  out.setOrigin({f(pose.translation_m[0]), f(pose.translation_m[1]), f(pose.translation_m[2])});
  return out;
}

class Shape {
 public:
  explicit Shape(const IndexedMesh& mesh) {
    for (const auto& p : mesh.positions_m)
      for (const double x : p) coordinates_.push_back(static_cast<btScalar>(x));
    for (const auto& f : mesh.faces)
      for (const std::uint32_t v : f) indices_.push_back(static_cast<int>(v));
    triangles_ = std::make_unique<btTriangleIndexVertexArray>(
        static_cast<int>(mesh.faces.size()), indices_.data(), static_cast<int>(3 * sizeof(int)),
        static_cast<int>(mesh.positions_m.size()), coordinates_.data(),
        static_cast<int>(3 * sizeof(btScalar)));
    shape_ = std::make_unique<btGImpactMeshShape>(triangles_.get());
    shape_->setMargin(0);
    shape_->updateBound();
    object_.setCollisionShape(shape_.get());
  }

  void refit(const std::vector<std::array<double, 3>>& positions_m) {
    std::size_t at = 0;
    for (const auto& p : positions_m)
      for (const double x : p) coordinates_[at++] = static_cast<btScalar>(x);
    shape_->postUpdate();
    shape_->updateBound();
  }
  btCollisionObject& object() { return object_; }
  btTriangleIndexVertexArray* triangles() { return triangles_.get(); }
  /// Of its vertices, without margin. The shape copies them.
  [[nodiscard]] std::unique_ptr<btConvexHullShape> hull() const {
    auto hull = std::make_unique<btConvexHullShape>(coordinates_.data(),
                                                    static_cast<int>(coordinates_.size() / 3),
                                                    static_cast<int>(3 * sizeof(btScalar)));
    hull->setMargin(0);
    return hull;
  }

 private:
  std::vector<btScalar> coordinates_;
  std::vector<int> indices_;
  std::unique_ptr<btTriangleIndexVertexArray> triangles_;
  std::unique_ptr<btGImpactMeshShape> shape_;
  btCollisionObject object_;
};

// Takes every contact point as the algorithm finds it, before a manifold thins them out to four.
class Found : public btManifoldResult {
 public:
  Found(const btCollisionObjectWrapper* a, const btCollisionObjectWrapper* b, bool with_places)
      : btManifoldResult(a, b), with_places_(with_places) {}
  // The normal is on B, towards A; the point is on B.
  void addContactPoint(const btVector3& normal, const btVector3& at, btScalar depth) override {
    if (depth > 0) return;
    pairs.emplace(m_index0, m_index1);
    if (with_places_)
      points.push_back({{at[0], at[1], at[2]}, {-normal[0], -normal[1], -normal[2]}, -depth});
  }
  std::set<std::pair<int, int>> pairs;
  std::vector<ContactPoint> points;

 private:
  bool with_places_;
};

class Bullet : public Peer {
 public:
  Bullet(const IndexedMesh& a, const IndexedMesh& b) : dispatcher_(&configuration_), a_(a), b_(b) {
    btGImpactCollisionAlgorithm::registerAlgorithm(&dispatcher_);
  }

  void place(const Pose& a, const Pose& b) override {
    a_.object().setWorldTransform(transform(a));
    b_.object().setWorldTransform(transform(b));
  }
  bool touches() override { return !collide(false).pairs.empty(); }
  std::optional<std::uint64_t> count_pairs() override { return collide(false).pairs.size(); }
  bool refit_b(const std::vector<std::array<double, 3>>& positions_m) override {
    b_.refit(positions_m);
    return true;
  }

  std::optional<std::uint64_t> count_distinct_pairs(std::size_t /*limit*/) override {
    return count_pairs();
  }
  std::optional<std::vector<ContactPoint>> contacts() override {
    return std::move(collide(true).points);
  }
  // The hull of b, against a tree of a's triangles.
  std::optional<bool> touches_on_the_way(const Pose& end_b) override {
    btBvhTriangleMeshShape target(a_.triangles(), true);
    target.setMargin(0);
    const auto hull = b_.hull();
    btDbvtBroadphase broadphase;
    btCollisionWorld world(&dispatcher_, &broadphase, &configuration_);
    btCollisionObject object;
    object.setCollisionShape(&target);
    object.setWorldTransform(a_.object().getWorldTransform());
    world.addCollisionObject(&object);
    const btTransform from = b_.object().getWorldTransform(), to = transform(end_b);
    btCollisionWorld::ClosestConvexResultCallback result(from.getOrigin(), to.getOrigin());
    world.convexSweepTest(hull.get(), from, to, result);
    world.removeCollisionObject(&object);
    return result.hasHit();
  }

 private:
  Found collide(bool with_places) {
    btCollisionObject &a = a_.object(), &b = b_.object();
    const btCollisionObjectWrapper wrap_a(nullptr, a.getCollisionShape(), &a, a.getWorldTransform(),
                                          -1, -1);
    const btCollisionObjectWrapper wrap_b(nullptr, b.getCollisionShape(), &b, b.getWorldTransform(),
                                          -1, -1);
    // What contactPairTest does, with the algorithm that a step of the world uses: GImpact
    // registers no other.
    btCollisionAlgorithm* algorithm =
        dispatcher_.findAlgorithm(&wrap_a, &wrap_b, nullptr, BT_CONTACT_POINT_ALGORITHMS);
    Found found(&wrap_a, &wrap_b, with_places);
    algorithm->processCollision(&wrap_a, &wrap_b, dispatch_info_, &found);
    algorithm->~btCollisionAlgorithm();
    dispatcher_.freeCollisionAlgorithm(algorithm);
    return found;
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_;
  btDispatcherInfo dispatch_info_;
  Shape a_, b_;
};

}  // namespace

PeerInfo bullet() {
  return {.name = "bullet-gimpact",
          .library = "Bullet",
          .version = std::to_string(BT_BULLET_VERSION / 100) + "." +
                     std::to_string(BT_BULLET_VERSION % 100),
          .make = [](const IndexedMesh& a, const IndexedMesh& b) -> std::unique_ptr<Peer> {
            return std::make_unique<Bullet>(a, b);
          }};
}

}  // namespace nearmesh::peers
