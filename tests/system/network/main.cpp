// SPDX-License-Identifier: Apache-2.0
// nearmesh-network: measures on links that it makes itself (lan.hpp). Writes CSV, one row a run.

#include <CLI/CLI.hpp>
#include <cstdio>

#include "comings.hpp"
#include "measures.hpp"
#include "soak.hpp"

namespace nearmesh::test {

namespace {

constexpr int kTerrainCells = 708;  // a million faces

unsigned long long count(std::uint64_t n) { return n; }

// A flight of the demo's on every link.
void flights(const MeasureOptions& options, const Exercise& exercise) {
  std::FILE* out = open_csv(options.out + "/flights.csv");
  std::fprintf(out,
               "mbit_per_s,loss,answers,certified,contacts,wrong,longest_lag_s,first_certified_s,"
               "batch_bytes,batches,header_bytes,requests,wire_down_bytes,wire_up_bytes\n");
  for (const double mbit : options.mbit)
    for (const double loss : options.loss) {
      const Lan lan({{}, {.mbit_per_s = mbit, .loss = loss}});
      const Folder folder;
      const auto publisher = serve(lan, folder, exercise);
      const FlightResult r = fly(lan, 1, folder, exercise, {.frames = options.frames});
      if (!r.ended)
        std::fprintf(stderr, "%g Mbit/s, loss %g: %s\n", mbit, loss, r.complaint.c_str());
      std::fprintf(out, "%g,%g,%llu,%llu,%llu,%llu,%.2f,%.3f,%llu,%llu,%llu,%llu,%llu,%llu\n", mbit,
                   loss, count(r.answers), count(r.certified), count(r.contacts), count(r.wrong),
                   r.longest_lag_s, r.first_certified_s, count(r.batch_bytes), count(r.batches),
                   count(r.header_bytes), count(r.requests), count(r.wire.received_bytes),
                   count(r.wire.sent_bytes));
      std::fflush(out);
      std::fprintf(stderr, "flight at %g Mbit/s, loss %g: %llu of %llu certified\n", mbit, loss,
                   count(r.certified), count(r.answers));
    }
  std::fclose(out);
}

// A pipe kept full on every link, and a small request that is needed now in the middle of it.
void pipes(const MeasureOptions& options, const Exercise& exercise) {
  std::FILE* out = open_csv(options.out + "/pipes.csv");
  std::fprintf(out,
               "mbit_per_s,loss,seconds,batches,batch_bytes,sample_bytes,wire_bytes,wire_packets,"
               "sent_bytes,wire_up_bytes,overtakes,overtake_median_s,overtake_worst_s\n");
  for (const double mbit : options.mbit)
    for (const double loss : options.loss) {
      const Lan lan({{}, {.mbit_per_s = mbit, .loss = loss}});
      const Folder folder;
      const auto publisher = serve(lan, folder, exercise);
      const PipeResult r = fill_pipe(lan, 1, exercise, options.seconds);
      std::fprintf(out, "%g,%g,%.2f,%llu,%llu,%llu,%llu,%llu,%llu,%llu,%zu,%.3f,%.3f\n", mbit, loss,
                   r.seconds, count(r.batches), count(r.bytes), count(r.sample_bytes),
                   count(r.wire.received_bytes), count(r.wire.received_packets),
                   count(r.publisher_sent_bytes), count(r.wire.sent_bytes), r.overtakes_s.size(),
                   r.overtakes_s.empty() ? 0 : r.overtakes_s[r.overtakes_s.size() / 2],
                   r.overtakes_s.empty() ? 0 : r.overtakes_s.back());
      std::fflush(out);
      std::fprintf(stderr, "pipe at %g Mbit/s, loss %g: %.3f Mbit/s of batches\n", mbit, loss,
                   8e-6 * static_cast<double>(r.bytes) / r.seconds);
    }
  std::fclose(out);
}

struct LongRuns {
  SoakOptions soak;
  int times = 100;
  CLI::App *soak_command = nullptr, *joins_command = nullptr, *outages_command = nullptr;
};

void add_long_runs(CLI::App& app, LongRuns& runs, unsigned& domain) {
  const auto add = [&](const char* name, const char* what) {
    CLI::App* command = app.add_subcommand(name, what);
    command->add_option("-o,--out", runs.soak.out, "Folder for the CSV")
        ->required()
        ->check(CLI::ExistingDirectory);
    command->add_option("--seed", runs.soak.seed, "Of all that is drawn")->capture_default_str();
    command->add_option("--domain", domain, "DDS domain")->capture_default_str();
    return command;
  };
  const auto add_loss = [&](CLI::App* command) {
    command->add_option("--loss", runs.soak.loss, "Share of packets lost on each peer's link")
        ->check(CLI::Range(0.0, 0.5))
        ->capture_default_str();
  };
  const auto add_times = [&](CLI::App* command, const char* what) {
    command->add_option("--times", runs.times, what)
        ->check(CLI::Range(1, 100'000))
        ->capture_default_str();
  };
  runs.soak_command = add(
      "soak", "Peers join, leave and crash at random: soak.csv, soak-memory.csv, soak-totals.csv");
  add_loss(runs.soak_command);
  runs.soak_command->add_option("--minutes", runs.soak.minutes, "How long")
      ->check(CLI::Range(0.5, 1440.0))
      ->capture_default_str();
  runs.soak_command
      ->add_option("--peers", runs.soak.peers, "At most at a time; a fifth of them stays")
      ->check(CLI::Range(1, 200))
      ->capture_default_str();
  runs.soak_command
      ->add_option("--transport", runs.soak.transport,
                   "lan: a host for each peer; same-host: one for all, by shared memory, no losses")
      ->check(CLI::IsMember({"lan", "same-host"}))
      ->capture_default_str();
  runs.joins_command = add("joins", "One peer after the other joins late: joins.csv");
  add_loss(runs.joins_command);
  add_times(runs.joins_command, "How many peers");
  runs.outages_command = add("outages", "Links go down and come up: outages.csv");
  add_times(runs.outages_command, "How often, for each of both ends");
}

/// Out: false when something did not go as it should.
bool run_long(const LongRuns& runs, const Exercise& exercise) {
  const SoakOptions& options = runs.soak;
  if (runs.soak_command->parsed()) return soak(options, exercise);
  if (runs.joins_command->parsed())
    return measure_joins(options.out, exercise, runs.times, options.loss, options.seed);
  if (runs.outages_command->parsed())
    return measure_outages(options.out, exercise, runs.times, options.seed);
  return true;
}

}  // namespace
}  // namespace nearmesh::test

int main(int argc, char** argv) {
  CLI::App app{"Measures nearmesh on links with rates and losses, in network namespaces",
               "nearmesh-network"};
  app.require_subcommand(1);
  using namespace nearmesh::test;
  MeasureOptions options;
  const auto add = [&](const char* name, const char* what) {
    CLI::App* command = app.add_subcommand(name, what);
    command->add_option("-o,--out", options.out, "Folder for the CSV")
        ->required()
        ->check(CLI::ExistingDirectory);
    command->add_option("--mbit", options.mbit, "Rates")->delimiter(',')->capture_default_str();
    command->add_option("--loss", options.loss, "Shares of packets lost")
        ->delimiter(',')
        ->capture_default_str();
    command->add_option("--domain", options.domain, "DDS domain")->capture_default_str();
    return command;
  };
  CLI::App* flights_command = add("flights", "A touching flight on every link: flights.csv");
  flights_command->add_option("--frames", options.frames, "Frames, 20 a second")
      ->capture_default_str();
  CLI::App* pipes_command = add("pipes", "A full pipe on every link: pipes.csv");
  pipes_command->add_option("--seconds", options.seconds, "Time on each link")
      ->capture_default_str();
  std::map<std::string, nearmesh::wire::Transport> presets;
  for (const auto preset : nearmesh::wire::kTransports) presets[to_string(preset)] = preset;
  for (CLI::App* command : {flights_command, pipes_command})
    command->add_option("--transport", options.transport, "Preset of both programs")
        ->transform(CLI::CheckedTransformer(presets));
  CLI::App* poses_command = add(
      "poses", "The chart's terrain poses on every rate, beside its simulated clock: poses.csv");
  CLI::App* cold_command = add("cold", "Peers that join where bodies are in contact: cold.csv");
  cold_command->add_option("--scenes", options.scenes, "Of the chart")->delimiter(',');
  cold_command->add_option("--round-trips", options.round_trips_s, "Seconds, beside the rate's")
      ->delimiter(',');
  CLI::App* peers_command =
      add("peers", "More and more peers of one publisher: peers-light.csv, peers-programs.csv");
  const auto add_numbers = [&](const char* name, std::vector<int>& numbers, const char* what) {
    peers_command->add_option(name, numbers, what)->delimiter(',');
  };
  add_numbers("--light", options.light, "Numbers of light peers, in 4 processes");
  add_numbers("--together", options.together, "Numbers of light peers that fly in one place");
  add_numbers("--programs", options.programs, "Numbers of nearmesh-subscribers");
  peers_command->add_option("--rate", options.rate_hz, "Frames a second")->capture_default_str();
  peers_command
      ->add_option("--seconds", options.seconds,
                   "Of each flight of light peers; programs fly 200 frames")
      ->capture_default_str();
  LongRuns long_runs;
  add_long_runs(app, long_runs, options.domain);
  CLI::App* faults_command =
      add("faults", "Healthy peers beside one bad peer of each kind: faults.csv");
  faults_command->add_option("--faults", options.faults, "Only these")->delimiter(',');
  faults_command->add_option("--rounds", options.rounds, "Times with and without each")
      ->capture_default_str();
  faults_command->add_option("--seconds", options.seconds, "Of each time")->capture_default_str();
  faults_command->add_flag("--secured", options.secured, "On a bus with DDS Security");
  CLI::App* restarts_command = add(
      "restarts", "The publisher killed and started again, and one of two killed: restarts.csv");
  restarts_command->add_option("--rounds", options.rounds, "Of each")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    if (const std::string why = Lan::why_not_permitted(); !why.empty())
      throw std::runtime_error("no network can be made: " + why);
    if (poses_command->parsed() || cold_command->parsed()) {
      (poses_command->parsed() ? measure_poses : measure_cold_starts)(options);
      return 0;
    }
    const Exercise exercise{{model_file("terrain", kTerrainCells), model_file("aircraft", 600)},
                            kTerrainCells,
                            options.domain,
                            options.transport};
    if (flights_command->parsed()) flights(options, exercise);
    if (pipes_command->parsed()) pipes(options, exercise);
    if (peers_command->parsed()) measure_peers(options, exercise);
    if (!run_long(long_runs, exercise)) {
      std::fprintf(stderr, "nearmesh-network: not all went as it should\n");
      return 1;
    }
    if (faults_command->parsed()) measure_faults(options, exercise);
    if (restarts_command->parsed()) measure_restarts(options, exercise);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-network: %s\n", error.what());
    return 1;
  }
}
