// SPDX-License-Identifier: Apache-2.0
// Bullet GImpact, by its collision algorithm directly: contactPairTest finds nothing for such shapes. It has no early
// out, and its triangle test is a conservative one, so it reports more pairs than touch.
#include <BulletCollision/Gimpact/btGImpactCollisionAlgorithm.h>
#include <BulletCollision/Gimpact/btGImpactShape.h>
#include <btBulletCollisionCommon.h>

#include <set>

#include "contender.hpp"

namespace nearmesh::perf {
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

 private:
  std::vector<btScalar> coordinates_;
  std::vector<int> indices_;
  std::unique_ptr<btTriangleIndexVertexArray> triangles_;
  std::unique_ptr<btGImpactMeshShape> shape_;
  btCollisionObject object_;
};

// Which pairs of triangles gave a contact point.
class Pairs : public btManifoldResult {
 public:
  using btManifoldResult::btManifoldResult;
  void setShapeIdentifiersA(int /*part*/, int index) override { a_ = index; }
  void setShapeIdentifiersB(int /*part*/, int index) override { b_ = index; }
  void addContactPoint(const btVector3& /*normal*/, const btVector3& /*point*/,
                       btScalar /*depth*/) override {
    found.insert({a_, b_});
  }
  std::set<std::pair<int, int>> found;

 private:
  int a_ = -1, b_ = -1;
};

class Bullet : public Contender {
 public:
  Bullet(const IndexedMesh& a, const IndexedMesh& b) : dispatcher_(&configuration_), a_(a), b_(b) {
    btGImpactCollisionAlgorithm::registerAlgorithm(&dispatcher_);
  }

  void place(const Pose& a, const Pose& b) override {
    a_.object().setWorldTransform(transform(a));
    b_.object().setWorldTransform(transform(b));
  }
  bool touches() override { return collide() > 0; }
  std::optional<std::uint64_t> count_pairs() override { return collide(); }
  bool refit_b(const std::vector<std::array<double, 3>>& positions_m) override {
    b_.refit(positions_m);
    return true;
  }

 private:
  std::uint64_t collide() {
    btCollisionObject &a = a_.object(), &b = b_.object();
    const btCollisionObjectWrapper wrap_a(nullptr, a.getCollisionShape(), &a, a.getWorldTransform(),
                                          -1, -1);
    const btCollisionObjectWrapper wrap_b(nullptr, b.getCollisionShape(), &b, b.getWorldTransform(),
                                          -1, -1);
    btCollisionAlgorithm* algorithm =
        dispatcher_.findAlgorithm(&wrap_a, &wrap_b, nullptr, BT_CONTACT_POINT_ALGORITHMS);
    Pairs pairs(&wrap_a, &wrap_b);
    algorithm->processCollision(&wrap_a, &wrap_b, dispatch_info_, &pairs);
    algorithm->~btCollisionAlgorithm();
    dispatcher_.freeCollisionAlgorithm(algorithm);
    return pairs.found.size();
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_;
  btDispatcherInfo dispatch_info_;
  Shape a_, b_;
};

}  // namespace

std::unique_ptr<Contender> make_bullet(const IndexedMesh& a, const IndexedMesh& b) {
  return std::make_unique<Bullet>(a, b);
}

}  // namespace nearmesh::perf
