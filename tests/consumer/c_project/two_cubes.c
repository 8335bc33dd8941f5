// SPDX-License-Identifier: Apache-2.0
// Bakes a cube into the file of its argument, and asks whether two of them touch: in C, with what is installed.
#include <nearmesh.h>
#include <stdio.h>
#include <string.h>

static nearmesh_error error;

static int fail(const char* what) {
  fprintf(stderr, "%s: %s\n", what, error.message);
  return 1;
}

int main(int argc, char** argv) {
  const char* path = argc > 1 ? argv[1] : "cube.spm";
  const double corners_m[] = {-1, -1, -1, 1, -1, -1, -1, 1, -1, 1, 1, -1,
                              -1, -1, 1,  1, -1, 1,  -1, 1, 1,  1, 1, 1};
  const uint32_t faces[] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                            2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
  if (nearmesh_bake(corners_m, 8, faces, 12, path, NULL, &error) != NEARMESH_OK)
    return fail("bake");
  nearmesh_model* cube = NULL;
  if (nearmesh_model_open(path, &cube, &error) != NEARMESH_OK) return fail("open");
  nearmesh_query* query = NULL;
  if (nearmesh_query_create(cube, cube, NULL, &query, &error) != NEARMESH_OK) return fail("query");
  int right = strcmp(nearmesh_version(), NEARMESH_VERSION) == 0;
  for (int i = 0; i < 2; ++i) {
    const nearmesh_pose here = NEARMESH_POSE_IDENTITY;
    nearmesh_pose there = NEARMESH_POSE_IDENTITY;
    there.translation_m[0] = 1.5 + i;
    const nearmesh_answer* answer = NULL;
    if (nearmesh_query_ask(query, &here, &there, &answer, &error) != NEARMESH_OK)
      return fail("ask");
    printf("%.1f m: %s\n", there.translation_m[0], nearmesh_answer_status_name(answer->status));
    right = right && answer->status == (i == 0 ? NEARMESH_CONTACT : NEARMESH_FREE);
  }
  nearmesh_query_destroy(query);
  nearmesh_model_close(cube);
  return right ? 0 : fail("expected a contact, then a free answer");
}
