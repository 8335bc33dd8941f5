// SPDX-License-Identifier: Apache-2.0
// What the peer needs of geometry, apart from it: idlc calls its header of types nearmesh.h, as the C interface is called.
#ifndef CYCLONE_GEOMETRY_H
#define CYCLONE_GEOMETRY_H

#include <stdint.h>

/// Content of the model in a .spm file, as two words, the high one first. 0 for a failure, which is printed.
int content_of_model(const char* path, uint64_t content[2]);

#endif
