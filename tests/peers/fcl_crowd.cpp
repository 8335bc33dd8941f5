// SPDX-License-Identifier: Apache-2.0
#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/geometry/shape/box.h>

#include "box_crowd.hpp"

namespace nearmesh::peers {
namespace {

using Object = fcl::CollisionObject<double>;

void place(Object& object, const WorldBox& box) {
  object.setTranslation({(box.lo_m[0] + box.hi_m[0]) / 2, (box.lo_m[1] + box.hi_m[1]) / 2,
                         (box.lo_m[2] + box.hi_m[2]) / 2});
  object.computeAABB();
}

std::vector<std::unique_ptr<Object>> make(const std::vector<WorldBox>& boxes) {
  std::vector<std::unique_ptr<Object>> objects;
  for (const WorldBox& box : boxes) {
    objects.push_back(std::make_unique<Object>(std::make_shared<fcl::Box<double>>(
        box.hi_m[0] - box.lo_m[0], box.hi_m[1] - box.lo_m[1], box.hi_m[2] - box.lo_m[2])));
    place(*objects.back(), box);
  }
  return objects;
}

class FclCrowd : public BoxCrowd {
 public:
  FclCrowd(const std::vector<WorldBox>& scenery, const std::vector<WorldBox>& movers)
      : scenery_(make(scenery)), movers_(make(movers)) {
    for (const auto& object : scenery_) still_.registerObject(object.get());
    still_.setup();
    for (const auto& object : movers_) moving_.registerObject(object.get());
    moving_.setup();
  }

  std::size_t count_near(const std::vector<WorldBox>& movers) override {
    for (std::size_t i = 0; i < movers.size(); ++i) place(*movers_[i], movers[i]);
    moving_.update();
    std::size_t near = 0;
    const auto count = [](Object*, Object*, void* counted) {
      ++*static_cast<std::size_t*>(counted);
      return false;
    };
    moving_.collide(&near, count);
    if (!scenery_.empty()) moving_.collide(&still_, &near, count);
    return near;
  }

 private:
  std::vector<std::unique_ptr<Object>> scenery_, movers_;
  fcl::DynamicAABBTreeCollisionManager<double> moving_, still_;
};

}  // namespace

std::unique_ptr<BoxCrowd> make_fcl_crowd(const std::vector<WorldBox>& scenery,
                                         const std::vector<WorldBox>& movers) {
  return std::make_unique<FclCrowd>(scenery, movers);
}

}  // namespace nearmesh::peers
