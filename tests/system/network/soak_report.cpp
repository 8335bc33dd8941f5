// SPDX-License-Identifier: Apache-2.0
#include "soak_report.hpp"

#include <algorithm>
#include <numeric>

namespace nearmesh::test {
namespace {

constexpr double kMostWarmUp_s = 300;

unsigned long long count(std::uint64_t n) { return n; }

double mean_of(const std::vector<double>& values, std::size_t begin, std::size_t end) {
  return std::accumulate(values.begin() + static_cast<std::ptrdiff_t>(begin),
                         values.begin() + static_cast<std::ptrdiff_t>(end), 0.0) /
         static_cast<double>(end - begin);
}

void write_samples(const std::string& path, const std::vector<SoakSample>& samples) {
  std::FILE* out = open_csv(path);
  std::fprintf(out, "seconds,peers,joined,landed,left,crashed,failed");
  for (const char* who : {"publisher", "resident"})
    std::fprintf(out, ",%s_rss_kb,%s_pss_kb,%s_heap_kb,%s_threads,%s_descriptors", who, who, who,
                 who, who);
  std::fprintf(out, ",shm_files,shm_bytes\n");
  for (const SoakSample& s : samples) {
    std::fprintf(out, "%.0f,%d,%llu,%llu,%llu,%llu,%llu", s.seconds, s.present,
                 count(s.counts.joined), count(s.counts.ended[0]), count(s.counts.ended[1]),
                 count(s.counts.ended[2]), count(s.counts.failed));
    for (const Holding& h : {s.publisher, s.resident})
      std::fprintf(out, ",%.0f,%.0f,%.0f,%d,%d", h.rss_kb, h.pss_kb, h.heap_kb, h.threads,
                   h.descriptors);
    std::fprintf(out, ",%zu,%llu\n", s.shared.of_fast_dds + s.shared.others.size(),
                 count(s.shared.bytes));
  }
  std::fclose(out);
}

}  // namespace

void show(const SoakSample& s) {
  std::fprintf(stderr,
               "%4.0f s: %d peers; %llu joined, %llu landed, %llu left, %llu crashed, %llu failed; "
               "publisher %.1f MB, %d threads, %d descriptors; residents %.1f MB; %zu files in "
               "/dev/shm; %llu answers checked, %llu wrong\n",
               s.seconds, s.present, count(s.counts.joined), count(s.counts.ended[0]),
               count(s.counts.ended[1]), count(s.counts.ended[2]), count(s.counts.failed),
               s.publisher.rss_kb / 1024, s.publisher.threads, s.publisher.descriptors,
               s.resident.rss_kb / 1024, s.shared.of_fast_dds + s.shared.others.size(),
               count(s.answers), count(s.wrong));
}

std::vector<Growth> growth_of(const std::vector<SoakSample>& samples) {
  if (samples.empty()) return {};
  const double warm_up_s = std::min(kMostWarmUp_s, samples.back().seconds / 3);
  std::vector<Growth> all;
  for (const auto& [who, holding] : {std::pair("publisher", &SoakSample::publisher),
                                     std::pair("peer that stays", &SoakSample::resident)})
    for (const auto& [what, member] :
         {std::pair("resident", &Holding::rss_kb), std::pair("proportional", &Holding::pss_kb),
          std::pair("heap", &Holding::heap_kb)}) {
      std::vector<double> seconds, values;
      for (const SoakSample& s : samples) {
        if (s.seconds < warm_up_s) continue;
        seconds.push_back(s.seconds);
        values.push_back(s.*holding.*member);
      }
      const std::size_t n = values.size(), fifth = (n + 4) / 5;
      all.push_back({std::string(who) + " " + what, mean_of(values, 0, fifth),
                     mean_of(values, n - fifth, n), slope_of(seconds, values)});
    }
  return all;
}

void write_soak(const SoakOptions& options, const std::vector<SoakSample>& samples,
                const SoakSample& end, std::vector<double> joins_s, const Warnings& warnings) {
  write_samples(options.out + "/soak.csv", samples);
  std::FILE* memory = open_csv(options.out + "/soak-memory.csv");
  std::fprintf(memory, "kind,first_kb,last_kb,kb_per_minute,error\n");
  for (const Growth& g : growth_of(samples))
    std::fprintf(memory, "%s,%.0f,%.0f,%.1f,%.1f\n", g.kind.c_str(), g.first, g.last,
                 g.slope.per_minute, g.slope.error);
  std::fclose(memory);

  std::sort(joins_s.begin(), joins_s.end());
  const auto join_s = [&](double share) {
    if (joins_s.empty()) return 0.0;
    return joins_s[static_cast<std::size_t>(share * static_cast<double>(joins_s.size() - 1))];
  };
  std::uint64_t warned = 0;
  for (const auto& [kind, times] : warnings) warned += times;
  std::FILE* totals = open_csv(options.out + "/soak-totals.csv");
  std::fprintf(totals,
               "kind,minutes,seed,peers,loss,rate_hz,joined,landed,left,crashed,failed,answers,"
               "certified,wrong,join_median_s,join_p95_s,join_worst_s,warnings,shm_files,shm_bytes,"
               "shm_files_of_others\n");
  std::fprintf(totals,
               "%s,%g,%llu,%d,%g,%g,%llu,%llu,%llu,%llu,%llu,%llu,%llu,%llu,%.2f,%.2f,%.2f,%llu,"
               "%zu,%llu,%zu\n",
               options.transport.c_str(), options.minutes, count(options.seed), options.peers,
               options.transport == "lan" ? options.loss : 0, options.rate_hz,
               count(end.counts.joined), count(end.counts.ended[0]), count(end.counts.ended[1]),
               count(end.counts.ended[2]), count(end.counts.failed), count(end.answers),
               count(end.certified), count(end.wrong), join_s(0.5), join_s(0.95), join_s(1),
               count(warned), end.shared.of_fast_dds, count(end.shared.bytes),
               end.shared.others.size());
  std::fclose(totals);
}

}  // namespace nearmesh::test
