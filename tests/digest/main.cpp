// SPDX-License-Identifier: Apache-2.0
// Prints one line a job: its name and the digest of all that it computed. The lines must be the
// same for every compiler, optimisation and number of threads; compare_builds.sh compares builds.
//   nearmesh-digest [--threads N]     each job in N threads at once, which must agree

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <thread>

#include "jobs.hpp"

using namespace nearmesh;
using namespace nearmesh::digest_jobs;

namespace {

std::vector<Job> all_jobs() {
  std::vector<Job> jobs;
  std::vector<std::vector<Job>> rooms{geometry_jobs(), model_jobs(), answer_jobs()};
#ifdef NEARMESH_GOLDEN_SESSION
  rooms.push_back(session_jobs());
#endif
  for (const std::vector<Job>& room : rooms) jobs.insert(jobs.end(), room.begin(), room.end());
  return jobs;
}

}  // namespace

int main(int argc, char** argv) {
  unsigned threads = 1;
  CLI::App app{"Digests of fixed work, for comparing builds"};
  app.add_option("--threads", threads, "Run each job in so many threads at once")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  int exit_code = 0;
  for (const Job& job : all_jobs()) {
    std::vector<std::uint64_t> digests(threads);
    std::vector<std::thread> running;
    for (std::uint64_t& digest : digests) running.emplace_back([&] { digest = job.run(); });
    for (std::thread& thread : running) thread.join();
    const bool agree = std::all_of(digests.begin(), digests.end(),
                                   [&](std::uint64_t d) { return d == digests[0] && d != 0; });
    std::printf("%s %s\n", job.name.c_str(), to_hex(digests[0]).c_str());
    if (agree) continue;
    std::fprintf(stderr, "%s: failed, or its threads disagree\n", job.name.c_str());
    exit_code = 1;
  }
  return exit_code;
}
