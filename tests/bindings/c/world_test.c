// SPDX-License-Identifier: Apache-2.0
// Probes of a world through the C interface, held against those of the one model that was cut.
// Arguments: the world's folder, the model.
#include "check.h"

static nearmesh_error error;

enum { kSide = 20, kRays = kSide * kSide };

// A ball over the same ground twice: of tiles, and of one mesh.
static void fly(const char* folder, const char* model) {
  static Sphere ball;
  static char ball_file[1000];
  make_sphere(&ball);
  for (int i = 0; i < kSphereVertices; ++i)
    for (int k = 0; k < 3; ++k) ball.positions_m[3 * i + k] *= 300;
  snprintf(ball_file, sizeof ball_file, "%s/ball.spm", folder);
  MUST(nearmesh_bake(ball.positions_m, kSphereVertices, ball.faces, kSphereFaces, ball_file, NULL,
                     &error));
  nearmesh_session* session = NULL;
  MUST(nearmesh_session_create_local(NULL, &session, &error));
  REFUSED(nearmesh_session_add_world(session, "ground", model, &error), NEARMESH_IO, "world.nmw");
  REFUSED(nearmesh_session_add_world(session, NULL, folder, &error), NEARMESH_INVALID_ARGUMENT,
          "name");
  REFUSED(nearmesh_session_add_world(session, "ground", NULL, &error), NEARMESH_INVALID_ARGUMENT,
          "folder");
  MUST(nearmesh_session_add_world(session, "ground", folder, &error));
  REFUSED(nearmesh_session_add_world(session, "ground", folder, &error), NEARMESH_CONFLICT,
          "taken");
  MUST(nearmesh_session_add_model(session, "one", model, &error));
  MUST(nearmesh_session_add_model(session, "ball", ball_file, &error));
  const char* names[3] = {"ground", "one", "ball"};
  nearmesh_body bodies[3];
  for (int i = 0; i < 3; ++i) {
    nearmesh_body_options options;
    MUST(nearmesh_body_options_init(&options, sizeof options));
    options.name = options.model = names[i];
    options.own = i == 2;
    MUST(nearmesh_session_add_body(session, &options, &bodies[i], &error));
    if (i == 2) continue;
    const nearmesh_pose place = NEARMESH_POSE_IDENTITY;
    MUST(nearmesh_session_place_body(session, bodies[i], &place, &error));
  }
  for (int i = 0; i < 2; ++i) MUST(nearmesh_session_watch(session, bodies[i], bodies[2], &error));
  int touching = 0;
  for (int step = 0; step < 5; ++step) {
    nearmesh_motion motion = {.pose = NEARMESH_POSE_IDENTITY};
    motion.pose.translation_m[0] = 90 * (step - 2);
    motion.pose.translation_m[2] = step == 4 ? 5000 : 40;
    const nearmesh_frame* frame = NULL;
    for (int i = 0; i < 200 && (i == 0 || !frame->all_certified); ++i)
      MUST(nearmesh_session_update(session, (uint64_t)step, step, &bodies[2], &motion, 1, 1, &frame,
                                   &error));
    CHECK(frame->all_certified);
    const nearmesh_pair_answer* of_tiles = nearmesh_session_find(session, bodies[0], bodies[2]);
    const nearmesh_pair_answer* of_one = nearmesh_session_find(session, bodies[1], bodies[2]);
    CHECK(of_one->world == NULL);
    CHECK(of_tiles->world != NULL);
    if (of_tiles->world == NULL) break;
    CHECK(strcmp(of_tiles->world->content, of_tiles->content_a) == 0);
    CHECK(of_tiles->world->missing_page_count == 0);
    CHECK(of_tiles->answer->status == of_one->answer->status);
    uint64_t pairs = 0;
    for (size_t i = 0; i < of_tiles->world->tile_count; ++i) {
      const nearmesh_near_tile* tile = nearmesh_world_answer_tile(of_tiles->world, i);
      CHECK(tile->is_here && tile->asked && tile->missing == 0);
      CHECK(strlen(tile->tile.content) == 32);
      pairs += tile->pairs;
    }
    CHECK(pairs == of_tiles->answer->pair_count);
    CHECK(nearmesh_world_answer_tile(of_tiles->world, of_tiles->world->tile_count) == NULL);
    CHECK((step == 4) == (of_tiles->world->tile_count == 0));
    touching += pairs > 0;
  }
  CHECK(touching > 1);
  CHECK(nearmesh_world_answer_tile(NULL, 0) == NULL);
  nearmesh_session_destroy(session);
}

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
  fly(argv[1], argv[2]);
  nearmesh_world_close(NULL);
  nearmesh_world_close(world);
  nearmesh_model_close(model);
  return failures == 0 ? 0 : 1;
}
