// SPDX-License-Identifier: Apache-2.0
// Memory that runs out, at any place: each call gives a status, what was half-way done is not asked again, no answer is wrong.
// Arguments: a folder to write to, a world. The library's allocations end in the malloc() of this file.
#define _GNU_SOURCE
#include "check.h"

#include <errno.h>
#include <stdatomic.h>

extern void* __libc_malloc(size_t size);

static atomic_long left = -1;  // until one fails; none where it is below 0
static atomic_int is_lasting;  // and all that follow
static atomic_int has_failed;

void* malloc(size_t size) {
  if (atomic_load(&left) >= 0) {
    const long before = atomic_fetch_sub(&left, 1);
    if (before == 0) {
      atomic_store(&has_failed, 1);
      if (atomic_load(&is_lasting)) atomic_store(&left, 0);
      errno = ENOMEM;
      return NULL;
    }
  }
  return __libc_malloc(size);
}

static nearmesh_error error;

static void arm(long allocations, int lasting) {
  atomic_store(&has_failed, 0);
  atomic_store(&is_lasting, lasting);
  atomic_store(&left, allocations);
}
static int disarm(void) {
  atomic_store(&left, -1);
  return atomic_load(&has_failed);
}

static Sphere sphere;
static char file[1024], other_file[1024], cache_folder[1024], cache_file[1200];
static const char* world_folder;

static nearmesh_status bake_it(void) {
  nearmesh_bake_options options;
  nearmesh_bake_options_init(&options, sizeof options);
  options.threads = 1;
  return nearmesh_bake(sphere.positions_m, kSphereVertices, sphere.faces, kSphereFaces, other_file,
                       &options, &error);
}

static nearmesh_status ask_it(void) {
  nearmesh_model* model = NULL;
  nearmesh_status status = nearmesh_model_open(file, &model, &error);
  if (status != NEARMESH_OK) return status;
  nearmesh_query* query = NULL;
  status = nearmesh_query_create(model, model, NULL, &query, &error);
  const nearmesh_pose here = NEARMESH_POSE_IDENTITY, there = at(1.98, 0, 0);
  const nearmesh_answer* answer = NULL;
  if (status == NEARMESH_OK) status = nearmesh_query_ask(query, &here, &there, &answer, &error);
  if (status == NEARMESH_OK)
    CHECK(answer->status == NEARMESH_CONTACT);
  else if (query != NULL) {
    CHECK(answer == NULL);
    disarm();
    nearmesh_error again;
    const nearmesh_status later = nearmesh_query_ask(query, &here, &there, &answer, &again);
    // Either nothing had begun, or it is not to be asked again.
    CHECK(later == NEARMESH_CONFLICT ||
          (later == NEARMESH_OK && answer->status == NEARMESH_CONTACT));
  }
  nearmesh_query_destroy(query);
  nearmesh_model_close(model);
  return status;
}

static nearmesh_status probe_world(void) {
  nearmesh_world* world = NULL;
  nearmesh_status status = nearmesh_world_open(world_folder, 2, &world, &error);
  if (status != NEARMESH_OK) {
    CHECK(world == NULL);
    return status;
  }
  const nearmesh_pose pose = NEARMESH_POSE_IDENTITY;
  nearmesh_ray rays[8];
  nearmesh_ray_answer answers[8];
  nearmesh_world_tile tiles[8];
  for (int i = 0; i < 8; ++i)
    rays[i] = (nearmesh_ray){{80 * i - 280, 70 * i - 240, 5000}, {0, 0, -1}, INFINITY};
  status = nearmesh_world_probe_rays(world, &pose, rays, 8, answers, tiles, &error);
  int has_answers = status == NEARMESH_OK;
  if (!has_answers) {
    disarm();
    nearmesh_error again;
    const nearmesh_status later =
        nearmesh_world_probe_rays(world, &pose, rays, 8, answers, tiles, &again);
    CHECK(later == NEARMESH_OK);
    has_answers = later == NEARMESH_OK;
  }
  for (int i = 0; i < 8 && has_answers; ++i) CHECK(answers[i].status == NEARMESH_HIT);
  nearmesh_world_close(world);
  return status;
}

static nearmesh_status fly_on(nearmesh_session* session) {
  nearmesh_body bodies[2];
  nearmesh_motion motions[2] = {NEARMESH_MOTION_IDENTITY, NEARMESH_MOTION_IDENTITY};
  nearmesh_status status = nearmesh_session_add_model(session, "sphere", file, &error);
  for (int i = 0; i < 2 && status == NEARMESH_OK; ++i) {
    nearmesh_body_options options;
    nearmesh_body_options_init(&options, sizeof options);
    options.name = i == 0 ? "left" : "right";
    options.model = "sphere";
    options.own = 1;
    status = nearmesh_session_add_body(session, &options, &bodies[i], &error);
  }
  if (status == NEARMESH_OK) status = nearmesh_session_watch(session, 0, 1, &error);
  for (int i = 0; i < 8 && status == NEARMESH_OK; ++i) {
    const nearmesh_frame* frame = NULL;
    motions[1].pose = at(i < 4 ? 2.3 : 1.98, 0, 0);
    status = nearmesh_session_update(session, (uint64_t)i, i * 0.1, bodies, motions, 2, 1, &frame,
                                     &error);
    if (status != NEARMESH_OK) break;
    const nearmesh_answer* answer = nearmesh_session_answer(session, 0)->answer;
    if (answer->is_certified)
      CHECK(answer->status == (i < 4 ? NEARMESH_FREE : NEARMESH_CONTACT));
    else  // a batch for which there was no memory is asked for again, later than it would have come
      CHECK((i != 3 && i != 7) || atomic_load(&has_failed));
  }
  return status;
}

