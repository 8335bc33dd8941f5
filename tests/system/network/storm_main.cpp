// SPDX-License-Identifier: Apache-2.0
// nearmesh-storm: hostile packets at length against the real programs, in a network namespace.
// Needs root.
//   nearmesh-storm --packets 1000000 --rate 4000 [--secured] [--seed 1]
// Exit code 0: all programs went on, and heard each other, and ended in time.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "storm.hpp"

namespace {

/// So long at most a program takes to end, and a peer is without a certified answer. Of a machine
/// that does nothing else: its load is printed beside.
constexpr double kPromised_s = 2;

void print(const char* what, const std::vector<std::string>& names) {
  std::printf("%s: %zu", what, names.size());
  for (const std::string& name : names) std::printf(", %s", name.c_str());
  std::printf("\n");
}

}  // namespace

int main(int argc, char** argv) {
  using namespace nearmesh::test;
  CLI::App app("Hostile packets against publisher, peers, recorder and simulator.");
  StormOptions options;
  app.add_option("--packets", options.packets, "how many")->capture_default_str();
  app.add_option("--rate", options.packets_per_s, "packets a second at most")
      ->capture_default_str();
  app.add_flag("--secured", options.secured, "with DDS Security");
  app.add_option("--seed", options.seed, "what is sent follows from it and from what was captured")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  options.first = {deadly_packet()};
  constexpr int kTerrainCells = 256;
  double load_before = 0, load_after = 0;
  try {
    static_cast<void>(::getloadavg(&load_before, 1));
    const StormResult result = weather_storm(
        {{model_file("terrain", kTerrainCells), model_file("aircraft", 600)}, kTerrainCells},
        options);
    static_cast<void>(::getloadavg(&load_after, 1));
    std::printf("load: %.1f before, %.1f after\n", load_before, load_after);
    std::printf("packets: %llu sent, from %llu captured\n",
                static_cast<unsigned long long>(result.sent),
                static_cast<unsigned long long>(result.captured));
    print("programs that ended", result.ended);
    print("threads that spin", result.spins);
    print("deaf streams", result.deaf);
    std::printf("slowest end: %.2f s\n", result.slowest_end_s);
    std::printf("answers: %llu, certified %llu, wrong %llu, longest pause %.2f s\n",
                static_cast<unsigned long long>(result.answers),
                static_cast<unsigned long long>(result.certified),
                static_cast<unsigned long long>(result.wrong), result.longest_pause_s);
    if (!result.complaint.empty()) std::printf("%s\n", result.complaint.c_str());
    const bool is_weathered = result.ended.empty() && result.spins.empty() && result.deaf.empty() &&
                              result.wrong == 0 && result.certified > 0;
    const bool is_in_time =
        result.slowest_end_s <= kPromised_s && result.longest_pause_s <= kPromised_s;
    return is_weathered && is_in_time ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-storm: %s\n", error.what());
    return 2;
  }
}
