// SPDX-License-Identifier: Apache-2.0
// What the peer needs of geometry, apart from it: idlc calls its header of types nearmesh.h, as the
// C interface is called.
#ifndef CYCLONE_GEOMETRY_H
#define CYCLONE_GEOMETRY_H

#include <stdint.h>

/// Opens a .spm file for ask(). Out: the content of its model, as two words, the high one first. 0
/// for a failure, which is printed.
int open_model(const char* path, uint64_t content[2]);

/// What two whole files say, by themselves.
typedef struct OwnAnswer {
  const char* status;
  int32_t is_certified;
  uint64_t pair_total;
  double clearance_m;
  uint64_t digest;  ///< equal answers, equal digests, whoever gives them
} OwnAnswer;

/// In: contents of A and of B, two words each; whether each is solid; their poses, a rotation and a
/// translation each, as a contact report has them. Out: 0 where not both models were opened, or for
/// a failure, which is printed.
int ask(const uint64_t contents[4], const int is_solid[2], const double poses[24],
        OwnAnswer* answer);

void close_models(void);

#endif
