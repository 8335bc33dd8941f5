// SPDX-License-Identifier: Apache-2.0
// Probes of a world through the C interface, held against those of the one model that was cut.
// Arguments: the world's folder, the model.
#include "check.h"

static nearmesh_error error;

enum { kSide = 20, kRays = kSide * kSide };

int main(int argc, char** argv) {
  if (argc != 3) return fprintf(stderr, "usage: %s WORLD MODEL\n", argv[0]), 2;
  nearmesh_world* world = NULL;
  REFUSED(nearmesh_world_open("no such folder", 0, &world, &error), NEARMESH_NOT_FOUND,
          "no such folder");
  REFUSED(nearmesh_world_open(NULL, 0, &world, &error), NEARMESH_INVALID_ARGUMENT, "folder");
  MUST(nearmesh_world_open(argv[1], 3, &world, &error));
  nearmesh_model* model = NULL;
  MUST(nearmesh_model_open(argv[2], &model, &error));

  nearmesh_pose pose = NEARMESH_POSE_IDENTITY;
  pose.translation_m[0] = 1000;
  static nearmesh_ray rays[kRays];
  for (int i = 0; i < kRays; ++i)
    rays[i] =
        (nearmesh_ray){{1000 + 43 * (i % kSide - kSide / 2), 43 * (i / kSide - kSide / 2), 5000},
                       {0.01, 0, -1},
                       INFINITY};
  static nearmesh_ray_answer of_world[kRays], of_model[kRays];
  static nearmesh_world_tile tiles[kRays];
  MUST(nearmesh_world_probe_rays(world, &pose, rays, kRays, of_world, tiles, &error));
  MUST(nearmesh_model_probe_rays(model, &pose, rays, kRays, of_model, &error));
  int hits = 0, others = 0;
  for (int i = 0; i < kRays; ++i) {
    CHECK(of_world[i].status == of_model[i].status);
    CHECK(strlen(tiles[i].content) == (of_world[i].has_face ? 32U : 0U));
    if (of_world[i].status != NEARMESH_HIT) continue;
    ++hits;
    others += strcmp(tiles[i].content, tiles[kRays / 2].content) != 0;
    CHECK(fabs(of_world[i].at_most_m - of_model[i].at_most_m) < 0.01);
  }
  CHECK(hits > 100 && hits < kRays && others > 50);

  const double* ground_m = of_world[kRays / 2 + kSide / 2].point_m;
  const nearmesh_ball balls[2] = {{{ground_m[0], ground_m[1], ground_m[2] + 1}, 1.5},
                                  {{ground_m[0], ground_m[1], ground_m[2] + 900}, 1.5}};
  nearmesh_shape_answer shapes[2];
  MUST(nearmesh_world_probe_balls(world, &pose, balls, 2, shapes, tiles, &error));
  CHECK(shapes[0].status == NEARMESH_HIT && shapes[0].has_face && strlen(tiles[0].content) == 32);
  CHECK(shapes[1].status == NEARMESH_MISS && tiles[1].content[0] == 0);
  nearmesh_box boxes[2] = {{NEARMESH_POSE_IDENTITY, {2, 2, 2}},
                           {NEARMESH_POSE_IDENTITY, {2, 2, 2}}};
  for (int i = 0; i < 2; ++i)
    for (int k = 0; k < 3; ++k) boxes[i].pose.translation_m[k] = balls[i].center_m[k];
  MUST(nearmesh_world_probe_boxes(world, &pose, boxes, 2, shapes, NULL, &error));
  CHECK(shapes[0].status == NEARMESH_HIT && shapes[1].status == NEARMESH_MISS);

  rays[1].range_m = -1;
  REFUSED(nearmesh_world_probe_rays(world, &pose, rays, 2, of_world, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "ray 1");
  REFUSED(nearmesh_world_probe_rays(world, NULL, rays, 1, of_world, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "pose");
  REFUSED(nearmesh_world_probe_rays((nearmesh_world*)(void*)model, &pose, rays, 1, of_world, NULL,
                                    &error),
          NEARMESH_INVALID_ARGUMENT, "no world");
  nearmesh_world_close(NULL);
  nearmesh_world_close(world);
  nearmesh_model_close(model);
  return failures == 0 ? 0 : 1;
}
