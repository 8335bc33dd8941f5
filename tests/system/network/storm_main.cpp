// SPDX-License-Identifier: Apache-2.0
// nearmesh-storm: hostile packets at length against the real programs, in a network namespace. Needs root.
//   nearmesh-storm --packets 1000000 --rate 4000 [--secured] [--seed 1]

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "storm.hpp"

namespace {

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
  app.add_flag("--secured", options.secured, "with DDS Security; then without the simulator");
  app.add_option("--seed", options.seed, "what is sent follows from it and from what was captured")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  options.first = {deadly_packet()};
  constexpr int kTerrainCells = 256;
  try {
    const StormResult result = weather_storm(
        {{model_file("terrain", kTerrainCells), model_file("aircraft", 600)}, kTerrainCells},
        options);
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
    return result.ended.empty() && result.spins.empty() && result.deaf.empty() && result.wrong == 0
               ? 0
               : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-storm: %s\n", error.what());
    return 2;
  }
}
