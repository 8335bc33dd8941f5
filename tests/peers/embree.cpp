// SPDX-License-Identifier: Apache-2.0
// Embree's rtcCollide over user geometry. It knows no transforms, so body b is placed into a's
// frame and its tree is refitted for each pose, which counts as query time; it has no early out
// either. Pairs of boxes come by a callback; the triangle test in it is ours, since the library has
// none.
#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>

#include "core/geometry/triangle_overlap.hpp"
#include "peers.hpp"

namespace nearmesh::peers {
namespace {

struct Body {
  IndexedMesh mesh;                             // in its own frame
  std::vector<std::array<double, 3>> placed_m;  // in a's frame
  std::vector<LatticePoint> lattice;            // the same, rounded to 2^-30 of the size
  RTCScene scene = nullptr;
  RTCGeometry geometry = nullptr;
};

void bounds(const RTCBoundsFunctionArguments* args) {
  const Body& body = *static_cast<const Body*>(args->geometryUserPtr);
  const auto& face = body.mesh.faces[args->primID];
  float lo[3], hi[3];
  for (std::size_t k = 0; k < 3; ++k) {
    const auto [least, most] = std::minmax(
        {body.placed_m[face[0]][k], body.placed_m[face[1]][k], body.placed_m[face[2]][k]});
    lo[k] = std::nextafter(static_cast<float>(least), -HUGE_VALF);
    hi[k] = std::nextafter(static_cast<float>(most), HUGE_VALF);
  }
  *args->bounds_o = {lo[0], lo[1], lo[2], 0, hi[0], hi[1], hi[2], 0};
}

class Embree : public Peer {
 public:
  Embree(const IndexedMesh& a, const IndexedMesh& b) : device_(rtcNewDevice("threads=1")) {
    double size = 0;
    for (const IndexedMesh* mesh : {&a, &b})
      for (const auto& p : mesh->positions_m)
        for (const double x : p) size = std::max(size, std::abs(x));
    cells_per_m_ = 0x1p30 / size;
    for (auto [body, mesh] : {std::pair(&a_, &a), std::pair(&b_, &b)}) {
      body->mesh = *mesh;
      body->scene = rtcNewScene(device_);
      rtcSetSceneFlags(body->scene, RTC_SCENE_FLAG_DYNAMIC);
      body->geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_USER);
      rtcSetGeometryUserPrimitiveCount(body->geometry, static_cast<unsigned>(mesh->faces.size()));
      rtcSetGeometryUserData(body->geometry, body);
      rtcSetGeometryBoundsFunction(body->geometry, bounds, nullptr);
      put(*body, mesh->positions_m);
      rtcCommitGeometry(body->geometry);
      rtcAttachGeometry(body->scene, body->geometry);
      rtcCommitScene(body->scene);
    }
  }
  ~Embree() override {
    for (Body* body : {&a_, &b_}) {
      rtcReleaseGeometry(body->geometry);
      rtcReleaseScene(body->scene);
    }
    rtcReleaseDevice(device_);
  }
  Embree(const Embree&) = delete;
  Embree& operator=(const Embree&) = delete;

  void place(const Pose& a, const Pose& b) override {
    pose_a_ = a;
    pose_b_ = b;
  }
  bool touches() override { return collide() > 0; }
  std::optional<std::uint64_t> count_pairs() override { return collide(); }
  bool refit_b(const std::vector<std::array<double, 3>>& positions_m) override {
    update(positions_m);
    return true;
  }

 private:
  void put(Body& body, std::vector<std::array<double, 3>> placed_m) const {
    body.placed_m = std::move(placed_m);
    body.lattice.resize(body.placed_m.size());
    for (std::size_t i = 0; i < body.placed_m.size(); ++i)
      for (int k = 0; k < 3; ++k)
        body.lattice[i][k] = static_cast<std::int64_t>(
            std::floor(body.placed_m[i][static_cast<std::size_t>(k)] * cells_per_m_ + 0.5));
  }
  void update(const std::vector<std::array<double, 3>>& placed_m) {
    put(b_, placed_m);
    rtcUpdateGeometryBuffer(b_.geometry, RTC_BUFFER_TYPE_VERTEX, 0);
    rtcCommitGeometry(b_.geometry);
    rtcCommitScene(b_.scene);
  }
  std::uint64_t collide() {
    const auto &ra = pose_a_.rotation, &rb = pose_b_.rotation;
    std::vector<std::array<double, 3>> placed(b_.mesh.positions_m.size());
    for (std::size_t i = 0; i < placed.size(); ++i) {
      const auto& p = b_.mesh.positions_m[i];
      std::array<double, 3> world;
      for (std::size_t k = 0; k < 3; ++k)
        world[k] = rb[3 * k] * p[0] + rb[3 * k + 1] * p[1] + rb[3 * k + 2] * p[2] +
                   pose_b_.translation_m[k] - pose_a_.translation_m[k];
      for (std::size_t k = 0; k < 3; ++k)
        placed[i][k] = ra[k] * world[0] + ra[3 + k] * world[1] + ra[6 + k] * world[2];
    }
    update(placed);
    found_ = 0;
    rtcCollide(
        a_.scene, b_.scene,
        [](void* user, RTCCollision* pairs, unsigned count) {
          static_cast<Embree*>(user)->test(pairs, count);
        },
        this);
    return found_;
  }
  void test(const RTCCollision* pairs, unsigned count) {
    for (unsigned i = 0; i < count; ++i) {
      const auto &fa = a_.mesh.faces[pairs[i].primID0], &fb = b_.mesh.faces[pairs[i].primID1];
      if (triangles_overlap({a_.lattice[fa[0]], a_.lattice[fa[1]], a_.lattice[fa[2]]},
                            {b_.lattice[fb[0]], b_.lattice[fb[1]], b_.lattice[fb[2]]}))
        ++found_;
    }
  }

  RTCDevice device_;
  Body a_, b_;
  Pose pose_a_, pose_b_;
  double cells_per_m_ = 1;
  std::uint64_t found_ = 0;
};

}  // namespace

PeerInfo embree() {
  return {.name = "embree-collide",
          .library = "Embree",
          .version = RTC_VERSION_STRING,
          .counts_exactly = true,
          .make = [](const IndexedMesh& a, const IndexedMesh& b) -> std::unique_ptr<Peer> {
            return std::make_unique<Embree>(a, b);
          }};
}

}  // namespace nearmesh::peers
