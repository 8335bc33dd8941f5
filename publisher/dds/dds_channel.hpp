// SPDX-License-Identifier: Apache-2.0
#pragma once
// The publisher's channel over Fast DDS: one participant, one reader of subscriptions, and a writer
// in a partition of its own for each peer, so that a slow or frozen peer stalls nobody else.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "publisher/serve/channel.hpp"

namespace nearmesh::publisher {

struct DdsChannelOptions {
  wire::TransportOptions transport;
  std::size_t max_peers = 1000;  ///< further ones are refused with a complaint
  /// Pace of mesh headers, all readers together; keep it below the link's rate. [100'000,
  /// 1'000'000'000]
  std::int32_t header_bytes_per_s = 4'000'000;
};

/// Threads: one, from create to destruction; wait() is woken by threads of Fast DDS.
class DdsChannel final : public Channel {
 public:
  /// Errors: kInvalidArgument naming the option; kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<DdsChannel>> create(const DdsChannelOptions& options);
  ~DdsChannel() override;

  void announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers) override;
  /// Without subscriptions for the session of another publisher than the announced one. Forgets the
  /// writers of lost peers too: a process that was only stopped comes back as a new peer.
  [[nodiscard]] Inbox take() override;
  /// False also until the peer's reader is matched (milliseconds after its first subscription),
  /// when 256 batches are unacknowledged, and for a peer that is unknown or lost. A batch that
  /// check() refuses is dropped with a complaint and true: trying again would not help.
  [[nodiscard]] bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) override;
  [[nodiscard]] std::string name_of(wire::SessionId peer) const override;
  void wait(double seconds) override;
  /// Dropped when it cannot be taken at once: the next one tells more.
  void tell(wire::ProcessStatus& status) override;
  [[nodiscard]] std::vector<std::string> take_complaints() override;
  /// Not ok once this program's identity was revoked or has expired; then nobody is served any
  /// more.
  [[nodiscard]] Status identity() const;

 private:
  class Impl;
  explicit DdsChannel(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::publisher
