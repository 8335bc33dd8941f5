// SPDX-License-Identifier: Apache-2.0
#include <csignal>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "measures.hpp"

namespace nearmesh::test {
namespace {

using nlohmann::json;

constexpr int kLightProcesses = 4;
constexpr double kReadyDeadline_s = 120;
constexpr double kRowsPerSecond = 2;  // of the trajectory: 80 m a row, 16 km over the terrain
// Peers in one place start where the flight is low: at 0.3 of the trajectory.
constexpr int kOnePlace = 1'000'000, kOnePlaceFirst = 300'000;

struct Row {
  const char* kind = "";
  int peers = 0;
  bool together = false;  ///< all in one place at one time: the most that they could share
  double seconds = 0, ready_s = 0;
  std::uint64_t answers = 0, certified = 0, requests = 0, batches = 0, batch_bytes = 0;
  std::uint64_t flight_bytes = 0, repeated_bytes = 0;
  Spent before, ready, after;  ///< of the publisher: alone, with all peers ready, at the end
  Lan::Counters wire_ready, wire_after;
};

void fly_light(const MeasureOptions& options, const Exercise& exercise, const Lan& lan,
               const Folder& folder, const Process& publisher, Row& row) {
  std::vector<std::unique_ptr<Process>> processes;
  {
    const Lan::Visit visit = lan.visit(1);
    for (int i = 0; i < kLightProcesses; ++i) {
      const int first = row.peers * i / kLightProcesses;
      processes.push_back(std::make_unique<Process>(
          folder, "nearmesh-network-peers",
          std::vector<std::string>{folder.file("flight1.csv"), "--peers",
                                   std::to_string(row.peers * (i + 1) / kLightProcesses - first),
                                   "--first", std::to_string(row.together ? kOnePlaceFirst : first),
                                   "--of", std::to_string(row.together ? kOnePlace : row.peers),
                                   "--apart", row.together ? "0" : "5", "--rate",
                                   std::to_string(options.rate_hz), "--domain",
                                   std::to_string(exercise.domain)}));
    }
  }
  const Stopwatch watch;
  for (const auto& process : processes)
    if (!await([&] { return process->is_over() || process->out().find("ready") == 0; },
               kReadyDeadline_s) ||
        process->is_over())
      throw std::runtime_error("light peers: " + process->err());
  row.ready_s = watch.seconds();
  row.ready = spent_by(publisher);
  row.wire_ready = lan.counters(0);
  const Stopwatch flight;
  pause(options.seconds);
  row.after = spent_by(publisher);
  row.wire_after = lan.counters(0);
  row.seconds = flight.seconds();
  for (const auto& process : processes) process->signal(SIGINT);
  for (const auto& process : processes) {
    if (process->wait() != 0) throw std::runtime_error("light peers: " + process->err());
    const json said = json::parse(lines_of(process->out()).at(1));
    row.answers += said.at("answers").get<std::uint64_t>();
    row.certified += said.at("certified").get<std::uint64_t>();
    row.requests += said.at("requests").get<std::uint64_t>();
    row.batches += said.at("batches").get<std::uint64_t>();
    row.batch_bytes += said.at("batch_bytes").get<std::uint64_t>();
    row.flight_bytes += said.at("flight_bytes").get<std::uint64_t>();
    row.repeated_bytes += said.at("repeated_bytes").get<std::uint64_t>();
  }
}

// Each with a body of its own, and the poses of all of them on the network.
void fly_programs(const MeasureOptions& options, const Exercise& exercise, const Lan& lan,
                  const Folder& folder, const Process& publisher, Row& row) {
  std::vector<std::unique_ptr<Process>> peers;
  const Stopwatch watch;
  row.ready = row.before;
  row.wire_ready = lan.counters(0);
  for (int i = 0; i < row.peers; ++i) {
    const std::string name = "peer" + std::to_string(i);
    folder.write(name + ".yaml",
                 "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n  - "
                 "{name: " +
                     name + ", model: aircraft}\nmoves:\n  - {body: " + name +
                     ", trajectory: flight1.csv}\npairs: [[ground, " + name +
                     "]]\nlookahead_s: 0.3\nstart_timeout_s: 100\nframe_rate_hz: " +
                     std::to_string(options.rate_hz) + "\n");
    const Lan::Visit visit = lan.visit(1);
    peers.push_back(std::make_unique<Process>(
        folder, "nearmesh-subscriber",
        std::vector<std::string>{"run", folder.file(name + ".yaml"), "--json", "--domain",
                                 std::to_string(exercise.domain)}));
  }
  const double most_s = kReadyDeadline_s + 200 / options.rate_hz;
  for (const auto& peer : peers)
    if (peer->wait(most_s) != 0) throw std::runtime_error("a peer failed: " + peer->err());
  row.seconds = watch.seconds();
  row.after = spent_by(publisher);
  row.wire_after = lan.counters(0);
  for (const auto& peer : peers) {
    const json summary = json::parse(lines_of(peer->out()).back()).at("summary");
    row.certified +=
        summary.at("free").get<std::uint64_t>() + summary.at("contact").get<std::uint64_t>();
    row.answers += summary.at("frames").get<std::uint64_t>();
    row.requests += summary.at("requests").get<std::uint64_t>();
    row.batches += summary.at("batches").get<std::uint64_t>();
    row.batch_bytes += summary.at("batch_bytes").get<std::uint64_t>();
    row.ready_s = std::max(row.ready_s, summary.at("first_certified_s").get<double>());
  }
}

}  // namespace

void measure_peers(const MeasureOptions& options, const Exercise& exercise) {
  std::FILE* out = nullptr;
  const auto open = [&](const char* name) {
    out = open_csv(options.out + name);
    std::fprintf(
        out,
        "kind,peers,rate_hz,seconds,ready_s,answers,certified,requests,batches,batch_bytes,"
        "flight_bytes,repeated_bytes,publisher_cpu_s,publisher_start_cpu_s,"
        "publisher_memory_before,publisher_memory_after,publisher_sent_bytes,"
        "publisher_received_bytes\n");
  };
  const auto measure = [&](const char* kind, int peers, bool together, auto fly) {
    const Lan lan({{}, {}});
    const Folder folder;
    write_flights(folder, exercise, 200, kRowsPerSecond);
    const auto publisher = serve(lan, folder, exercise);
    Row row{.kind = kind, .peers = peers, .together = together, .before = spent_by(*publisher)};
    fly(options, exercise, lan, folder, *publisher, row);
    const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
    std::fprintf(
        out,
        "%s,%d,%g,%.1f,%.2f,%llu,%llu,%llu,%llu,%llu,%llu,%llu,%.2f,%.2f,%llu,%llu,%llu,%llu\n",
        row.kind, row.peers, options.rate_hz, row.seconds, row.ready_s, count(row.answers),
        count(row.certified), count(row.requests), count(row.batches), count(row.batch_bytes),
        count(row.flight_bytes), count(row.repeated_bytes), row.after.cpu_s - row.ready.cpu_s,
        row.ready.cpu_s - row.before.cpu_s, count(row.before.memory_bytes),
        count(row.after.memory_bytes), count(row.wire_after.sent_bytes - row.wire_ready.sent_bytes),
        count(row.wire_after.received_bytes - row.wire_ready.received_bytes));
    std::fflush(out);
    std::fprintf(stderr, "%d peers (%s): %llu of %llu certified\n", peers, kind,
                 count(row.certified), count(row.answers));
  };
  if (!options.light.empty() || !options.together.empty()) {
    open("/peers-light.csv");
    for (const int peers : options.light) measure("light", peers, false, fly_light);
    for (const int peers : options.together) measure("together", peers, true, fly_light);
    std::fclose(out);
  }
  if (options.programs.empty()) return;
  open("/peers-programs.csv");
  for (const int peers : options.programs) measure("programs", peers, false, fly_programs);
  std::fclose(out);
}

}  // namespace nearmesh::test
