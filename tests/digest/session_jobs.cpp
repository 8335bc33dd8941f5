// SPDX-License-Identifier: Apache-2.0
// A recorded session, proved: states and answers of every report, peers on one thread and on two.
#include <unistd.h>

#include <filesystem>

#include "jobs.hpp"
#include "subscriber/recorded/verify.hpp"

namespace nearmesh::digest_jobs {
namespace {

std::uint64_t verified() {
  // A copy of its own: SQLite opens for writing, and the job may run in several threads at once.
  std::string folder = std::filesystem::temp_directory_path() / "nearmesh_digest_XXXXXX";
  if (::mkdtemp(folder.data()) == nullptr) return 0;
  const std::string copy = folder + "/session.db3";
  std::filesystem::copy_file(NEARMESH_GOLDEN_SESSION, copy);
  Digest digest;
  for (const unsigned threads : {1U, 2U}) {
    const auto recording = RecordingReader::open(copy);
    if (!recording.is_ok()) return 0;
    const auto report = subscriber::verify(*recording.value(), {.threads = threads});
    if (!report.is_ok() || report.value().different != 0 || report.value().verified == 0) return 0;
    digest.add(report.value().digest);
    digest.add(report.value().verified);
  }
  std::filesystem::remove_all(folder);
  return digest.value();
}

}  // namespace

std::vector<Job> session_jobs() { return {{"session.verify", verified}}; }

}  // namespace nearmesh::digest_jobs
