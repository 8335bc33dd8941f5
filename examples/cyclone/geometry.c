// SPDX-License-Identifier: Apache-2.0
#include "geometry.h"

#include <inttypes.h>
#include <nearmesh.h>
#include <stdio.h>

int content_of_model(const char* path, uint64_t content[2]) {
  nearmesh_error error;
  nearmesh_model* model = NULL;
  if (nearmesh_model_open(path, &model, &error) != NEARMESH_OK) {
    fprintf(stderr, "cyclone_peer: %s\n", error.message);
    return 0;
  }
  const char* hexadecimal = nearmesh_model_get_facts(model)->content;
  const int words = sscanf(hexadecimal, "%16" SCNx64 "%16" SCNx64, &content[0], &content[1]);
  nearmesh_model_close(model);
  return words == 2;
}
