// SPDX-License-Identifier: Apache-2.0
// Reads a recorded session in your own code: of each pair of bodies, when it first touched and how
// near it came before.
//   nearmesh-example-read-session session.db3        see README.md in this folder

#include <algorithm>
#include <cstdio>
#include <limits>
#include <map>

#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"

using namespace nearmesh;

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: %s SESSION.db3\n", argv[0]), 2;
  const auto opened = RecordingReader::open(argv[1]);
  if (!opened.is_ok()) return std::fprintf(stderr, "%s\n", opened.status().message().c_str()), 1;
  RecordingReader& recording = *opened.value();
  const auto samples = wire::RecordedSamples::of(recording);
  if (!samples.is_ok()) return std::fprintf(stderr, "%s\n", samples.status().message().c_str()), 1;

  struct Pair {
    int answers = 0, certified = 0;
    double nearest_m = std::numeric_limits<double>::infinity(), touched_s = -1;
  };
  std::map<std::pair<std::string, std::string>, Pair> pairs;
  const Status status = recording.read(
      1, recording.message_count() + 1, [&](std::int64_t, const RecordedMessage& message) {
        const auto read = samples.value().read<wire::ContactReport>(message);
        if (!read) return true;  // of another topic: go on with the next message
        const wire::ContactReport& report = *read;
        const auto answer = static_cast<AnswerStatus>(report.status);
        Pair& pair = pairs[{report.body_a, report.body_b}];
        ++pair.answers;
        if (is_certified(answer)) ++pair.certified;
        if (answer == AnswerStatus::kFree)
          pair.nearest_m = std::min(pair.nearest_m, report.clearance_m);
        if (report.pair_count > 0 && pair.touched_s < 0)
          pair.touched_s = static_cast<double>(message.source_ns - recording.begin_ns()) * 1e-9;
        return true;
      });
  if (!status.is_ok()) return std::fprintf(stderr, "%s\n", status.message().c_str()), 1;

  for (const auto& [names, pair] : pairs) {
    std::printf("%s and %s: %d answers, %d certified, ", names.first.c_str(), names.second.c_str(),
                pair.answers, pair.certified);
    if (pair.touched_s >= 0)
      std::printf("first touched after %.3f s\n", pair.touched_s);
    else
      std::printf("no contact seen, least certified clearance %.2f m\n", pair.nearest_m);
  }
  if (std::fflush(stdout) != 0) return std::perror("standard output"), 1;  // a full disk, say
}
