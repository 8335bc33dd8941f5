// SPDX-License-Identifier: Apache-2.0
// FCL: two BVHModels, collide() with the request for one contact or for all. OBB and OBBRSS only:
// with AABB and RSS it copies the whole mesh in every call.
#include <fcl/fcl.h>

#include <set>
#include <stdexcept>
#include <type_traits>

#include "peers.hpp"

namespace nearmesh::peers {
namespace {

constexpr std::size_t kAllContacts = 1'000'000'000;

fcl::Transform3d transform(const Pose& pose) {
  fcl::Transform3d out = fcl::Transform3d::Identity();
  out.linear() =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pose.rotation.data());
  out.translation() = Eigen::Map<const Eigen::Vector3d>(pose.translation_m.data());
  return out;
}

template <class Box>
class Fcl : public Peer {
 public:
  Fcl(const IndexedMesh& a, const IndexedMesh& b) : a_(build(a)), b_(build(b)) {}

  void place(const Pose& a, const Pose& b) override {
    pose_a_ = transform(a);
    pose_b_ = transform(b);
  }
  bool touches() override { return collide(1, false).isCollision(); }
  std::optional<std::uint64_t> count_pairs() override {
    return collide(kAllContacts, false).numContacts();
  }
  bool refit_b(const std::vector<std::array<double, 3>>& positions_m) override {
    b_->beginReplaceModel();
    for (const auto& p : positions_m) b_->replaceVertex({p[0], p[1], p[2]});
    b_->endReplaceModel(true, true);
    return true;
  }

  std::optional<std::uint64_t> count_distinct_pairs(std::size_t limit) override {
    const fcl::CollisionResultd result = collide(limit, false);
    std::set<std::pair<std::intptr_t, std::intptr_t>> pairs;
    for (std::size_t i = 0; i < result.numContacts(); ++i)
      pairs.emplace(result.getContact(i).b1, result.getContact(i).b2);
    return pairs.size();
  }
  std::optional<std::vector<ContactPoint>> contacts() override {
    const fcl::CollisionResultd result = collide(kAllContacts, true);
    std::vector<ContactPoint> points;
    for (std::size_t i = 0; i < result.numContacts(); ++i) {
      const auto& contact = result.getContact(i);
      points.push_back({{contact.pos[0], contact.pos[1], contact.pos[2]},
                        {contact.normal[0], contact.normal[1], contact.normal[2]},
                        contact.penetration_depth});
    }
    return points;
  }
  std::optional<double> distance_m() override {
    if (!std::is_same_v<Box, fcl::OBBRSSd>) return std::nullopt;  // it has none of boxes alone
    fcl::DistanceResultd result;
    return fcl::distance(a_.get(), pose_a_, b_.get(), pose_b_, fcl::DistanceRequestd(), result);
  }
  // Of its settings the one that finds most hits.
  std::optional<bool> touches_on_the_way(const Pose& end_b) override {
    fcl::ContinuousCollisionRequestd request;
    request.ccd_solver_type = fcl::CCDC_NAIVE;
    request.ccd_motion_type = fcl::CCDM_LINEAR;
    request.num_max_iterations = 1000;
    fcl::ContinuousCollisionResultd result;
    fcl::continuousCollide(a_.get(), pose_a_, pose_a_, b_.get(), pose_b_, transform(end_b), request,
                           result);
    return result.is_collide;
  }

 private:
  using Model = fcl::BVHModel<Box>;

  static std::shared_ptr<Model> build(const IndexedMesh& mesh) {
    std::vector<fcl::Vector3d> points;
    std::vector<fcl::Triangle> triangles;
    for (const auto& p : mesh.positions_m) points.emplace_back(p[0], p[1], p[2]);
    for (const auto& f : mesh.faces) triangles.emplace_back(f[0], f[1], f[2]);
    auto model = std::make_shared<Model>();
    if (model->beginModel() != fcl::BVH_OK ||
        model->addSubModel(points, triangles) != fcl::BVH_OK || model->endModel() != fcl::BVH_OK)
      throw std::runtime_error("FCL refuses the mesh");
    return model;
  }

  fcl::CollisionResultd collide(std::size_t limit, bool with_places) const {
    const fcl::CollisionRequestd request(limit, with_places);
    fcl::CollisionResultd result;
    fcl::collide(a_.get(), pose_a_, b_.get(), pose_b_, request, result);
    return result;
  }

  std::shared_ptr<Model> a_, b_;
  fcl::Transform3d pose_a_, pose_b_;
};

template <class Box>
PeerInfo info(const std::string& name) {
  return {.name = name,
          .library = "FCL",
          .version = FCL_VERSION,
          .counts_exactly = true,
          .cuts_lists = true,
          .make = [](const IndexedMesh& a, const IndexedMesh& b) -> std::unique_ptr<Peer> {
            return std::make_unique<Fcl<Box>>(a, b);
          }};
}

}  // namespace

PeerInfo fcl_obb() { return info<fcl::OBBd>("fcl-obb"); }
PeerInfo fcl_obbrss() { return info<fcl::OBBRSSd>("fcl-obbrss"); }

}  // namespace nearmesh::peers
