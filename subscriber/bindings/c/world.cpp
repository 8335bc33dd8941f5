// SPDX-License-Identifier: Apache-2.0
// Probes of a world of tiles on disk.
#include <algorithm>
#include <atomic>
#include <string>
#include <utility>

#include "probes.hpp"

struct nearmesh_world {
  static constexpr nearmesh::c::Kind kKind = nearmesh::c::Kind::kWorld;
  nearmesh::c::Kind kind = kKind;
  std::atomic<bool> in_use = false;
  nearmesh::WorldProbe probe;
};

namespace nearmesh::c {
namespace {

bool has_face(const WorldRayAnswer& answer) { return answer.ray.has_face; }
bool has_face(const WorldShapeAnswer& answer) { return answer.shape.has_face; }

template <class Probe, class Answer, class From, class To>
nearmesh_status of_world(nearmesh_world* world, const nearmesh_pose* pose, const From* given,
                         std::size_t count, const char* name, To* answers,
                         nearmesh_world_tile* tiles, nearmesh_error* error) noexcept {
  return guarded(world, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(check_given(pose, "pose"));
    return asked<Probe, Answer>(
        given, count, name, answers, [&](auto probes, auto found) -> Status {
          NEARMESH_RETURN_IF_ERROR(world->probe.probe(from_c(*pose), probes, found));
          if (tiles == nullptr) return Status::ok();
          for (std::size_t i = 0; i < count; ++i) {
            tiles[i] = {};
            if (has_face(found[i])) tiles[i] = to_c(found[i].tile);
          }
          return Status::ok();
        });
  });
}

}  // namespace
}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C

nearmesh_status nearmesh_world_open(const char* folder, size_t most_tiles, nearmesh_world** world,
                                    nearmesh_error* error) noexcept {
  if (world != nullptr) *world = nullptr;
  return c::guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(world, "world"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(folder, "folder"));
    constexpr std::size_t kMostTiles = 64;
    Result<WorldProbe> opened = WorldProbe::open(folder, most_tiles == 0 ? kMostTiles : most_tiles);
    NEARMESH_RETURN_IF_ERROR(opened);
    *world = new nearmesh_world{.probe = std::move(opened).value()};
    return Status::ok();
  });
}

void nearmesh_world_close(nearmesh_world* world) noexcept {
  if (!c::is_handle(world)) return;
  world->kind = c::Kind::kNone;
  delete world;
}

nearmesh_status nearmesh_world_probe_rays(nearmesh_world* world, const nearmesh_pose* pose,
                                          const nearmesh_ray* rays, size_t count,
                                          nearmesh_ray_answer* answers, nearmesh_world_tile* tiles,
                                          nearmesh_error* error) noexcept {
  return c::of_world<RayProbe, WorldRayAnswer>(world, pose, rays, count, "rays", answers, tiles,
                                               error);
}
nearmesh_status nearmesh_world_probe_balls(nearmesh_world* world, const nearmesh_pose* pose,
                                           const nearmesh_ball* balls, size_t count,
                                           nearmesh_shape_answer* answers,
                                           nearmesh_world_tile* tiles,
                                           nearmesh_error* error) noexcept {
  return c::of_world<BallProbe, WorldShapeAnswer>(world, pose, balls, count, "balls", answers,
                                                  tiles, error);
}
nearmesh_status nearmesh_world_probe_boxes(nearmesh_world* world, const nearmesh_pose* pose,
                                           const nearmesh_box* boxes, size_t count,
                                           nearmesh_shape_answer* answers,
                                           nearmesh_world_tile* tiles,
                                           nearmesh_error* error) noexcept {
  return c::of_world<BoxProbe, WorldShapeAnswer>(world, pose, boxes, count, "boxes", answers, tiles,
                                                 error);
}
