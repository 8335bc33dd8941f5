// SPDX-License-Identifier: Apache-2.0
#include "flight_summary.hpp"

#include <algorithm>
#include <cstdio>

#include "core/base/resources.hpp"

namespace nearmesh::subscriber::program {

void Timings::add(double seconds) {
  if (added_++ % one_of_ != 0) return;
  if (ms_.size() == kMost) {
    for (std::size_t i = 0; 2 * i < kMost; ++i) ms_[i] = ms_[2 * i];
    ms_.resize(kMost / 2);
    one_of_ *= 2;
  }
  ms_.push_back(seconds * 1e3);
}

double Timings::quantile(double q) const {
  if (ms_.empty()) return 0;
  std::vector<double> sorted = ms_;
  std::sort(sorted.begin(), sorted.end());
  return sorted[static_cast<std::size_t>(q * static_cast<double>(sorted.size() - 1) + 0.5)];
}

nlohmann::ordered_json to_json(Summary& s) {
  const auto phase = [](Timings& t) {
    return nlohmann::ordered_json{{"median_ms", t.quantile(0.5)}, {"p99_ms", t.quantile(0.99)}};
  };
  return {{"summary",
           {{"frames", s.frames},
            {"free", s.by_status[0]},
            {"contact", s.by_status[1]},
            {"partial", s.by_status[2]},
            {"uncertain", s.by_status[3]},
            {"contained", s.by_status[4]},
            {"put_off", s.put_off},
            {"contact_pairs", s.contact_pairs},
            {"free_by_bounds", s.free_by_bounds},
            {"unknown", s.unknown},
            {"received_bytes", s.stats.batch_bytes + s.stats.header_bytes},
            {"batch_bytes", s.stats.batch_bytes},
            {"header_bytes", s.stats.header_bytes},
            {"batches", s.stats.batches},
            {"requests", s.stats.requests},
            {"sequence_gaps", s.stats.sequence_gaps},
            {"mesh_bytes", s.stats.mesh_bytes},
            {"refine", phase(s.refine)},
            {"tree", phase(s.tree)},
            {"query", phase(s.query)},
            {"load", phase(s.load)},
            {"held_splits", s.stats.held_splits},
            {"slots", s.stats.slots},
            {"exact_faces", s.stats.exact_faces},
            {"tree_bytes", s.stats.tree_bytes},
            {"first_certified_s",
             s.first_certified_s ? nlohmann::ordered_json(*s.first_certified_s) : nullptr},
            {"seconds", s.seconds},
            {"peak_memory_bytes", peak_memory_bytes()}}}};
}
void print_text(Summary& s) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  const auto& [free, contact, partial, uncertain, contained] = s.by_status;
  std::printf("  answers       %llu free, %llu contact, %llu partial, %llu uncertain", count(free),
              count(contact), count(partial), count(uncertain));
  if (contained > 0) std::printf(", %llu contained", count(contained));
  if (s.put_off > 0) std::printf(" (%llu put off)", count(s.put_off));
  std::printf("; %llu touching face pairs\n", count(s.contact_pairs));
  if (s.free_by_bounds + s.unknown > 0)
    std::printf("  other pairs   %llu free by bounds, %llu unknown\n", count(s.free_by_bounds),
                count(s.unknown));
  std::printf(
      "  received      %llu bytes of %llu (%.2f %%): headers %llu, %llu batches %llu; %llu "
      "requests\n",
      count(s.stats.batch_bytes + s.stats.header_bytes), count(s.stats.mesh_bytes),
      s.stats.mesh_bytes > 0
          ? 100.0 * static_cast<double>(s.stats.batch_bytes + s.stats.header_bytes) /
                static_cast<double>(s.stats.mesh_bytes)
          : 0.0,
      count(s.stats.header_bytes), count(s.stats.batches), count(s.stats.batch_bytes),
      count(s.stats.requests));
  std::printf(
      "  per frame     T_R %.3f / %.3f   T_B %.3f / %.3f   T_Q %.3f / %.3f   T_L %.3f / %.3f ms "
      "(median / 99 %%)\n",
      s.refine.quantile(0.5), s.refine.quantile(0.99), s.tree.quantile(0.5), s.tree.quantile(0.99),
      s.query.quantile(0.5), s.query.quantile(0.99), s.load.quantile(0.5), s.load.quantile(0.99));
  std::printf(
      "  held          %llu splits in %llu slots, %llu exact faces, tree %.2f MB; peak memory %.0f "
      "MB\n",
      count(s.stats.held_splits), count(s.stats.slots), count(s.stats.exact_faces),
      static_cast<double>(s.stats.tree_bytes) / 1e6,
      static_cast<double>(peak_memory_bytes()) / 1e6);
  if (s.first_certified_s)
    std::printf("  first         certified answer %.3f s after the start; %llu frames in %.1f s\n",
                *s.first_certified_s, count(s.frames), s.seconds);
  else
    std::printf("  first         no certified answer; %llu frames in %.1f s\n", count(s.frames),
                s.seconds);
}
}  // namespace nearmesh::subscriber::program
