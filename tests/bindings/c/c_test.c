// SPDX-License-Identifier: Apache-2.0
// The C interface as a C program uses it: two spheres are baked, asked about, flown in a session; and all that is refused.
// Arguments: a folder to write to, a recording.
#include <pthread.h>

#include "check.h"

static nearmesh_error error;

// ---- Models

static void test_models(const char* sphere_file, const char* open_file) {
  static Sphere sphere;
  make_sphere(&sphere);
  MUST(nearmesh_bake(sphere.positions_m, kSphereVertices, sphere.faces, kSphereFaces, sphere_file,
                     NULL, &error));
  CHECK(error.status == NEARMESH_OK && error.message[0] == 0);
  // Without its last face, with options, without anybody who reads the text.
  nearmesh_bake_options options;
  CHECK(nearmesh_bake_options_init(&options, sizeof options) == NEARMESH_OK);
  CHECK(options.base_faces == 16 && options.grid_bits == 21);
  options.base_faces = 64;
  options.threads = 1;
  CHECK(nearmesh_bake(sphere.positions_m, kSphereVertices, sphere.faces, kSphereFaces - 1,
                      open_file, &options, NULL) == NEARMESH_OK);

  nearmesh_model* model = NULL;
  MUST(nearmesh_model_open(sphere_file, &model, &error));
  const nearmesh_model_facts* facts = nearmesh_model_get_facts(model);
  CHECK(facts->vertex_count == kSphereVertices && facts->face_count == kSphereFaces);
  CHECK(facts->component_count == 1 && facts->is_closed && facts->boundary_edges == 0);
  CHECK(strlen(facts->content) == 32 && facts->mesh_bytes > 0 &&
        facts->file_bytes > facts->mesh_bytes);
  CHECK(facts->cell_m > 0 && facts->cell_m < 1e-5 && facts->grid_bits == 21);
  CHECK(facts->rounding_error_m < facts->cell_m);
  MUST(nearmesh_model_check(model, 0, &error));
  MUST(nearmesh_model_check(model, 1, &error));
  uint32_t number = 7;
  nearmesh_face face = {NEARMESH_NONE, 0};
  MUST(nearmesh_model_face_number(model, face, &number, &error));
  CHECK(number < kSphereFaces);
  face.index = 1000;
  REFUSED(nearmesh_model_face_number(model, face, &number, &error), NEARMESH_NOT_FOUND, "no face");
  face.split = kSphereVertices;
  REFUSED(nearmesh_model_face_number(model, face, &number, &error), NEARMESH_NOT_FOUND, "no face");
  face.split = 0;  // a root
  REFUSED(nearmesh_model_face_number(model, face, &number, &error), NEARMESH_NOT_FOUND, "no face");
  nearmesh_model_close(model);

  // What is refused.
  REFUSED(nearmesh_bake(NULL, 3, sphere.faces, 1, sphere_file, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "positions_m");
  REFUSED(nearmesh_bake(sphere.positions_m, 3, NULL, 1, sphere_file, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "faces");
  REFUSED(nearmesh_bake(sphere.positions_m, 3, sphere.faces, 1, NULL, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "path");
  REFUSED(nearmesh_bake(sphere.positions_m, 3, sphere.faces, 0, sphere_file, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "face");
  REFUSED(nearmesh_bake(sphere.positions_m, SIZE_MAX, sphere.faces, 1, sphere_file, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "2^31");
  REFUSED(nearmesh_bake(sphere.positions_m, 3, sphere.faces + 30, 1, sphere_file, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "face 0");
  double broken[9] = {0, 0, 0, 1, 0, 0, 0, 1, NAN};
  const uint32_t triangle[3] = {0, 1, 2};
  REFUSED(nearmesh_bake(broken, 3, triangle, 1, sphere_file, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "vertex 2");
  options.grid_bits = 40;
  REFUSED(nearmesh_bake(sphere.positions_m, 3, triangle, 1, sphere_file, &options, &error),
          NEARMESH_INVALID_ARGUMENT, "grid_bits");
  REFUSED(nearmesh_bake(sphere.positions_m, kSphereVertices, sphere.faces, kSphereFaces,
                        "/no/such/folder/x.spm", NULL, &error),
          NEARMESH_IO, "/no/such/folder");
  model = (nearmesh_model*)&number;
  REFUSED(nearmesh_model_open("/no/such/file.spm", &model, &error), NEARMESH_IO, "file.spm");
  CHECK(model == NULL);
  REFUSED(nearmesh_model_open("/proc/self/exe", &model, &error), NEARMESH_CORRUPT,
          "/proc/self/exe");
  REFUSED(nearmesh_model_open(NULL, &model, &error), NEARMESH_INVALID_ARGUMENT, "path");
  REFUSED(nearmesh_model_open(sphere_file, NULL, &error), NEARMESH_INVALID_ARGUMENT, "model");
  REFUSED(nearmesh_model_check(NULL, 0, &error), NEARMESH_INVALID_ARGUMENT, "model is NULL");
  CHECK(nearmesh_model_get_facts(NULL) == NULL);
  nearmesh_model_close(NULL);
}

// ---- Queries

static void test_queries(const char* sphere_file, const char* open_file) {
  nearmesh_model *model = NULL, *open_model = NULL;
  MUST(nearmesh_model_open(sphere_file, &model, &error));
  MUST(nearmesh_model_open(open_file, &open_model, &error));
  nearmesh_query_options options;
  CHECK(nearmesh_query_options_init(&options, sizeof options) == NEARMESH_OK);
  options.contacts = 1;
  options.depth = 1;
  options.clearance = NEARMESH_CLEARANCE_EXACT;
  nearmesh_query* query = NULL;
  MUST(nearmesh_query_create(model, model, &options, &query, &error));
  const nearmesh_pose here = NEARMESH_POSE_IDENTITY;
  const nearmesh_answer* answer = NULL;

  nearmesh_pose there = at(2.5, 0.1, 0);
  MUST(nearmesh_query_ask(query, &here, &there, &answer, &error));
  CHECK(answer->status == NEARMESH_FREE && answer->is_certified && answer->pair_count == 0);
  CHECK(answer->clearance_m > 0 && answer->clearance_m < 0.53);
  CHECK(answer->contacts == NULL && answer->depth == NULL);
  CHECK(answer->distance_at_most_m >= answer->clearance_m);
  CHECK(answer->distance_at_most_m > 0.5 && answer->distance_at_most_m < 2.5);
  double apart = 0;
  for (int k = 0; k < 3; ++k) {
    const double way = answer->nearest_b_m[k] - answer->nearest_a_m[k];
    apart += way * way;
  }
  CHECK(fabs(sqrt(apart) - answer->distance_at_most_m) < 1e-6);

  there = at(1.99, 0.01, 0.02);
  MUST(nearmesh_query_ask(query, &here, &there, &answer, &error));
  CHECK(answer->status == NEARMESH_CONTACT && answer->pair_count > 0);
  CHECK(answer->pair_total == answer->pair_count && !answer->truncated);
  const nearmesh_contacts* contacts = answer->contacts;
  CHECK(contacts != NULL && contacts->segment_count > 0 && contacts->patch_count == 1);
  const nearmesh_contact_patch* patch = nearmesh_contacts_patch(contacts, 0);
  CHECK(patch->count == contacts->segment_count && patch->normal[0] > 0.9);
  CHECK(fabs(patch->centroid_m[0] - 0.995) < 0.01);
  CHECK(patch->manifold_count == 4 && patch->manifold_error_m > 0);
  CHECK(fabs(patch->manifold_m[3][0] - 0.995) < 0.01);
  CHECK(answer->distance_at_most_m == 0);
  const nearmesh_depth* depth = answer->depth;
  CHECK(depth != NULL && !depth->exhausted && depth->missing_a + depth->missing_b == 0);
  CHECK(depth->at_least_m > 0 && depth->at_most_m >= depth->at_least_m);
  CHECK(depth->at_most_m < depth->at_least_m + 1e-4 && depth->at_most_m < 0.02);
  CHECK(contacts->segments[0].p_m[0] > 0.9 && !contacts->segments[0].approximate);
  CHECK(nearmesh_contacts_patch(contacts, 1) == NULL && nearmesh_contacts_patch(NULL, 0) == NULL);
  nearmesh_pose out = there;
  for (int k = 0; k < 3; ++k) out.translation_m[k] += depth->separation_m[k];
  uint32_t number = 0;
  for (size_t i = 0; i < answer->pair_count; ++i)
    MUST(nearmesh_model_face_number(model, answer->pairs[i].a, &number, &error));
  CHECK(number < kSphereFaces);
  MUST(nearmesh_query_ask(query, &here, &out, &answer, &error));
  CHECK(answer->status == NEARMESH_FREE && answer->depth == NULL);

  // The answer that was given is gone; NULL comes with an error.
  there.translation_m[1] = NAN;
  REFUSED(nearmesh_query_ask(query, &here, &there, &answer, &error), NEARMESH_INVALID_ARGUMENT,
          "pose of B: translation_m[1] is nan");
  CHECK(answer == NULL);
  memset(&there, 0, sizeof there);
  REFUSED(nearmesh_query_ask(query, &here, &there, &answer, &error), NEARMESH_INVALID_ARGUMENT,
          "pose of B");
  REFUSED(nearmesh_query_ask(query, &here, NULL, &answer, &error), NEARMESH_INVALID_ARGUMENT,
          "pose_b is NULL");
  REFUSED(nearmesh_query_ask(query, &here, &here, NULL, &error), NEARMESH_INVALID_ARGUMENT,
          "answer is NULL");
  REFUSED(nearmesh_query_ask(NULL, &here, &here, &answer, &error), NEARMESH_INVALID_ARGUMENT,
          "query is NULL");
  // A handle of another kind, as languages without types pass it.
  REFUSED(nearmesh_query_ask((nearmesh_query*)(void*)model, &here, &here, &answer, &error),
          NEARMESH_INVALID_ARGUMENT, "no query");
  nearmesh_query_destroy((nearmesh_query*)(void*)model);  // nothing happens
  nearmesh_query_destroy(query);

  // Solid, with a list that is cut; the models may be closed first.
  options.solid_a = 1;
  REFUSED(nearmesh_query_create(open_model, model, &options, &query, &error),
          NEARMESH_INVALID_ARGUMENT, "A");
  options.max_pairs = 3;
  MUST(nearmesh_query_create(model, open_model, &options, &query, &error));
  nearmesh_model_close(model);
  nearmesh_model_close(open_model);
  there = at(1.5, 0, 0);
  MUST(nearmesh_query_ask(query, &here, &there, &answer, &error));
  CHECK(answer->status == NEARMESH_CONTACT && answer->truncated && answer->pair_count == 3);
  CHECK(answer->pair_total > 3);
  nearmesh_query_destroy(query);
  nearmesh_query_destroy(NULL);

  options.clearance = 9;
  MUST(nearmesh_model_open(sphere_file, &model, &error));
  REFUSED(nearmesh_query_create(model, model, &options, &query, &error), NEARMESH_INVALID_ARGUMENT,
          "clearance is 9");
  nearmesh_model_close(model);
}

// ---- Structs of other lengths

typedef struct LaterOptions {
  nearmesh_query_options known;
  uint64_t later;
} LaterOptions;

static void test_lengths(const char* sphere_file) {
  nearmesh_model* model = NULL;
  nearmesh_query* query = NULL;
  MUST(nearmesh_model_open(sphere_file, &model, &error));
  // A program that was compiled with a later struct.
  LaterOptions later;
  memset(&later, 0xff, sizeof later);
  CHECK(nearmesh_query_options_init(&later.known, sizeof later) == NEARMESH_OK);
  CHECK(later.later == 0 && later.known.size == sizeof later);
  MUST(nearmesh_query_create(model, model, &later.known, &query, &error));
  nearmesh_query_destroy(query);
  later.later = 1;
  REFUSED(nearmesh_query_create(model, model, &later.known, &query, &error), NEARMESH_UNSUPPORTED,
          "newer");
  // One that was compiled with an earlier one, without max_pairs: that has its default.
  nearmesh_query_options earlier;
  memset(&earlier, 0, sizeof earlier);
  const size_t known = offsetof(nearmesh_query_options, max_pairs);
  CHECK(nearmesh_query_options_init(&earlier, known) == NEARMESH_OK);
  CHECK(earlier.size == known && earlier.max_pairs == 0);
  MUST(nearmesh_query_create(model, model, &earlier, &query, &error));
  const nearmesh_pose here = NEARMESH_POSE_IDENTITY, there = at(1.5, 0, 0);
  const nearmesh_answer* answer = NULL;
  MUST(nearmesh_query_ask(query, &here, &there, &answer, &error));
  CHECK(answer->pair_count > 0 && !answer->truncated);
  nearmesh_query_destroy(query);
  // One that forgot.
  memset(&earlier, 0, sizeof earlier);
  REFUSED(nearmesh_query_create(model, model, &earlier, &query, &error), NEARMESH_INVALID_ARGUMENT,
          "nearmesh_query_options_init()");
  earlier.size = (size_t)-1;
  REFUSED(nearmesh_query_create(model, model, &earlier, &query, &error), NEARMESH_INVALID_ARGUMENT,
          "nearmesh_query_options_init()");
  CHECK(nearmesh_query_options_init(NULL, sizeof earlier) == NEARMESH_INVALID_ARGUMENT);
  CHECK(nearmesh_session_options_init(NULL, 64) == NEARMESH_INVALID_ARGUMENT);
  CHECK(nearmesh_query_options_init(&earlier, 0) == NEARMESH_INVALID_ARGUMENT);
  nearmesh_model_close(model);
}

// ---- Sessions

typedef struct Runner {
  size_t calls, jobs;
  int mood;  // 0: all; 1: leaves out, repeats and invents; 2: on threads
} Runner;

typedef struct Share {
  nearmesh_job job;
  void* jobs;
  size_t begin, end;
} Share;

static void* run_share(void* share_) {
  const Share* share = share_;
  for (size_t i = share->begin; i < share->end; ++i) share->job(share->jobs, i);
  return NULL;
}

static void run_jobs(void* user, size_t count, nearmesh_job job, void* jobs) {
  Runner* runner = user;
  ++runner->calls;
  runner->jobs += count;
  if (runner->mood == 2) {
    Share half[2] = {{job, jobs, 0, count / 2}, {job, jobs, count / 2, count}};
    pthread_t thread;
    if (pthread_create(&thread, NULL, run_share, &half[0]) != 0) abort();
    run_share(&half[1]);
    pthread_join(thread, NULL);
    return;
  }
  for (size_t i = runner->mood; i < count; ++i) job(jobs, i);
  if (runner->mood == 1) {
    job(jobs, 1);
    job(jobs, count);
    job(jobs, (size_t)-1);
  }
}

static nearmesh_session* make_session(const nearmesh_session_options* options,
                                      const char* sphere_file, nearmesh_body* bodies,
                                      size_t count) {
  nearmesh_session* session = NULL;
  MUST(nearmesh_session_create_local(options, &session, &error));
  MUST(nearmesh_session_add_model(session, "sphere", sphere_file, &error));
  for (size_t i = 0; i < count; ++i) {
    char name[16];
    snprintf(name, sizeof name, "body %d", (int)i);
    nearmesh_body_options body;
    CHECK(nearmesh_body_options_init(&body, sizeof body) == NEARMESH_OK);
    body.name = name;
    body.model = "sphere";
    body.own = 1;
    MUST(nearmesh_session_add_body(session, &body, &bodies[i], &error));
    CHECK(bodies[i] == i);
  }
  return session;
}

enum { kRow = 5 };

// Spheres in a row, each into the next. Out: the digest of the certified answers.
static uint64_t fly_row(const char* sphere_file, Runner* runner) {
  nearmesh_session_options options;
  CHECK(nearmesh_session_options_init(&options, sizeof options) == NEARMESH_OK);
  options.depth = 1;  // and so contacts
  options.sweep_s = 0.5;
  options.cache_folder = NULL;
  if (runner != NULL) {
    options.run_jobs = run_jobs;
    options.run_jobs_user = runner;
  }
  nearmesh_body bodies[kRow];
  nearmesh_session* session = make_session(&options, sphere_file, bodies, kRow);
  MUST(nearmesh_session_watch_own(session, &error));
  nearmesh_motion motions[kRow];
  for (int i = 0; i < kRow; ++i) {
    const nearmesh_motion still = NEARMESH_MOTION_IDENTITY;
    motions[i] = still;
    motions[i].pose = at(1.98 * i, 0.01 * i, 0);
  }
  const nearmesh_frame* frame = NULL;
  int updates = 0;
  do {
    MUST(nearmesh_session_update(session, 1, 0.5, bodies, motions, kRow, 0.1, &frame, &error));
  } while (!frame->all_certified && ++updates < 20);
  CHECK(frame->all_certified);
  CHECK(frame->answer_count + frame->free_by_bounds == kRow * (kRow - 1) / 2);
  CHECK(frame->free_by_bounds > 0 && frame->free_horizon_s > 0 && frame->unknown_count == 0);
  size_t contacts = 0;
  for (size_t i = 0; i < frame->answer_count; ++i) {
    const nearmesh_pair_answer* pair = nearmesh_session_answer(session, i);
    CHECK(pair == nearmesh_session_find(session, pair->b, pair->a));
    CHECK(pair->asked && pair->reason[0] == 0 && pair->awaited[0] == 0);
    CHECK(strlen(pair->content_a) == 32 && strcmp(pair->content_a, pair->content_b) == 0);
    CHECK(pair->age_a_s == 0 && pair->pose_a.translation_m[0] == 1.98 * pair->a);
    CHECK(pair->swept != NULL);
    if (pair->answer->status == NEARMESH_CONTACT) {
      ++contacts;
      CHECK(pair->answer->contacts != NULL && pair->answer->contacts->patch_count > 0);
      CHECK(pair->answer->depth != NULL && pair->contact_ids[0] > 0);
      CHECK(pair->swept->status == NEARMESH_CONTACT && pair->swept->hit_s == 0);
    }
  }
  CHECK(contacts == kRow - 1);
  CHECK(frame->contact_event_count >= contacts);
  for (size_t i = 0; i < frame->contact_event_count; ++i) {
    const nearmesh_contact_event* event = nearmesh_session_contact_event(session, i);
    CHECK(event->change == NEARMESH_CONTACT_BEGIN || event->change == NEARMESH_CONTACT_PERSIST);
    const nearmesh_pair_answer* pair = nearmesh_session_find(session, event->a, event->b);
    CHECK(pair->contact_ids[event->patch] == event->id);
  }
  CHECK(nearmesh_session_contact_event(session, frame->contact_event_count) == NULL);
  CHECK(nearmesh_session_contact_event(NULL, 0) == NULL);
  CHECK(nearmesh_session_answer(session, frame->answer_count) == NULL);
  CHECK(nearmesh_session_find(session, 0, kRow - 1) == NULL);
  const uint64_t digest = frame->answers_digest;
  nearmesh_session_destroy(session);
  return digest;
}

static void test_run_jobs(const char* sphere_file) {
  const uint64_t alone = fly_row(sphere_file, NULL);
  for (int mood = 0; mood < 3; ++mood) {
    Runner runner = {0, 0, mood};
    CHECK(fly_row(sphere_file, &runner) == alone);
    CHECK(runner.calls > 0 && runner.jobs >= runner.calls);
  }
}

// Without time one pair of a frame is asked; the others say what is left of their last answers.
static void test_budget(const char* sphere_file) {
  nearmesh_session_options options;
  CHECK(nearmesh_session_options_init(&options, sizeof options) == NEARMESH_OK);
  CHECK(options.any == 0 && options.max_pairs == UINT64_MAX && options.max_tests == 2000000 &&
        options.max_sweep_tests == 50000 && options.max_depth_tests == 500000);
  options.lookahead_s = 0;
  options.max_pairs = 1;
  options.clearance = NEARMESH_CLEARANCE_EXACT;  // else what stays free by its bound takes no turn
  nearmesh_body bodies[3];
  nearmesh_session* session = make_session(&options, sphere_file, bodies, 3);
  for (int i = 0; i < 3; ++i)
    MUST(nearmesh_session_watch(session, bodies[i], bodies[(i + 1) % 3], &error));
  nearmesh_motion motions[3];
  for (int i = 0; i < 3; ++i) {
    const nearmesh_motion still = NEARMESH_MOTION_IDENTITY;
    motions[i] = still;
    motions[i].pose = at(i == 2 ? 5 : 1.98 * i, 0.01 * i, 0);
    motions[i].linear_velocity_mps[0] = 0.5;
  }
  const nearmesh_frame* frame = NULL;
  for (int i = 0; i < 50 && (frame == NULL || !frame->all_certified); ++i)
    MUST(nearmesh_session_update(session, 1, 0.5, bodies, motions, 3, 100, &frame, &error));
  CHECK(frame->all_certified && frame->pairs_put_off == 0);
  for (int i = 0; i < 20; ++i) {
    MUST(nearmesh_session_update(session, 1, 0.5, bodies, motions, 3, 0, &frame, &error));
    CHECK(frame->answer_count == 3 && frame->pairs_put_off == 2 && !frame->all_certified);
  }
  int free_ones = 0, put_off = 0;
  for (size_t i = 0; i < 3; ++i) {
    const nearmesh_pair_answer* pair = nearmesh_session_answer(session, i);
    CHECK(pair->asked != pair->put_off);
    if (pair->asked) {
      CHECK(pair->last_certified == NULL && pair->answer->pair_count <= 1);
      continue;
    }
    ++put_off;
    CHECK(pair->answer->status == NEARMESH_UNCERTAIN && strcmp(pair->reason, "out of budget") == 0);
    const nearmesh_last_certified* last = pair->last_certified;
    CHECK(last != NULL);
    if (last == NULL) continue;
    CHECK(last->age_s == 0);
    if (last->status == NEARMESH_FREE) {
      ++free_ones;
      CHECK(last->clearance_m > 0.5 && last->safe_s > 0.1 && last->safe_s < 10);
    } else {
      CHECK(last->status == NEARMESH_CONTACT && last->pair_total > 1 && last->safe_s == 0);
    }
  }
  CHECK(put_off == 2 && free_ones > 0);
  nearmesh_session_destroy(session);

  nearmesh_model* model = NULL;
  MUST(nearmesh_model_open(sphere_file, &model, &error));
  nearmesh_query_options few;
  CHECK(nearmesh_query_options_init(&few, sizeof few) == NEARMESH_OK &&
        few.max_tests == UINT64_MAX);
  few.max_tests = 20;
  nearmesh_query* query = NULL;
  MUST(nearmesh_query_create(model, model, &few, &query, &error));
  const nearmesh_pose here = at(0, 0, 0), there = at(0.5, 0, 0);
  const nearmesh_answer* answer = NULL;
  MUST(nearmesh_query_ask(query, &here, &there, &answer, &error));
  CHECK(answer->exhausted && !answer->is_certified);
  nearmesh_query_destroy(query);

  // A depth has a bound of its own: the bracket is wider then.
  CHECK(nearmesh_query_options_init(&few, sizeof few) == NEARMESH_OK &&
        few.max_depth_tests == 500000);
  few.depth = 1;
  double wide_m[2];
  for (int i = 0; i < 2; ++i) {
    if (i == 1) few.max_depth_tests = 5000;
    MUST(nearmesh_query_create(model, model, &few, &query, &error));
    MUST(nearmesh_query_ask(query, &here, &there, &answer, &error));
    CHECK(answer->is_certified && answer->depth != NULL);
    CHECK((answer->depth->exhausted != 0) == (i == 1));
    wide_m[i] = answer->depth->at_most_m - answer->depth->at_least_m;
    nearmesh_query_destroy(query);
  }
  CHECK(wide_m[0] >= 0 && wide_m[1] > wide_m[0]);
  nearmesh_model_close(model);
}

static void test_session(const char* sphere_file) {
  nearmesh_body bodies[2];
  nearmesh_session* session = make_session(NULL, sphere_file, bodies, 2);
  const nearmesh_frame* frame = NULL;
  const nearmesh_readiness* readiness = NULL;
  nearmesh_motion motions[2] = {NEARMESH_MOTION_IDENTITY, NEARMESH_MOTION_IDENTITY};
  motions[1].pose = at(2.2, 0, 0);
  CHECK(nearmesh_session_answer(session, 0) == NULL &&
        nearmesh_session_find(session, 0, 1) == NULL);
  CHECK(nearmesh_session_complaint(session, 0) == NULL &&
        nearmesh_session_unknown(session, 0) == NULL);
  MUST(nearmesh_session_readiness(session, 0, &readiness, &error));
  CHECK(readiness->stage == NEARMESH_WAITING && strstr(readiness->reason, "body 0") != NULL);
  nearmesh_motion where;
  REFUSED(nearmesh_session_motion_of(session, 0, &where, &error), NEARMESH_NOT_FOUND, "body 0");
  const nearmesh_model_facts* facts = NULL;
  REFUSED(nearmesh_session_model_facts(session, 0, &facts, &error), NEARMESH_NOT_FOUND, "body 0");
  double time_s = 1;
  REFUSED(nearmesh_session_heard_time(session, &time_s, &error), NEARMESH_NOT_FOUND, "no pose");

  // To certified answers; then nearer, where the first answer is not certified, never free.
  MUST(nearmesh_session_watch(session, 1, 0, &error));
  MUST(nearmesh_session_wait_ready(session, 0, 10, 1, 0, bodies, motions, 2, &readiness, &frame,
                                   &error));
  CHECK(readiness->stage == NEARMESH_CERTIFIED && readiness->pairs == 1 &&
        readiness->certified == 1);
  CHECK(frame->all_certified && frame->answer_count == 1);
  const nearmesh_pair_answer* pair = nearmesh_session_find(session, 0, 1);
  CHECK(pair->a == 1 && pair->b == 0 && pair->answer->status == NEARMESH_FREE);
  CHECK(pair->answer->clearance_m > 0 && pair->answer->clearance_m < 0.21);
  CHECK(pair->safe_horizon_s > 1e9 && pair->swept == NULL && pair->answer->contacts == NULL);
  motions[1].pose = at(1.97, 0, 0);
  int updates = 0;
  do {
    MUST(nearmesh_session_update(session, 2, 0.1, &bodies[1], &motions[1], 1, 0.1, &frame, &error));
    CHECK(nearmesh_session_find(session, 0, 1)->answer->status != NEARMESH_FREE);
  } while (!frame->all_certified && ++updates < 20);
  pair = nearmesh_session_find(session, 0, 1);
  CHECK(pair->answer->status == NEARMESH_CONTACT && pair->answer->pair_count > 0);

  MUST(nearmesh_session_motion_of(session, 1, &where, &error));
  CHECK(memcmp(&where, &motions[1], sizeof where) == 0);
  MUST(nearmesh_session_model_facts(session, 1, &facts, &error));
  CHECK(facts->face_count == kSphereFaces && strcmp(facts->content, pair->content_b) == 0);
  const nearmesh_session_stats* stats = NULL;
  MUST(nearmesh_session_get_stats(session, &stats, &error));
  CHECK(stats->batches > 0 && stats->exact_faces > 0 && stats->sequence_gaps == 0);
  const char* name = NULL;
  MUST(nearmesh_session_name_of(session, 1, &name, &error));
  CHECK(strcmp(name, "body 1") == 0);
  const nearmesh_body_facts* said = NULL;
  MUST(nearmesh_session_body_facts(session, 1, &said, &error));
  CHECK(strcmp(said->name, "body 1") == 0 && strcmp(said->model, "sphere") == 0);
  CHECK(said->content[0] == 0 && said->own && !said->solid && said->group == 1 &&
        said->mask == 0xffffffffU && said->max_speed_mps == 0);
  REFUSED(nearmesh_session_body_facts(session, 9, &said, &error), NEARMESH_NOT_FOUND, "body");
  CHECK(said == NULL);

  // What is held, to be drawn: some of the full mesh where they touch, and the rest coarse.
  const nearmesh_held_mesh* held = NULL;
  MUST(nearmesh_session_held_mesh(session, 1, &held, &error));
  CHECK(held->exact_count > 0 && held->coarse_count > 0);
  CHECK(held->exact_count + held->coarse_count < kSphereFaces);
  for (size_t i = 0; i < 9 * held->exact_count; ++i)
    CHECK(held->exact_m[i] >= -1.001 && held->exact_m[i] <= 1.001);
  const uint64_t state = nearmesh_session_held_state(session, 1);
  CHECK(state != 0 && nearmesh_session_held_state(session, 1) == state);
  CHECK(nearmesh_session_held_state(session, 9) == 0 && nearmesh_session_held_state(NULL, 1) == 0);
  REFUSED(nearmesh_session_held_mesh(session, 9, &held, &error), NEARMESH_NOT_FOUND, "body");
  CHECK(held == NULL);
  CHECK(frame->came_count == 0 && frame->went_count == 0 && frame->promised == 0);
  CHECK(nearmesh_session_came(session, 0) == NEARMESH_NONE &&
        nearmesh_session_went(session, 0) == NEARMESH_NONE &&
        nearmesh_session_came(NULL, 0) == NEARMESH_NONE);
  const double lo[3] = {0.9, -0.1, -0.1}, hi[3] = {1.1, 0.1, 0.1};
  const nearmesh_region_readiness* region = NULL;
  MUST(nearmesh_session_region_readiness(session, 0, lo, hi, &region, &error));
  CHECK(region->resolved || (region->unresolved_nodes > 0 && region->reason[0] != 0));
  REFUSED(nearmesh_session_region_readiness(session, 0, hi, lo, &region, &error),
          NEARMESH_INVALID_ARGUMENT, "region of body");
  CHECK(region == NULL);
  MUST(nearmesh_session_write_cache(session, &error));

  // Of others, and scenery; what is not known is told of by watch_all().
  MUST(nearmesh_session_watch_all(session, &error));
  nearmesh_body_options other;
  nearmesh_body_options_init(&other, sizeof other);
  other.name = "other";
  other.model = "sphere";
  nearmesh_body guest = 0;
  MUST(nearmesh_session_add_body(session, &other, &guest, &error));
  MUST(nearmesh_session_update(session, 3, 0.2, NULL, NULL, 0, 0.1, &frame, &error));
  CHECK(frame->unknown_count == 1 && frame->unknown_pairs == 2 && !frame->all_certified);
  const nearmesh_unknown_body* unknown = nearmesh_session_unknown(session, 0);
  CHECK(unknown->body == guest && strstr(unknown->reason, "no pose") != NULL);
  nearmesh_motion motion = NEARMESH_MOTION_IDENTITY;
  motion.pose = at(50, 0, 0);
  MUST(nearmesh_session_set_connected(session, 0, &error));
  MUST(nearmesh_session_deliver(session, "other", &motion, 0.25, &error));  // nobody hears it
  MUST(nearmesh_session_set_connected(session, 1, &error));
  MUST(nearmesh_session_deliver(session, "other", &motion, 0.25, &error));
  MUST(nearmesh_session_wait_ready(session, guest, 10, 4, 0.25, NULL, NULL, 0, &readiness, NULL,
                                   &error));
  CHECK(readiness->stage == NEARMESH_CERTIFIED);
  MUST(nearmesh_session_heard_time(session, &time_s, &error));
  CHECK(time_s == 0.25);
  MUST(nearmesh_session_place_body(session, guest, &motion.pose, &error));
  MUST(nearmesh_session_unwatch(session, 0, 1, &error));
  MUST(nearmesh_session_remove_body(session, guest, &error));
  REFUSED(nearmesh_session_remove_body(session, guest, &error), NEARMESH_NOT_FOUND, "body 2");

  // What is refused, and leaves the last frame.
  MUST(nearmesh_session_update(session, 5, 0.3, NULL, NULL, 0, 0, &frame, &error));
  CHECK(frame->answer_count == 1);
  motions[0].pose.rotation[4] = INFINITY;
  const nearmesh_frame* none = frame;
  REFUSED(nearmesh_session_update(session, 6, 0.3, bodies, motions, 2, 0.1, &none, &error),
          NEARMESH_INVALID_ARGUMENT, "pose of body 0: rotation[4] is inf");
  CHECK(none == NULL && nearmesh_session_answer(session, 0) != NULL);
  motions[0].pose = at(0, 0, 0);
  motions[0].linear_velocity_mps[2] = NAN;
  REFUSED(nearmesh_session_update(session, 6, 0.3, bodies, motions, 2, 0.1, &frame, &error),
          NEARMESH_INVALID_ARGUMENT, "body 0");
  REFUSED(nearmesh_session_update(session, 6, NAN, NULL, NULL, 0, 0.1, &frame, &error),
          NEARMESH_INVALID_ARGUMENT, "time_s");
  REFUSED(nearmesh_session_update(session, 6, 1, NULL, NULL, 0, NAN, &frame, &error),
          NEARMESH_INVALID_ARGUMENT, "budget_s");
  REFUSED(nearmesh_session_update(session, 6, 1, NULL, motions, 1, 1, &frame, &error),
          NEARMESH_INVALID_ARGUMENT, "bodies is NULL");
  REFUSED(nearmesh_session_update(session, 6, 1, bodies, NULL, 1, 1, &frame, &error),
          NEARMESH_INVALID_ARGUMENT, "motions is NULL");
  REFUSED(nearmesh_session_update(session, 6, 1, &guest, &motion, 1, 1, &frame, &error),
          NEARMESH_NOT_FOUND, "body 2");
  REFUSED(nearmesh_session_update(NULL, 6, 1, NULL, NULL, 0, 1, &frame, &error),
          NEARMESH_INVALID_ARGUMENT, "session is NULL");
  REFUSED(nearmesh_session_wait_ready(session, 0, NAN, 6, 1, NULL, NULL, 0, NULL, NULL, &error),
          NEARMESH_INVALID_ARGUMENT, "timeout_s");
  REFUSED(nearmesh_session_wait_ready(session, 77, 1, 6, 1, NULL, NULL, 0, NULL, NULL, &error),
          NEARMESH_NOT_FOUND, "body 77");
  REFUSED(nearmesh_session_watch(session, 0, 0, &error), NEARMESH_INVALID_ARGUMENT, "body 0");
  REFUSED(nearmesh_session_watch(session, 0, NEARMESH_NONE, &error), NEARMESH_NOT_FOUND, "none");
  REFUSED(nearmesh_session_unwatch(session, 0, 9, &error), NEARMESH_NOT_FOUND, "body 9");
  memset(&motion, 0, sizeof motion);
  REFUSED(nearmesh_session_place_body(session, 0, &motion.pose, &error), NEARMESH_INVALID_ARGUMENT,
          "pose of body 0");
  REFUSED(nearmesh_session_deliver(session, "other", &motion, 0, &error), NEARMESH_INVALID_ARGUMENT,
          "other");
  REFUSED(nearmesh_session_add_model(session, "sphere", sphere_file, &error), NEARMESH_CONFLICT,
          "sphere");
  REFUSED(nearmesh_session_add_model(session, "ball", "/no/such/file", &error), NEARMESH_IO,
          "/no/such/file");
  REFUSED(nearmesh_session_replace_model(session, 0, "ball", "zz", &error),
          NEARMESH_INVALID_ARGUMENT, "zz");
  MUST(nearmesh_session_replace_model(session, 0, "ball", NULL, &error));
  nearmesh_body body = 3;
  other.name = "body 0";
  REFUSED(nearmesh_session_add_body(session, &other, &body, &error), NEARMESH_CONFLICT, "body 0");
  CHECK(body == NEARMESH_NONE);
  other.name = NULL;
  REFUSED(nearmesh_session_add_body(session, &other, &body, &error), NEARMESH_INVALID_ARGUMENT,
          "name is NULL");
  other.name = "more";
  other.content = "12";
  REFUSED(nearmesh_session_add_body(session, &other, &body, &error), NEARMESH_INVALID_ARGUMENT,
          "12");
  other.content = NULL;
  other.max_pose_age_s = NAN;
  REFUSED(nearmesh_session_add_body(session, &other, &body, &error), NEARMESH_INVALID_ARGUMENT,
          "max_pose_age_s is nan");
  REFUSED(nearmesh_session_add_body(session, NULL, &body, &error), NEARMESH_INVALID_ARGUMENT,
          "options is NULL");
  nearmesh_session_destroy(session);
  nearmesh_session_destroy(NULL);
}

static void test_robot(const char* sphere_file) {
  nearmesh_body links[3];
  nearmesh_session* session = make_session(NULL, sphere_file, links, 3);
  REFUSED(nearmesh_session_link_bodies(session, NULL, 2, &error), NEARMESH_INVALID_ARGUMENT,
          "bodies is NULL");
  REFUSED(nearmesh_session_link_bodies(session, links, 1, &error), NEARMESH_INVALID_ARGUMENT,
          "found 1");
  MUST(nearmesh_session_link_bodies(session, links, 2, &error));
  REFUSED(nearmesh_session_link_bodies(session, &links[1], 2, &error), NEARMESH_CONFLICT,
          "a link already");
  const nearmesh_motion still = NEARMESH_MOTION_IDENTITY;
  nearmesh_motion motions[2] = {still, still};
  motions[1].pose = at(5, 0, 0);
  const nearmesh_frame* frame = NULL;
  REFUSED(nearmesh_session_update(session, 1, 0, links, motions, 1, 0.1, &frame, &error),
          NEARMESH_INVALID_ARGUMENT, "expected all");
  MUST(nearmesh_session_update(session, 1, 0, links, motions, 2, 0.1, &frame, &error));
  MUST(nearmesh_session_remove_body(session, links[0], &error));  // the robot
  nearmesh_motion where;
  REFUSED(nearmesh_session_motion_of(session, links[1], &where, &error), NEARMESH_NOT_FOUND,
          "body 1");
  nearmesh_session_destroy(session);
}

static void test_session_options(void) {
  nearmesh_session* session = NULL;
  nearmesh_session_options options;
  const nearmesh_session_options* given = &options;
#define REFUSES(field, value)                              \
  nearmesh_session_options_init(&options, sizeof options); \
  options.field = (value);                                 \
  REFUSED(nearmesh_session_create_local(given, &session, &error), NEARMESH_INVALID_ARGUMENT, #field)
  REFUSES(max_pose_age_s, -1);
  REFUSES(max_pose_age_s, NAN);
  REFUSES(lookahead_s, -1);
  REFUSES(lookahead_s, INFINITY);
  REFUSES(margin_m, NAN);
  REFUSES(sweep_s, NAN);
  REFUSES(sweep_s, 1e-30);
  REFUSES(sweep_s, -1);
  REFUSES(request_timeout_s, 0);
  REFUSES(audit_s, -1);
  REFUSES(window_bytes, 1);
  REFUSES(clearance, -1);
  REFUSED(nearmesh_session_create_local(NULL, NULL, &error), NEARMESH_INVALID_ARGUMENT,
          "session is NULL");

  nearmesh_dds_options dds;
  CHECK(nearmesh_dds_options_init(&dds, sizeof dds) == NEARMESH_OK && dds.transport == NULL);
  dds.transport = "pigeon";
  if (nearmesh_has_dds()) {
    REFUSED(nearmesh_session_create_dds(&dds, NULL, &session, &error), NEARMESH_INVALID_ARGUMENT,
            "transport is 'pigeon'");
    dds.transport = "lan";
    dds.network_interface = "127.0.0.1";
    dds.domain = 1000;
    REFUSED(nearmesh_session_create_dds(&dds, NULL, &session, &error), NEARMESH_INVALID_ARGUMENT,
            "domain");
    dds.domain = 0;
    dds.initial_peer_count = 1;
    REFUSED(nearmesh_session_create_dds(&dds, NULL, &session, &error), NEARMESH_INVALID_ARGUMENT,
            "initial_peers");
    dds.initial_peer_count = 0;
    dds.lease_s = NAN;
    REFUSED(nearmesh_session_create_dds(&dds, NULL, &session, &error), NEARMESH_INVALID_ARGUMENT,
            "lease_s");
    dds.lease_s = 0;
    dds.listen_port = 65536;
    REFUSED(nearmesh_session_create_dds(&dds, NULL, &session, &error), NEARMESH_INVALID_ARGUMENT,
            "listen_port");
  } else {
    REFUSED(nearmesh_session_create_dds(&dds, NULL, &session, &error), NEARMESH_UNSUPPORTED,
            "without DDS");
  }
  CHECK(session == NULL);
}

// A second thread comes while the first one is in an update: it is told so.
typedef struct Intruder {
  nearmesh_session* session;
  nearmesh_error error;
  nearmesh_status status;
} Intruder;

static void* intrude(void* intruder_) {
  Intruder* intruder = intruder_;
  intruder->status = nearmesh_session_watch_all(intruder->session, &intruder->error);
  return NULL;
}

static void run_with_intruder(void* user, size_t count, nearmesh_job job, void* jobs) {
  Intruder* intruder = user;
  pthread_t thread;
  if (pthread_create(&thread, NULL, intrude, intruder) != 0) abort();
  pthread_join(thread, NULL);
  for (size_t i = 0; i < count; ++i) job(jobs, i);
}

static void test_threads(const char* sphere_file) {
  Intruder intruder = {NULL, {NEARMESH_OK, ""}, NEARMESH_OK};
  nearmesh_session_options options;
  nearmesh_session_options_init(&options, sizeof options);
  options.run_jobs = run_with_intruder;
  options.run_jobs_user = &intruder;
  nearmesh_body bodies[3];
  nearmesh_session* session = make_session(&options, sphere_file, bodies, 3);
  intruder.session = session;
  MUST(nearmesh_session_watch(session, 0, 1, &error));
  MUST(nearmesh_session_watch(session, 0, 2, &error));
  MUST(nearmesh_session_update(session, 1, 0, NULL, NULL, 0, 0.1, NULL, &error));
  CHECK(intruder.status == NEARMESH_CONFLICT && strstr(intruder.error.message, "in use") != NULL);
  MUST(nearmesh_session_watch_all(session, &error));
  nearmesh_session_destroy(session);
}

// ---- Recordings

static void test_recordings(const char* path, const char* sphere_file) {
  nearmesh_recording* recording = NULL;
  MUST(nearmesh_recording_open(path, &recording, &error));
  const nearmesh_recording_facts* facts = nearmesh_recording_get_facts(recording);
  CHECK(facts->message_count > 100 && facts->parts == 1 && facts->topic_count > 3);
  CHECK(facts->begin_ns > 0 && facts->end_ns > facts->begin_ns && facts->idl[0] != 0);
  const nearmesh_recorded_message* message = NULL;
  int64_t count = 0, reports_by_topic = 0, last_ns = 0, middle_ns = 0;
  for (;;) {
    MUST(nearmesh_recording_next(recording, &message, &error));
    if (message == NULL) break;
    CHECK(message->id == ++count && message->cdr_bytes > 4 && message->cdr[0] == 0);
    CHECK(strncmp(message->topic, facts->prefix, strlen(facts->prefix)) == 0);
    CHECK(strncmp(message->type, "nearmesh::wire_types::", 22) == 0);
    if (strcmp(message->type, "nearmesh::wire_types::ContactReportSample") == 0) ++reports_by_topic;
    if (count == 80) middle_ns = message->received_ns;
    last_ns = message->received_ns;
  }
  CHECK(count == facts->message_count && last_ns == facts->end_ns && reports_by_topic > 0);
  MUST(nearmesh_recording_next(recording, &message, &error));
  CHECK(message == NULL);
  MUST(nearmesh_recording_seek(recording, 80, &error));
  MUST(nearmesh_recording_next(recording, &message, &error));
  CHECK(message->id == 80 && message->received_ns == middle_ns);
  MUST(nearmesh_recording_seek_time(recording, middle_ns, &error));
  MUST(nearmesh_recording_next(recording, &message, &error));
  CHECK(message->received_ns == middle_ns);
  MUST(nearmesh_recording_seek(recording, INT64_MAX, &error));
  MUST(nearmesh_recording_next(recording, &message, &error));
  CHECK(message == NULL);
  REFUSED(nearmesh_recording_seek(recording, 0, &error), NEARMESH_INVALID_ARGUMENT, "id is 0");

  MUST(nearmesh_recording_seek(recording, 1, &error));
  const nearmesh_recorded_report* report = NULL;
  if (nearmesh_has_dds()) {
    int64_t reports = 0, certified = 0, touching = 0;
    for (;;) {
      MUST(nearmesh_recording_next_report(recording, &report, &error));
      if (report == NULL) break;
      ++reports;
      CHECK(report->body_a[0] != 0 && report->body_b[0] != 0 && report->peer != 0);
      certified += report->status == NEARMESH_FREE || report->status == NEARMESH_CONTACT;
      touching += report->pair_count > 0;
      CHECK(report->pair_count <= report->pair_total && report->pair_count <= 64);
    }
    CHECK(reports == reports_by_topic && certified > 0 && touching > 0);
  } else {
    REFUSED(nearmesh_recording_next_report(recording, &report, &error), NEARMESH_UNSUPPORTED,
            "without DDS");
  }
  nearmesh_recording_close(recording);
  nearmesh_recording_close(NULL);
  REFUSED(nearmesh_recording_open("/no/such/recording.db3", &recording, &error), NEARMESH_NOT_FOUND,
          "recording.db3");
  CHECK(recording == NULL && nearmesh_recording_get_facts(NULL) == NULL);
  REFUSED(nearmesh_recording_open(sphere_file, &recording, &error), NEARMESH_CORRUPT, sphere_file);
}

// ---- Words

static void test_words(void) {
  CHECK(strcmp(nearmesh_version(), NEARMESH_VERSION) == 0);
  CHECK(strcmp(nearmesh_status_name(NEARMESH_INVALID_ARGUMENT), "invalid_argument") == 0);
  CHECK(strcmp(nearmesh_status_name(-5), "unknown") == 0);
  CHECK(strcmp(nearmesh_answer_status_name(NEARMESH_CONTAINED), "contained") == 0);
  CHECK(strcmp(nearmesh_answer_status_name(5), "unknown") == 0);
  // A text that is longer than its place is cut, not within a character.
  char path[3000] = "/";
  for (int i = 1; i + 2 < (int)sizeof path; i += 2) memcpy(path + i, "\xc3\xa4", 3);
  nearmesh_model* model = NULL;
  REFUSED(nearmesh_model_open(path, &model, &error), NEARMESH_IO, "\xc3\xa4");
  const size_t length = strlen(error.message);
  CHECK(length < NEARMESH_MESSAGE_BYTES && length > NEARMESH_MESSAGE_BYTES - 4);
  CHECK((error.message[length - 1] & 0xff) == 0xa4);
}

// ---- Probes

static void test_probes(const char* sphere_file, const char* open_file) {
  const nearmesh_pose pose = NEARMESH_POSE_IDENTITY;
  const nearmesh_ray rays[3] = {{{0.1, 0.1, 5}, {0, 0, -1}, INFINITY},
                                {{3, 3, 5}, {0, 0, -2}, INFINITY},
                                {{0.1, 0.1, 5}, {0, 0, -1}, 1}};
  nearmesh_ray_answer answers[3];
  nearmesh_model* model = NULL;
  MUST(nearmesh_model_open(sphere_file, &model, &error));
  MUST(nearmesh_model_probe_rays(model, &pose, rays, 3, answers, &error));
  CHECK(answers[0].status == NEARMESH_HIT && answers[0].has_face && answers[0].missing == 0);
  CHECK(answers[0].at_most_m > 3.9 && answers[0].at_most_m < 4.2);
  CHECK(answers[0].at_least_m <= answers[0].at_most_m && answers[0].normal[2] > 0.9);
  CHECK(answers[1].status == NEARMESH_MISS && isinf(answers[1].at_most_m) &&
        isinf(answers[1].at_least_m));
  CHECK(answers[2].status == NEARMESH_MISS);
  uint32_t number = 0;
  MUST(nearmesh_model_face_number(model, answers[0].face, &number, &error));
  const double points_m[6] = {0, 0, 0, 0, 0, 3};
  nearmesh_point_answer of_points[2];
  MUST(nearmesh_model_probe_points(model, &pose, points_m, 2, of_points, &error));
  CHECK(of_points[0].status == NEARMESH_HIT && !of_points[0].on_surface);
  CHECK(of_points[1].status == NEARMESH_MISS);
  const nearmesh_ball balls[2] = {{{0, 0, 2}, 1.2}, {{0, 0, 2}, 0.5}};
  nearmesh_shape_answer of_shapes[2];
  MUST(nearmesh_model_probe_balls(model, &pose, balls, 2, of_shapes, &error));
  CHECK(of_shapes[0].status == NEARMESH_HIT && of_shapes[0].has_face);
  CHECK(of_shapes[1].status == NEARMESH_MISS);
  const nearmesh_box boxes[2] = {{NEARMESH_POSE_IDENTITY, {3, 3, 3}},
                                 {NEARMESH_POSE_IDENTITY, {0.1, 0.1, 0.1}}};
  MUST(nearmesh_model_probe_boxes(model, &pose, boxes, 2, of_shapes, &error));
  CHECK(of_shapes[0].status == NEARMESH_HIT && !of_shapes[0].has_face);
  CHECK(of_shapes[1].status == NEARMESH_MISS);

  nearmesh_ray bad = rays[0];
  bad.direction[2] = 0;
  REFUSED(nearmesh_model_probe_rays(model, &pose, &bad, 1, answers, &error),
          NEARMESH_INVALID_ARGUMENT, "ray 0");
  REFUSED(nearmesh_model_probe_rays(model, &pose, NULL, 1, answers, &error),
          NEARMESH_INVALID_ARGUMENT, "rays");
  REFUSED(nearmesh_model_probe_rays(model, &pose, rays, 1, NULL, &error), NEARMESH_INVALID_ARGUMENT,
          "answers");
  REFUSED(nearmesh_model_probe_rays(model, NULL, rays, 1, answers, &error),
          NEARMESH_INVALID_ARGUMENT, "pose");
  MUST(nearmesh_model_probe_rays(model, &pose, NULL, 0, NULL, &error));
  nearmesh_model_close(model);
  MUST(nearmesh_model_open(open_file, &model, &error));
  REFUSED(nearmesh_model_probe_points(model, &pose, points_m, 2, of_points, &error),
          NEARMESH_INVALID_ARGUMENT, "boundary edges");
  nearmesh_model_close(model);

  // Of a session: uncertain, asked for, certified; and of a body that the host hears of.
  nearmesh_session* session = NULL;
  MUST(nearmesh_session_create_local(NULL, &session, &error));
  MUST(nearmesh_session_add_model(session, "sphere", sphere_file, &error));
  nearmesh_body_options options;
  nearmesh_body_options_init(&options, sizeof options);
  options.name = "other";
  options.model = "sphere";
  nearmesh_body body;
  MUST(nearmesh_session_add_body(session, &options, &body, &error));
  options.name = "own";
  options.own = 1;
  nearmesh_body own;
  MUST(nearmesh_session_add_body(session, &options, &own, &error));
  const nearmesh_probe_report* report = NULL;
  int updates = 0;
  for (; updates < 30; ++updates) {
    MUST(nearmesh_session_probe_rays(session, body, rays, 3, answers, &report, &error));
    if (report->reason[0] == 0 && report->missing == 0) break;
    CHECK(report->reason[0] != 0 || report->awaited[0] != 0);
    const nearmesh_motion motion = NEARMESH_MOTION_IDENTITY;
    const double time_s = updates;
    MUST(nearmesh_session_hear(session, &body, &time_s, &motion, 1, &error));
    REFUSED(nearmesh_session_hear(session, &own, &time_s, &motion, 1, &error),
            NEARMESH_INVALID_ARGUMENT, "own");
    MUST(nearmesh_session_update(session, (uint64_t)updates, updates, NULL, NULL, 0, 1, NULL,
                                 &error));
  }
  CHECK(updates > 1 && updates < 30);
  CHECK(answers[0].status == NEARMESH_HIT && answers[1].status == NEARMESH_MISS);
  CHECK(report->age_s == 0 && report->pose.rotation[0] == 1);
  MUST(nearmesh_session_probe_points(session, body, points_m, 2, of_points, NULL, &error));
  MUST(nearmesh_session_probe_balls(session, body, balls, 2, of_shapes, NULL, &error));
  MUST(nearmesh_session_probe_boxes(session, body, boxes, 2, of_shapes, NULL, &error));
  REFUSED(nearmesh_session_probe_rays(session, 99, rays, 3, answers, &report, &error),
          NEARMESH_NOT_FOUND, "99");
  CHECK(report == NULL);
  nearmesh_session_destroy(session);
}

int main(int argc, char** argv) {
  if (argc != 3) return fprintf(stderr, "usage: %s FOLDER RECORDING\n", argv[0]), 2;
  char sphere_file[1024], open_file[1024];
  snprintf(sphere_file, sizeof sphere_file, "%s/sphere.spm", argv[1]);
  snprintf(open_file, sizeof open_file, "%s/open.spm", argv[1]);
  test_words();
  test_models(sphere_file, open_file);
  test_queries(sphere_file, open_file);
  test_lengths(sphere_file);
  test_session(sphere_file);
  test_run_jobs(sphere_file);
  test_budget(sphere_file);
  test_probes(sphere_file, open_file);
  test_robot(sphere_file);
  test_session_options();
  test_threads(sphere_file);
  test_recordings(argv[2], sphere_file);
  if (failures == 0) printf("the C interface holds\n");
  return failures == 0 ? 0 : 1;
}
