// SPDX-License-Identifier: Apache-2.0
#pragma once
// Looks at a bus without taking part: who publishes what, what each process says of itself, and what is refused.

#include <memory>
#include <string>
#include <vector>

#include "nearmesh/wire/messages.hpp"
#include "nearmesh/wire/transport_options.hpp"

namespace nearmesh::subscriber {

/// What is known now. Lists are in the order of session ids; processes that left, or whose lease is over, are not in them.
struct BusView {
  std::vector<wire::Hello> publishers;
  std::vector<wire::ProcessStatus> processes;
  /// Seen from here, one line each, in the order in which they were noticed: other wire versions and types, incompatible
  /// QoS, malformed samples, one model name with two contents, publishers that were matched but are not heard.
  std::vector<std::string> refusals;
};

/// Threads: one at a time.
class DdsMonitor {
 public:
  /// Errors: kInvalidArgument naming the option; kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<DdsMonitor>> create(
      const wire::TransportOptions& transport);
  ~DdsMonitor();

  /// Takes in what comes, and returns when something came or the time is over.
  void listen(double seconds);
  [[nodiscard]] BusView view() const;

 private:
  class Impl;
  explicit DdsMonitor(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber
