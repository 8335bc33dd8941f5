// SPDX-License-Identifier: Apache-2.0
#pragma once
// Looks at a bus without taking part: who publishes what, what each process says of itself, and
// what is refused.

#include <memory>
#include <string>
#include <vector>

#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// Where two bodies of a peer meet, by its last answer.
struct RegionView {
  wire::ContactReport report;
  double age_s = 0;  ///< of the answer
  /// Since an answer was certified, or since the first that was heard. 0: this one is.
  double uncertain_s = 0;
};

/// The last that a peer asked for of a model.
struct RequestView {
  wire::SessionId peer = 0;
  ContentHash content_hash;
  std::uint8_t priority = 0;  ///< 0 needed now, else ahead
  std::uint32_t nodes = 0;    ///< that it named, or
  std::uint32_t pairs = 0;    ///< of bodies of this model, for which the publisher is to choose
  double age_s = 0;
};

/// What is known now. Lists are in the order of session ids; processes that left, or whose lease is
/// over, are not in them.
struct BusView {
  std::vector<wire::Hello> publishers;
  std::vector<wire::ProcessStatus> processes;
  /// What is wrong on the bus now and people must mend, one line each: one model name with two
  /// contents, a peer with another content than is served, two processes that speak as one.
  std::vector<std::string> errors;
  /// Seen from here, one line each, in the order in which they were noticed: other wire versions
  /// and types, incompatible QoS, malformed samples, publishers that were matched but are not
  /// heard.
  std::vector<std::string> refusals;
  std::vector<RegionView> regions;    ///< by peer, body_a, body_b; where they are looked at
  std::vector<RequestView> requests;  ///< by peer and content; the same
};

/// Threads: one at a time.
class DdsMonitor {
 public:
  /// `regions`: also hear the answers and requests of all peers, which they then send once more.
  /// Nobody waits for it.
  /// Errors: kInvalidArgument naming the option; kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<DdsMonitor>> create(
      const wire::TransportOptions& transport, bool regions = false);
  ~DdsMonitor();

  /// Takes in what comes, and returns when something came or the time is over.
  void listen(double seconds);
  [[nodiscard]] BusView view() const;
  /// kConflict once this program's own identity does not count any more: then it hears nobody.
  [[nodiscard]] Status identity() const;

 private:
  class Impl;
  explicit DdsMonitor(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber
