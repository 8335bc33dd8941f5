// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whom discovery finds: their names for messages, and a line on each endpoint that DDS would ignore
// in silence. For the rooms named dds alone.

#include <atomic>
#include <cstddef>
#include <functional>
#include <mutex>
#include <set>
#include <string>

#include "bus.hpp"
#include "fastdds_api.hpp"
#include "mailbox.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire {

/// Of an own participant. Threads: those of Fast DDS; has_found_others() any.
class DiscoveryListener : public FindingListener {
 public:
  DiscoveryListener(Mailbox& mailbox, const BusOptions& options);

  /// Of the participant that this listens for, before it has endpoints: they are found, too.
  void set_own(const ParticipantKey& own);
  /// Whether an endpoint of another participant was ever found.
  [[nodiscard]] bool has_found_others() const { return has_found_others_; }
  /// Of a mismatch in this policy a line was said, with both sides.
  [[nodiscard]] static bool judges(fdds::QosPolicyId_t id);

  void participant_found(const FoundParticipant& found) override;
  void writer_found(const FoundEndpoint& found) override { take(found, on_writer_, true); }
  void reader_found(const FoundEndpoint& found) override { take(found, on_reader_, false); }

 private:
  static constexpr std::size_t kMaxKnown = 256;
  using Tell = std::function<void(const BusOptions::Found&)>;

  void take(const FoundEndpoint& found, const Tell& tell, bool is_writer);
  void judge(const FoundEndpoint& found);
  /// A writer must offer at least what readers request; ours all offer and request what their topic
  /// has.
  void judge_qos(const FoundEndpoint& found, bool is_writer);
  /// Each line once: every endpoint of another version would say the same. Where too many were said
  /// all may be said again: in weeks there are as many of programs that are gone, and who comes
  /// then shall not be refused in silence.
  void say(std::string line);

  Mailbox& mailbox_;
  const std::string prefix_;
  const TopicNames names_;
  const Tell on_writer_, on_reader_;
  std::atomic<bool> has_found_others_ = false;
  std::mutex mutex_;
  ParticipantKey own_{};
  std::set<std::string> said_;
};

}  // namespace nearmesh::wire