static nearmesh_status fly(const char* cache) {
  nearmesh_session_options options;
  nearmesh_session_options_init(&options, sizeof options);
  options.cache_folder = cache;
  options.contacts = 1;
  options.sweep_s = 0.1;
  nearmesh_session* session = NULL;
  nearmesh_status status = nearmesh_session_create_local(&options, &session, &error);
  if (status != NEARMESH_OK) return status;
  status = fly_on(session);
  if (status != NEARMESH_OK) {
    disarm();
    nearmesh_error again;
    const nearmesh_status later =
        nearmesh_session_update(session, 9, 1, NULL, NULL, 0, 1, NULL, &again);
    // An update that ended half-way is the last one; a file that could not be opened is nothing to the session.
    CHECK(later == (status == NEARMESH_OUT_OF_MEMORY ? NEARMESH_CONFLICT : NEARMESH_OK));
    if (later == NEARMESH_CONFLICT) {
      CHECK(nearmesh_session_answer(session, 0) == NULL);
      // Nor is what it holds shown, whose parts may have parted.
      const nearmesh_held_mesh* mesh = NULL;
      const nearmesh_session_stats* stats = NULL;
      const char* name = NULL;
      CHECK(nearmesh_session_held_mesh(session, 0, &mesh, &again) == NEARMESH_CONFLICT);
      CHECK(nearmesh_session_get_stats(session, &stats, &again) == NEARMESH_CONFLICT);
      CHECK(nearmesh_session_name_of(session, 0, &name, &again) == NEARMESH_CONFLICT);
      CHECK(nearmesh_session_held_state(session, 0) == 0);
    }
  }
  nearmesh_session_destroy(session);
  return status;
}

static nearmesh_status fly_it(void) { return fly(NULL); }

// To the end, where the cache is written while memory is still short.
static nearmesh_status fly_with_cache(void) {
  remove(cache_file);  // as new, or there is nothing to be written
  return fly(cache_folder);
}

// Lets one allocation fail after the other, with steps that grow, until all succeed.
static void starve(const char* name, nearmesh_status (*run)(void)) {
  for (int lasting = 0; lasting < 2; ++lasting) {
    long tries = 0, at_most = 0;
    for (long allocations = 0;; allocations += 1 + allocations / 48) {
      arm(allocations, lasting);
      const nearmesh_status status = run();
      const int failed = disarm();
      ++tries;
      at_most = allocations;
      if (!failed) {
        CHECK(status == NEARMESH_OK);
        break;
      }
      // What is only sought for speed may do without; a file that finds no address space or memory says so itself.
      if (status != NEARMESH_OUT_OF_MEMORY && status != NEARMESH_OK &&
          strstr(error.message, "no address space") == NULL &&
          strstr(error.message, "no memory for") == NULL &&
          strstr(error.message, strerror(ENOMEM)) == NULL) {
        ++failures;
        printf("%s, allocation %ld: %s: %s\n", name, allocations, nearmesh_status_name(status),
               error.message);
        if (failures > 20) exit(1);
      }
    }
    printf("%s: %ld runs, %ld allocations at most\n", name, tries, at_most);
  }
}

int main(int argc, char** argv) {
  if (argc != 3) return fprintf(stderr, "usage: %s FOLDER WORLD\n", argv[0]), 2;
  atomic_store(&left, -1);
  snprintf(file, sizeof file, "%s/memory.spm", argv[1]);
  snprintf(other_file, sizeof other_file, "%s/starved.spm", argv[1]);
  world_folder = argv[2];
  make_sphere(&sphere);
  MUST(nearmesh_bake(sphere.positions_m, kSphereVertices, sphere.faces, kSphereFaces, file, NULL,
                     &error));
  starve("query", ask_it);
  starve("world", probe_world);
  starve("session", fly_it);
  nearmesh_model* model = NULL;
  MUST(nearmesh_model_open(file, &model, &error));
  snprintf(cache_folder, sizeof cache_folder, "%s/cache", argv[1]);
  snprintf(cache_file, sizeof cache_file, "%s/%s.detail", cache_folder,
           nearmesh_model_get_facts(model)->content);
  nearmesh_model_close(model);
  starve("session with a cache", fly_with_cache);
  starve("bake", bake_it);
  return failures == 0 ? 0 : 1;
}
