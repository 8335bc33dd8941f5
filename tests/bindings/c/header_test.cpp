// SPDX-License-Identifier: Apache-2.0
// The C header is C++ too, of the oldest standard that anybody still has.
#include "nearmesh.h"

static_assert(noexcept(nearmesh_version()), "nothing is thrown");

const nearmesh_motion kStill = NEARMESH_MOTION_IDENTITY;
