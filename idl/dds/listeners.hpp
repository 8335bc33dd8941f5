// SPDX-License-Identifier: Apache-2.0
#pragma once
// Listeners that only wake the thread that makes the DDS calls, and remember who came and went. For
// the rooms named dds alone.

#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SubscriberListener.hpp>

#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <vector>

#include "dds_time.hpp"
#include "fastdds_api.hpp"
#include "mailbox.hpp"

namespace nearmesh::wire {

class DoorWatch;

/// Of one reader and its Subscriber: wakes, and remembers which writers came and went.
/// on_data_on_readers is taken here so that it does not reach a listener of the host's participant.
/// A writer whose participant falls silent has gone, long before its lease is over, and is found
/// again with the next life sign: discovery forgets nobody meanwhile, so that nothing is told anew.
class ReaderListener : public fdds::SubscriberListener {
 public:
  explicit ReaderListener(Mailbox& mailbox) : mailbox_(mailbox) {}
  /// Of the participant that the reader is on; nullptr: only leases tell who is gone.
  void watch_life_signs(std::shared_ptr<const DoorWatch> door, double silence_s);

  struct Match {
    Handle writer;
    Microseconds when;
    Mover now;  ///< kThere: found; else how it went, kSilent and may be found again

    [[nodiscard]] bool is_gone() const { return now != Mover::kThere; }
  };
  [[nodiscard]] std::vector<Match> take_matches();

  void on_data_on_readers(fdds::Subscriber* subscriber) override;
  void on_data_available(fdds::DataReader* reader) override;
  void on_subscription_matched(fdds::DataReader* reader,
                               const fdds::SubscriptionMatchedStatus& status) override;
  void on_requested_incompatible_qos(fdds::DataReader* reader,
                                     const fdds::RequestedIncompatibleQosStatus& status) override;

 private:
  Mailbox& mailbox_;
  void look_for_life_signs();

  std::mutex mutex_;
  std::vector<Match> matches_;
  std::map<Handle, bool> silent_;  ///< of each writer that is matched
  std::shared_ptr<const DoorWatch> door_;
  double silence_s_ = 0;
  std::chrono::steady_clock::time_point looked_{};
};

/// Of one writer: wakes, and knows the readers that are matched.
class WriterListener : public fdds::DataWriterListener {
 public:
  explicit WriterListener(Mailbox& mailbox) : mailbox_(mailbox) {}

  /// The writer was removed, and another will use this listener.
  void forget_readers();
  /// Whether a reader was matched since the last call.
  [[nodiscard]] bool take_came();
  [[nodiscard]] bool has_readers() const;
  /// Is a reader of the same participant as this endpoint matched?
  [[nodiscard]] bool is_matched_with_participant_of(const Handle& endpoint) const;
  /// Is a reader of any other participant matched?
  [[nodiscard]] bool is_matched_beside_participant_of(const Handle& endpoint) const;

  void on_publication_matched(fdds::DataWriter* writer,
                              const fdds::PublicationMatchedStatus& status) override;
  void on_offered_incompatible_qos(fdds::DataWriter* writer,
                                   const fdds::OfferedIncompatibleQosStatus& status) override;

 private:
  Mailbox& mailbox_;
  mutable std::mutex mutex_;
  std::set<Handle> readers_;
  bool came_ = false;
};

}  // namespace nearmesh::wire
