// SPDX-License-Identifier: Apache-2.0
#include "geometry.h"

#include <inttypes.h>
#include <nearmesh.h>
#include <stdio.h>
#include <string.h>

enum { kMaxModels = 16, kMaxQueries = 64 };

static struct {
  uint64_t content[2];
  nearmesh_model* model;
} models[kMaxModels];
static int model_count;

/// A query of each pair of models that was asked about: it keeps what it has read of them.
static struct {
  const nearmesh_model *a, *b;
  int is_solid[2];
  nearmesh_query* query;
} queries[kMaxQueries];
static int query_count;

static int failed(const char* message) {
  fprintf(stderr, "cyclone_peer: %s\n", message);
  return 0;
}

int open_model(const char* path, uint64_t content[2]) {
  nearmesh_error error;
  nearmesh_model* model = NULL;
  if (model_count == kMaxModels) return failed("too many model files");
  if (nearmesh_model_open(path, &model, &error) != NEARMESH_OK) return failed(error.message);
  const char* hexadecimal = nearmesh_model_get_facts(model)->content;
  if (sscanf(hexadecimal, "%16" SCNx64 "%16" SCNx64, &content[0], &content[1]) != 2) {
    nearmesh_model_close(model);
    return failed("a content that is no number");
  }
  models[model_count].model = model;
  memcpy(models[model_count].content, content, sizeof models[0].content);
  ++model_count;
  return 1;
}

static nearmesh_model* model_of(const uint64_t content[2]) {
  for (int i = 0; i < model_count; ++i)
    if (!memcmp(models[i].content, content, sizeof models[i].content)) return models[i].model;
  return NULL;
}

static nearmesh_query* query_of(nearmesh_model* a, nearmesh_model* b, const int is_solid[2]) {
  for (int i = 0; i < query_count; ++i)
    if (queries[i].a == a && queries[i].b == b &&
        !memcmp(queries[i].is_solid, is_solid, sizeof queries[i].is_solid))
      return queries[i].query;
  if (query_count == kMaxQueries) return NULL;
  nearmesh_error error;
  nearmesh_query_options options;
  nearmesh_query_options_init(&options, sizeof options);
  options.solid_a = is_solid[0];
  options.solid_b = is_solid[1];
  nearmesh_query* query = NULL;
  if (nearmesh_query_create(a, b, &options, &query, &error) != NEARMESH_OK) {
    failed(error.message);
    return NULL;
  }
  queries[query_count].a = a;
  queries[query_count].b = b;
  memcpy(queries[query_count].is_solid, is_solid, sizeof queries[0].is_solid);
  queries[query_count].query = query;
  ++query_count;
  return query;
}

int ask(const uint64_t contents[4], const int is_solid[2], const double poses[24],
        OwnAnswer* answer) {
  nearmesh_model* const a = model_of(contents);
  nearmesh_model* const b = model_of(contents + 2);
  if (!a || !b) return 0;
  nearmesh_query* const query = query_of(a, b, is_solid);
  if (!query) return 0;
  nearmesh_pose pose[2];
  for (int k = 0; k < 2; ++k) {
    memcpy(pose[k].rotation, poses + 12 * k, sizeof pose[k].rotation);
    memcpy(pose[k].translation_m, poses + 12 * k + 9, sizeof pose[k].translation_m);
  }
  nearmesh_error error;
  const nearmesh_answer* found = NULL;
  if (nearmesh_query_ask(query, &pose[0], &pose[1], &found, &error) != NEARMESH_OK)
    return failed(error.message);
  answer->status = nearmesh_answer_status_name(found->status);
  answer->is_certified = found->is_certified;
  answer->pair_total = found->pair_total;
  answer->clearance_m = found->clearance_m;
  answer->digest = found->digest;
  return 1;
}

void close_models(void) {
  for (int i = 0; i < query_count; ++i) nearmesh_query_destroy(queries[i].query);
  for (int i = 0; i < model_count; ++i) nearmesh_model_close(models[i].model);
  query_count = model_count = 0;
}
