// SPDX-License-Identifier: Apache-2.0
#include "run_jobs.hpp"

#include <cstddef>
#include <functional>

namespace nearmesh::c {
namespace {

using Job = std::function<void(std::size_t)>;

// The session's jobs throw nothing, and one that comes twice or is none of them does nothing.
extern "C" void run_one_job(void* jobs, size_t index) { (*static_cast<const Job*>(jobs))(index); }

}  // namespace

subscriber::RunJobs run_jobs_of(nearmesh_run_jobs run, void* user) {
  if (run == nullptr) return nullptr;
  return [run, user](std::size_t count, const Job& job) {
    run(user, count, &run_one_job, const_cast<Job*>(&job));
  };
}

}  // namespace nearmesh::c
