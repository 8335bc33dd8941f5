// SPDX-License-Identifier: Apache-2.0
// Coal, which was hpp-fcl: two BVHModels of OBBRSS, collide() and distance().
#include <coal/BVH/BVH_model.h>
#include <coal/collision.h>
#include <coal/distance.h>

#include <set>
#include <stdexcept>

#include "peers.hpp"

namespace nearmesh::peers {
namespace {

constexpr std::size_t kAllContacts = 1'000'000'000;

coal::Transform3s transform(const Pose& pose) {
  coal::Matrix3s rotation;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      rotation(row, column) = pose.rotation[static_cast<std::size_t>(3 * row + column)];
  return {rotation,
          coal::Vec3s(pose.translation_m[0], pose.translation_m[1], pose.translation_m[2])};
}

class Coal : public Peer {
 public:
  Coal(const IndexedMesh& a, const IndexedMesh& b) : a_(build(a)), b_(build(b)) {}

  void place(const Pose& a, const Pose& b) override {
    pose_a_ = transform(a);
    pose_b_ = transform(b);
  }
  bool touches() override { return collide(1).isCollision(); }
  std::optional<std::uint64_t> count_pairs() override {
    return collide(kAllContacts).numContacts();
  }
  std::optional<std::vector<ContactPoint>> contacts() override {
    const coal::CollisionResult result = collide(kAllContacts);
    std::vector<ContactPoint> points;
    for (std::size_t i = 0; i < result.numContacts(); ++i) {
      const coal::Contact& contact = result.getContact(i);
      points.push_back({{contact.pos[0], contact.pos[1], contact.pos[2]},
                        {contact.normal[0], contact.normal[1], contact.normal[2]},
                        -contact.penetration_depth});  // signed: negative where triangles overlap
    }
    return points;
  }
  std::optional<double> distance_m() override {
    coal::DistanceResult result;
    return coal::distance(a_.get(), pose_a_, b_.get(), pose_b_, coal::DistanceRequest(), result);
  }

 private:
  using Model = coal::BVHModel<coal::OBBRSS>;

  static std::shared_ptr<Model> build(const IndexedMesh& mesh) {
    std::vector<coal::Vec3s> points;
    std::vector<coal::Triangle> triangles;
    for (const auto& p : mesh.positions_m) points.emplace_back(p[0], p[1], p[2]);
    for (const auto& f : mesh.faces) triangles.emplace_back(f[0], f[1], f[2]);
    auto model = std::make_shared<Model>();
    if (model->beginModel() != coal::BVH_OK ||
        model->addSubModel(points, triangles) != coal::BVH_OK || model->endModel() != coal::BVH_OK)
      throw std::runtime_error("Coal refuses the mesh");
    return model;
  }

  coal::CollisionResult collide(std::size_t limit) const {
    const coal::CollisionRequest request(coal::CONTACT, limit);
    coal::CollisionResult result;
    coal::collide(a_.get(), pose_a_, b_.get(), pose_b_, request, result);
    return result;
  }

  std::shared_ptr<Model> a_, b_;
  coal::Transform3s pose_a_, pose_b_;
};

}  // namespace

PeerInfo coal_obbrss() {
  return {.name = "coal-obbrss",
          .library = "Coal",
          .version = COAL_VERSION,
          .counts_exactly = true,
          .make = [](const IndexedMesh& a, const IndexedMesh& b) -> std::unique_ptr<Peer> {
            return std::make_unique<Coal>(a, b);
          }};
}

}  // namespace nearmesh::peers
