// SPDX-License-Identifier: Apache-2.0
#pragma once
// A scheduler of the host's, given as a C function, as Session wants one.

#include "nearmesh.h"
#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::c {

/// None where `run` is none.
[[nodiscard]] subscriber::RunJobs run_jobs_of(nearmesh_run_jobs run, void* user);

}  // namespace nearmesh::c
