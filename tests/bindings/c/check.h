// SPDX-License-Identifier: Apache-2.0
// What the C tests share: checks that say where they failed, and a sphere.
#ifndef NEARMESH_TESTS_CHECK_H
#define NEARMESH_TESTS_CHECK_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "nearmesh.h"

static int failures = 0;

#define CHECK(condition)                                                   \
  do {                                                                     \
    if (!(condition)) {                                                    \
      ++failures;                                                          \
      printf("%s:%d: %s does not hold\n", __FILE__, __LINE__, #condition); \
    }                                                                      \
  } while (0)

// A call that succeeds; where it does not the test ends, for the rest would rest on it.
#define MUST(call)                                                                                \
  do {                                                                                            \
    const nearmesh_status must_ = (call);                                                         \
    if (must_ != NEARMESH_OK) {                                                                   \
      printf("%s:%d: %s: %s: %s\n", __FILE__, __LINE__, #call, nearmesh_status_name(must_),       \
             error.message);                                                                      \
      exit(1);                                                                                    \
    }                                                                                             \
  } while (0)

// A call that fails so, with these words in its text.
#define REFUSED(call, status_, words)                                                          \
  do {                                                                                         \
    const nearmesh_status got_ = (call);                                                       \
    if (got_ != (status_) || error.status != got_ || strstr(error.message, (words)) == NULL) { \
      ++failures;                                                                              \
      printf("%s:%d: %s: %s: '%s', expected %s with '%s'\n", __FILE__, __LINE__, #call,        \
             nearmesh_status_name(got_), error.message, nearmesh_status_name(status_), words); \
    }                                                                                          \
  } while (0)

enum { kSlices = 32, kStacks = 16 };
enum { kSphereVertices = 2 + kSlices * (kStacks - 1), kSphereFaces = 2 * kSlices * (kStacks - 1) };
typedef struct Sphere {
  double positions_m[3 * kSphereVertices];
  uint32_t faces[3 * kSphereFaces];
} Sphere;

static inline void add_face(Sphere* sphere, size_t* count, uint32_t a, uint32_t b, uint32_t c) {
  uint32_t* face = sphere->faces + 3 * (*count)++;
  face[0] = a;
  face[1] = b;
  face[2] = c;
}

// Of radius 1, poles on z, oriented outward.
static inline void make_sphere(Sphere* sphere) {
  const double pi = 3.14159265358979323846;
  size_t at = 0, face = 0;
  const uint32_t south = kSphereVertices - 1;
  sphere->positions_m[at++] = 0;
  sphere->positions_m[at++] = 0;
  sphere->positions_m[at++] = 1;
  for (int stack = 1; stack < kStacks; ++stack)
    for (int slice = 0; slice < kSlices; ++slice) {
      const double polar = pi * stack / kStacks, around = 2 * pi * slice / kSlices;
      sphere->positions_m[at++] = sin(polar) * cos(around);
      sphere->positions_m[at++] = sin(polar) * sin(around);
      sphere->positions_m[at++] = cos(polar);
    }
  sphere->positions_m[at++] = 0;
  sphere->positions_m[at++] = 0;
  sphere->positions_m[at++] = -1;
  for (uint32_t slice = 0; slice < kSlices; ++slice) {
    const uint32_t next = (slice + 1) % kSlices, last = 1 + kSlices * (kStacks - 2);
    add_face(sphere, &face, 0, 1 + slice, 1 + next);
    for (uint32_t ring = 1; ring < last; ring += kSlices) {
      add_face(sphere, &face, ring + slice, ring + kSlices + slice, ring + kSlices + next);
      add_face(sphere, &face, ring + slice, ring + kSlices + next, ring + next);
    }
    add_face(sphere, &face, south, last + next, last + slice);
  }
}

static inline nearmesh_pose at(double x, double y, double z) {
  nearmesh_pose pose = NEARMESH_POSE_IDENTITY;
  pose.translation_m[0] = x;
  pose.translation_m[1] = y;
  pose.translation_m[2] = z;
  return pose;
}

#endif
