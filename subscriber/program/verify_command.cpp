// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber verify: does a recorded session come out the same again?
#include <cstdio>
#include <memory>

#include "commands.hpp"
#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/recorded/verify.hpp"

namespace nearmesh::subscriber::program {
namespace {

void print(const std::vector<std::array<FaceKey, 2>>& pairs, const char* where) {
  constexpr std::size_t kShown = 8;
  for (std::size_t i = 0; i < std::min(pairs.size(), kShown); ++i)
    std::printf("  only %s: face (%u, %u) and face (%u, %u)\n", where, pairs[i][0].split.value,
                pairs[i][0].index, pairs[i][1].split.value, pairs[i][1].index);
}

}  // namespace

Status run(const VerifyOptions& options) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  Result<std::unique_ptr<RecordingReader>> recording = RecordingReader::open(options.path);
  if (!recording.is_ok()) return recording.status();
  RecordingReader& reader = *recording.value();
  const Stopwatch clock;
  const Result<VerifyReport> result = verify(reader, options.threads);
  if (!result.is_ok()) return result.status();
  const VerifyReport& report = result.value();
  const double seconds = clock.seconds();
  std::printf("%llu reports of %llu peers: %llu verified, %llu different, digest %s\n",
              count(report.reports), count(report.peers), count(report.verified),
              count(report.different), to_hex(report.digest).c_str());
  std::printf(
      "not compared: %llu without an answer, %llu for want of recorded batches, %llu after detail "
      "was given up, %llu malformed\n",
      count(report.not_asked), count(report.lacking), count(report.gave_up),
      count(report.malformed));
  const double span_s = static_cast<double>(reader.end_ns() - reader.begin_ns()) * 1e-9;
  std::fprintf(stderr, "%.1f s of session in %.2f s\n", span_s, seconds);
  if (report.different == 0) return Status::ok();
  const Difference& first = report.differences.front();
  std::printf("first difference: message %lld, frame %llu, peer %s, bodies %s and %s\n  %s\n",
              static_cast<long long>(first.message), count(first.recorded.frame),
              wire::partition_of(first.recorded.peer).c_str(), first.recorded.body_a.c_str(),
              first.recorded.body_b.c_str(), first.what.c_str());
  print(first.only_recorded, "recorded");
  print(first.only_found, "found");
  std::fflush(stdout);
  return {StatusCode::kConflict, options.path + ": " + std::to_string(report.different) + " of " +
                                     std::to_string(report.reports) + " reports differ"};
}

}  // namespace nearmesh::subscriber::program
