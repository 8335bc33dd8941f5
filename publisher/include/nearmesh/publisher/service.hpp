// SPDX-License-Identifier: Apache-2.0
#pragma once
// The publisher service: answers the region subscriptions of any number of peers from model files (or, in a
// replay, from what was recorded of them).
// Takes RegionSubscription, gives SplitBatchMessage, through a Channel; knows nothing of DDS.
// It remembers no peer's state of refinement: a request names the peer's own frontier, so a batch that was lost is simply
// asked for again. What it keeps of a peer is its pace and the batches that wait for it, both bounded: at most max_queued_bytes
// and one answer more (16,384 splits), and the window. The channel bounds how many peers there are.
// Source: the paper, section 3.3 (Server Collect VSplits).

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/publisher/channel.hpp"
#include "nearmesh/publisher/pacing.hpp"
#include "nearmesh/wire/status_keeper.hpp"

namespace nearmesh::publisher {

struct ServiceOptions {
  std::size_t max_queued_bytes =
      1 << 20;  ///< batches waiting for one peer; further requests are refused
  std::uint32_t max_window_bytes = 256 * 1024;  ///< cap on what a peer may have under way
  PacingOptions pacing;
};

struct ServiceStats {
  std::uint64_t requests = 0, refused = 0, batches = 0, bytes = 0, peers = 0;
};

class Service {
 public:
  /// The channel must outlive the service.
  Service(Channel& channel, wire::SessionId session, ServiceOptions options = {});

  /// Serves a model under a name unique to this publisher. Errors: kInvalidArgument (name), kConflict (name taken).
  [[nodiscard]] Status add_model(const std::string& name, ModelFile file);
  /// What answers requests for a model: encoded batches, none where nothing is to be sent. A status that is not ok refuses.
  using Answerer =
      std::function<Result<std::vector<std::vector<std::uint8_t>>>(const RegionRequest&)>;
  /// Requests for this content are answered so; it is announced elsewhere.
  void add_answerer(std::uint64_t content_hash, Answerer answerer);
  /// Announces all models that were added by add_model(); call once they are.
  void announce();
  /// Takes what arrived and sends what credit allows. Never blocks. `now_s` is any steady clock.
  /// Returns one line for each request refused, and for each complaint of the channel, for the log.
  std::vector<std::string> step(double now_s);

  [[nodiscard]] const ServiceStats& stats() const { return stats_; }
  /// As of the last full second of step().
  [[nodiscard]] const wire::ProcessStatus& status() const { return status_; }

 private:
  struct Model {
    std::string name;
    ModelFile file;
  };
  struct Waiting {
    wire::SplitBatchMessage message;
    std::uint8_t priority = 0;
  };
  struct Peer {
    explicit Peer(const PacingOptions& options) : pacing(options) {}
    std::deque<Waiting> queue;  // by priority, then arrival
    std::size_t queued_bytes = 0;
    Pacing pacing;
    std::uint32_t next_sequence = 1;
    std::uint32_t last_request = 0;
  };

  [[nodiscard]] static Result<std::vector<std::vector<std::uint8_t>>> answer(
      ModelFile& file, const RegionRequest& request);
  void enqueue(Peer& peer, const wire::RegionSubscription& subscription,
               std::vector<std::vector<std::uint8_t>> batches, bool refused);
  bool send_next(wire::SessionId id, Peer& peer, double now_s);
  void tell_status(double now_s);

  Channel& channel_;
  const wire::SessionId session_;
  const ServiceOptions options_;
  std::map<std::uint64_t, std::unique_ptr<Model>> models_;  // by content hash
  std::map<std::uint64_t, Answerer> answerers_;             // of the same, and others
  std::map<wire::SessionId, Peer> peers_;
  ServiceStats stats_;
  std::optional<double> began_s_;
  wire::StatusKeeper keeper_;
  wire::ProcessStatus status_;
};

}  // namespace nearmesh::publisher
