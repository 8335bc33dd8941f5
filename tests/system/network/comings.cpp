// SPDX-License-Identifier: Apache-2.0
#include "comings.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <thread>

#include "dice.hpp"
#include "probe_peer.hpp"
#include "soak_peers.hpp"

namespace nearmesh::test {
namespace {

constexpr double kRate_hz = 5;
constexpr double kBackDeadline_s = 60;
constexpr std::uint64_t kRowsOfRoute = 800;

/// Progress of what takes minutes; tests are silent.
void say(bool aloud, std::size_t done, std::size_t of, const char* what) {
  if (aloud) std::fprintf(stderr, "%zu of %zu %s\n", done, of, what);
}

Joins join(const Exercise& exercise, int times, double loss, std::uint64_t seed, bool aloud) {
  const Lan lan({{}, {.loss = loss}, {.loss = loss}});
  const Folder folder;
  const auto publisher = serve(lan, folder, exercise);
  const Routes routes(folder, exercise);
  const std::vector<std::string> bus{"--domain", std::to_string(exercise.domain)};
  AnswerCheck judge(exercise);
  Joins joins;
  const auto start = [&](std::size_t host, const LifePlan& plan) {
    const Lan::Visit visit = lan.visit(host);
    return std::make_unique<Life>(plan, bus, routes, kRate_hz);
  };
  const auto resident = start(1, {.name = "resident", .life_s = 3600});
  Dice dice(seed);
  for (int i = 0; i < times; ++i) {
    const auto late = start(2, {.name = "late" + std::to_string(i),
                                .other = "resident",
                                .ending = Ending::kLands,
                                .life_s = 0,
                                .flight = dice.below(2),
                                .from_row = dice.below(kRowsOfRoute)});
    while (!late->is_over()) pause(0.005);
    const std::string fault = late->fault();
    joins.joined += fault.empty() ? 1 : 0;
    if (!fault.empty()) joins.faults.push_back(fault);
    judge.take(late->answers());
    judge.step();
    if ((i + 1) % 10 == 0)
      say(aloud, static_cast<std::size_t>(i) + 1, static_cast<std::size_t>(times), "joined");
  }
  judge.finish();
  joins.answers = judge.answers;
  joins.certified = judge.certified;
  joins.wrong = judge.wrong;
  joins.seconds = judge.joins_s;
  std::sort(joins.seconds.begin(), joins.seconds.end());
  joins.faults.insert(joins.faults.end(), judge.faults.begin(), judge.faults.end());
  return joins;
}

Outages outages(const Exercise& exercise, const std::vector<double>& down_s, bool aloud) {
  const Lan lan({{}, {}});
  const Folder folder;
  const auto publisher = serve(lan, folder, exercise);
  ProbePeer peer(lan, 1, exercise);
  std::uint32_t place = 0;
  if (peer.certify_at(place++, kBackDeadline_s) < 0)
    throw std::runtime_error("the peer was never served: " + peer.reason());
  Outages found;
  for (const double seconds : down_s)
    for (const bool of_publisher : {false, true}) {
      const std::size_t host = of_publisher ? 0 : 1;
      lan.set_up(host, false);
      // Nothing can come, so what is certified now did not need it.
      if (peer.certify_at(place++, seconds) >= 0) ++found.certified_while_down;
      lan.set_up(host, true);
      found.all.push_back({of_publisher, seconds, peer.certify_at(place++, kBackDeadline_s)});
      say(aloud, found.all.size(), 2 * down_s.size(), "outages");
    }
  found.wrong = peer.wrong();
  return found;
}

}  // namespace

Joins join_in_a_row(const Exercise& exercise, int times, double loss, std::uint64_t seed) {
  return join(exercise, times, loss, seed, false);
}

Outages take_links_down(const Exercise& exercise, const std::vector<double>& down_s) {
  return outages(exercise, down_s, false);
}

bool measure_joins(const std::string& out, const Exercise& exercise, int times, double loss,
                   std::uint64_t seed) {
  const Joins joins = join(exercise, times, loss, seed, true);
  for (const std::string& fault : joins.faults) std::fprintf(stderr, "%s\n", fault.c_str());
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  const auto at = [&](double share) {
    if (joins.seconds.empty()) return -1.0;
    return joins
        .seconds[static_cast<std::size_t>(share * static_cast<double>(joins.seconds.size() - 1))];
  };
  std::FILE* file = open_csv(out + "/joins.csv");
  std::fprintf(file, "times,loss,joined,answers,certified,wrong,median_s,p95_s,worst_s\n");
  std::fprintf(file, "%d,%g,%llu,%llu,%llu,%llu,%.3f,%.3f,%.3f\n", times, loss, count(joins.joined),
               count(joins.answers), count(joins.certified), count(joins.wrong), at(0.5), at(0.95),
               at(1));
  std::fclose(file);
  std::printf(
      "%llu of %d joined, %llu answers, %llu certified, %llu wrong; %.2f s (median), %.2f s "
      "(worst)\n",
      count(joins.joined), times, count(joins.answers), count(joins.certified), count(joins.wrong),
      at(0.5), at(1));
  return joins.faults.empty() && joins.answers > 0;
}

bool measure_outages(const std::string& out, const Exercise& exercise, int times,
                     std::uint64_t seed) {
  Dice dice(seed);
  std::vector<double> down_s;
  // Half of them about as long as the 3 s of silence that count as a loss, where one side may have
  // lost the other and not been lost.
  for (int i = 0; i < times; ++i)
    down_s.push_back(i % 2 == 0 ? dice.between(2, 4) : dice.between(0.2, 8));
  const Outages found = outages(exercise, down_s, true);
  std::FILE* file = open_csv(out + "/outages.csv");
  std::fprintf(file, "kind,down_s,back_s\n");
  bool all_back = true;
  for (const Outage& o : found.all) {
    std::fprintf(file, "%s,%.2f,%.2f\n", o.of_publisher ? "publisher" : "peer", o.down_s, o.back_s);
    all_back = all_back && o.back_s >= 0;
  }
  std::fclose(file);
  std::printf("%zu outages, wrong %llu, %s\n", found.all.size(),
              static_cast<unsigned long long>(found.wrong),
              all_back ? "all came back" : "not all came back");
  return all_back && found.wrong == 0;
}

}  // namespace nearmesh::test
