// SPDX-License-Identifier: Apache-2.0
#pragma once
// The transport of a self-test: bytes to another process and back, reliable or best effort. What
// others ask to have echoed is sent back by poll() itself.

#include <memory>
#include <string>
#include <vector>

#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// Threads: one at a time.
class DdsEcho {
 public:
  /// Errors: kInvalidArgument naming the option; kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<DdsEcho>> create(
      const wire::TransportOptions& transport);
  ~DdsEcho();

  [[nodiscard]] wire::SessionId own_id() const;
  /// Where this process is listened to: "UDPv4:[127.0.0.1]:7411".
  [[nodiscard]] std::vector<std::string> locators() const;
  /// Sends. Best effort: at most once, of at most one datagram; else repaired until it arrives.
  /// Out: false when it could not be taken now. Bytes as wire::check wants them.
  [[nodiscard]] bool send(const wire::Echo& echo, bool best_effort);
  /// Waits until something comes or the time is over; sends back what is not a reply. Out: all that
  /// came, others' requests included.
  [[nodiscard]] std::vector<wire::Echo> poll(double seconds);
  /// Is another process matched in both directions, by both kinds?
  [[nodiscard]] bool is_matched() const;
  [[nodiscard]] std::vector<std::string> take_complaints();

 private:
  class Impl;
  explicit DdsEcho(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber
