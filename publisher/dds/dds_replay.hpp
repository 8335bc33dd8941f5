// SPDX-License-Identifier: Apache-2.0
#pragma once
// A replay's outlet over Fast DDS: one participant, a writer for each recorded stream with its
// topic's QoS and its partition, a reader of subscriptions, and a writer for each live peer that is
// answered. No Fast DDS is seen here.

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "nearmesh/idl/dds/transport_options.hpp"
#include "publisher/replay/replay.hpp"

namespace nearmesh::publisher {

/// Threads: one, from create to destruction; wait() is woken by threads of Fast DDS.
class DdsReplay final : public ReplayOutlet {
 public:
  /// All endpoints are made at once, so that who listens has found them before the first sample.
  /// Errors: kInvalidArgument naming the option; kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<DdsReplay>> create(
      const wire::TransportOptions& transport, const std::vector<ReplayStream>& streams,
      const wire::TopicNames& names);
  ~DdsReplay() override;

  /// Tries for two seconds where a writer's history is full.
  bool publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) override;
  void withdraw(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) override;
  /// After the process was stopped for so long that others dropped it.
  [[nodiscard]] bool take_restart() override;
  [[nodiscard]] Inbox take() override;
  [[nodiscard]] bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) override;
  void wait(double seconds) override;
  [[nodiscard]] std::vector<std::string> take_complaints() override;
  /// kConflict once this program's own identity does not count any more: then it hears nobody.
  [[nodiscard]] Status identity() const;

 private:
  class Impl;
  explicit DdsReplay(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::publisher
