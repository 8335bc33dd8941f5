// SPDX-License-Identifier: Apache-2.0
#pragma once
// The real programs on a Lan, and peers inside this process that only move bytes: what the network
// tests and nearmesh-network share. Host 0 is the publisher's, host i the i-th peer's. Seconds and
// bytes.

#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/base/stopwatch.hpp"
#include "lan.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "tests/system/integration/process.hpp"

namespace nearmesh::test {

/// What runs on the lan: models and the words that put programs on one bus.
struct Exercise {
  std::vector<std::string> models;  ///< files; the first is the terrain
  int terrain_cells = 0;            ///< as it was generated with
  unsigned domain = 40;
  wire::Transport transport = wire::Transport::kLan;
  std::string interface = {};  ///< of every program; empty: all
  std::string security = {};   ///< folder of identities serve, alice and mallory; empty: none
};

/// Throws std::runtime_error.
[[nodiscard]] std::FILE* open_csv(const std::string& path);

/// A publisher on a host that is ready.
[[nodiscard]] std::unique_ptr<Process> serve(const Lan& lan, const Folder& folder,
                                             const Exercise& exercise, std::size_t host = 0);

/// What a running program has used since its start.
struct Spent {
  double cpu_s = 0;
  std::uint64_t memory_bytes = 0;  ///< resident now
};
[[nodiscard]] Spent spent_by(const Process& process);

/// flight1.csv and flight2.csv of the demo over the exercise's terrain, into the folder.
/// Throws std::runtime_error.
void write_flights(const Folder& folder, const Exercise& exercise, int frames, double rate_hz);

struct FlightOptions {
  int frames = 200;
  double rate_hz = 20;
};
struct FlightResult {
  bool ended = false;  ///< the program ended with 0
  std::string complaint;
  std::uint64_t answers = 0, certified = 0, contacts = 0, wrong = 0;
  double longest_lag_s = 0;  ///< the longest time without a certified answer after the first
  double first_certified_s = 0;
  std::uint64_t batch_bytes = 0, batches = 0, header_bytes = 0, requests = 0;
  Lan::Counters wire;  ///< of the peer's interface: from before its start to its end
};
/// A nearmesh-subscriber on a host that flies aircraft1 along the folder's flight1.csv, so many
/// rows a second. Its answers go to answers.jsonl in the folder.
[[nodiscard]] std::unique_ptr<Process> start_flight(const Lan& lan, std::size_t host,
                                                    const Folder& folder, const Exercise& exercise,
                                                    double rate_hz);
/// The answers in answers.jsonl, of a flight that ended, against the full meshes. Throws
/// std::runtime_error when they were not all checked.
[[nodiscard]] std::uint64_t count_wrong_answers(const Folder& folder, const Exercise& exercise,
                                                std::uint64_t answers);
/// One aircraft of the demo over the terrain, flown by nearmesh-subscriber on a host; every answer
/// is checked.
[[nodiscard]] FlightResult fly(const Lan& lan, std::size_t host, const Folder& folder,
                               const Exercise& exercise, const FlightOptions& options);

/// A peer that asks for splits from the roots of its models again and again and throws them away: a
/// full pipe.
class BulkPeer {
 public:
  /// On the host; waits until the headers of all models are there. Throws std::runtime_error when
  /// they do not come.
  BulkPeer(const Lan& lan, std::size_t host, const Exercise& exercise);

  /// Asks for so many splits anywhere in a model. Out: the request's number.
  std::uint32_t request(const std::string& model, std::uint8_t priority, std::uint32_t max_splits);
  struct Taken {
    std::uint64_t batches = 0, bytes = 0, sample_bytes = 0;
    std::vector<std::uint32_t> finished;  ///< requests answered in full
  };
  /// What came since the last call; waits for something up to `seconds`.
  Taken take(double seconds);

 private:
  struct Model {
    ContentHash content_hash;
    std::vector<NodeSpan> roots;
    std::int32_t grid_max = 0;
  };

  std::unique_ptr<subscriber::DdsChannel> channel_;
  wire::SessionId publisher_ = 0;
  std::map<std::string, Model> models_;
  std::uint32_t requests_ = 0;
};

struct PipeResult {
  double seconds = 0;
  std::uint64_t batches = 0, bytes = 0, sample_bytes = 0;  ///< received; sample: as DDS has them
  Lan::Counters wire;                                      ///< of the peer's interface, meanwhile
  std::uint64_t publisher_sent_bytes = 0;  ///< what the publisher put on its own, lost or not
  std::vector<double> overtakes_s;  ///< ascending: from a small request, needed now, to its answer
};
/// Keeps the pipe to a host full of detail for later (of one model), for so long, and asks for a
/// little that is needed now (of another) each second.
[[nodiscard]] PipeResult fill_pipe(const Lan& lan, std::size_t host, const Exercise& exercise,
                                   double seconds);

}  // namespace nearmesh::test
