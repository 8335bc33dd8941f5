// SPDX-License-Identifier: Apache-2.0
// FCL: two BVHModels, collide() with the request for one contact or for all. OBB and OBBRSS only: with AABB and RSS it
// copies the whole mesh in every call.
#include <fcl/fcl.h>

#include "contender.hpp"

namespace nearmesh::perf {
namespace {

fcl::Transform3d transform(const Pose& pose) {
  fcl::Transform3d out = fcl::Transform3d::Identity();
  out.linear() =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pose.rotation.data());
  out.translation() = Eigen::Map<const Eigen::Vector3d>(pose.translation_m.data());
  return out;
}

template <class Box>
class Fcl : public Contender {
 public:
  Fcl(const IndexedMesh& a, const IndexedMesh& b) : a_(build(a)), b_(build(b)) {}

  void place(const Pose& a, const Pose& b) override {
    pose_a_ = transform(a);
    pose_b_ = transform(b);
  }
  bool touches() override { return collide(1) > 0; }
  std::optional<std::uint64_t> count_pairs() override { return collide(1'000'000'000); }
  bool refit_b(const std::vector<std::array<double, 3>>& positions_m) override {
    b_->beginReplaceModel();
    for (const auto& p : positions_m) b_->replaceVertex({p[0], p[1], p[2]});
    b_->endReplaceModel(true, true);
    return true;
  }

 private:
  using Model = fcl::BVHModel<Box>;

  static std::shared_ptr<Model> build(const IndexedMesh& mesh) {
    std::vector<fcl::Vector3d> points;
    std::vector<fcl::Triangle> triangles;
    for (const auto& p : mesh.positions_m) points.emplace_back(p[0], p[1], p[2]);
    for (const auto& f : mesh.faces) triangles.emplace_back(f[0], f[1], f[2]);
    auto model = std::make_shared<Model>();
    model->beginModel();
    model->addSubModel(points, triangles);
    model->endModel();
    return model;
  }

  std::size_t collide(std::size_t limit) {
    fcl::CollisionRequestd request;
    request.num_max_contacts = limit;
    request.enable_contact = false;
    fcl::CollisionResultd result;
    fcl::collide(a_.get(), pose_a_, b_.get(), pose_b_, request, result);
    return result.numContacts();
  }

  std::shared_ptr<Model> a_, b_;
  fcl::Transform3d pose_a_, pose_b_;
};

}  // namespace

std::unique_ptr<Contender> make_fcl_obb(const IndexedMesh& a, const IndexedMesh& b) {
  return std::make_unique<Fcl<fcl::OBBd>>(a, b);
}
std::unique_ptr<Contender> make_fcl_obbrss(const IndexedMesh& a, const IndexedMesh& b) {
  return std::make_unique<Fcl<fcl::OBBRSSd>>(a, b);
}

}  // namespace nearmesh::perf
