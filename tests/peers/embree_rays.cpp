// SPDX-License-Identifier: Apache-2.0
#include "embree_rays.hpp"

#include <embree3/rtcore.h>

#include <cmath>
#include <limits>

namespace nearmesh::peers {

struct EmbreeRays::Impl {
  RTCDevice device = rtcNewDevice("threads=1");
  RTCScene scene = nullptr;
};

EmbreeRays::EmbreeRays(const IndexedMesh& mesh) : impl_(std::make_unique<Impl>()) {
  impl_->scene = rtcNewScene(impl_->device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);  // no ray slips between two faces
  RTCGeometry geometry = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* corners = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                              RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                                              mesh.positions_m.size()));
  for (const auto& p : mesh.positions_m)
    for (const double x : p) *corners++ = static_cast<float>(x);
  auto* faces = static_cast<unsigned*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(unsigned), mesh.faces.size()));
  for (const auto& f : mesh.faces)
    for (const std::uint32_t v : f) *faces++ = v;
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(impl_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(impl_->scene);
}

EmbreeRays::~EmbreeRays() {
  rtcReleaseScene(impl_->scene);
  rtcReleaseDevice(impl_->device);
}

void EmbreeRays::trace(std::span<const RayProbe> rays, std::span<float> distances_m,
                       bool packets) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (!packets) {
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const RayProbe& ray = rays[i];
      RTCRayHit hit{};
      hit.ray.org_x = static_cast<float>(ray.origin_m[0]);
      hit.ray.org_y = static_cast<float>(ray.origin_m[1]);
      hit.ray.org_z = static_cast<float>(ray.origin_m[2]);
      hit.ray.dir_x = static_cast<float>(ray.direction[0]);
      hit.ray.dir_y = static_cast<float>(ray.direction[1]);
      hit.ray.dir_z = static_cast<float>(ray.direction[2]);
      hit.ray.tfar = static_cast<float>(ray.range_m);
      hit.ray.mask = ~0U;
      hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      rtcIntersect1(impl_->scene, &context, &hit);
      distances_m[i] = hit.hit.geomID == RTC_INVALID_GEOMETRY_ID
                           ? std::numeric_limits<float>::infinity()
                           : hit.ray.tfar;
    }
    return;
  }
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  for (std::size_t i = 0; i < rays.size(); i += 8) {
    alignas(32) int valid[8];
    RTCRayHit8 hit{};
    for (std::size_t j = 0; j < 8; ++j) {
      valid[j] = i + j < rays.size() ? -1 : 0;
      const RayProbe& ray = rays[std::min(i + j, rays.size() - 1)];
      hit.ray.org_x[j] = static_cast<float>(ray.origin_m[0]);
      hit.ray.org_y[j] = static_cast<float>(ray.origin_m[1]);
      hit.ray.org_z[j] = static_cast<float>(ray.origin_m[2]);
      hit.ray.dir_x[j] = static_cast<float>(ray.direction[0]);
      hit.ray.dir_y[j] = static_cast<float>(ray.direction[1]);
      hit.ray.dir_z[j] = static_cast<float>(ray.direction[2]);
      hit.ray.tfar[j] = static_cast<float>(ray.range_m);
      hit.ray.mask[j] = ~0U;
      hit.hit.geomID[j] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect8(valid, impl_->scene, &context, &hit);
    for (std::size_t j = 0; j < 8 && i + j < rays.size(); ++j)
      distances_m[i + j] = hit.hit.geomID[j] == RTC_INVALID_GEOMETRY_ID
                               ? std::numeric_limits<float>::infinity()
                               : hit.ray.tfar[j];
  }
}

}  // namespace nearmesh::peers
