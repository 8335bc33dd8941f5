// SPDX-License-Identifier: Apache-2.0
#include "listeners.hpp"

#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>

#include <algorithm>
#include <string>
#include <utility>

#include "discovery_listener.hpp"
#include "door_watch.hpp"
#include "endpoint_names.hpp"

namespace nearmesh::wire {

namespace {

/// How often life signs are looked for: each look asks for every writer.
constexpr std::chrono::milliseconds kLook{250};

const char* policy_name(fdds::QosPolicyId_t id) {
  switch (id) {
    case fdds::DURABILITY_QOS_POLICY_ID:
      return "durability";
    case fdds::PRESENTATION_QOS_POLICY_ID:
      return "presentation";
    case fdds::DEADLINE_QOS_POLICY_ID:
      return "deadline";
    case fdds::LATENCYBUDGET_QOS_POLICY_ID:
      return "latency budget";
    case fdds::OWNERSHIP_QOS_POLICY_ID:
      return "ownership";
    case fdds::LIVELINESS_QOS_POLICY_ID:
      return "liveliness";
    case fdds::RELIABILITY_QOS_POLICY_ID:
      return "reliability";
    case fdds::DESTINATIONORDER_QOS_POLICY_ID:
      return "destination order";
    case fdds::DATAREPRESENTATION_QOS_POLICY_ID:
      return "data representation";
    case fdds::TYPECONSISTENCYENFORCEMENT_QOS_POLICY_ID:
      return "type consistency";
    case fdds::DISABLEPOSITIVEACKS_QOS_POLICY_ID:
      return "disabled positive acks";
    default:
      return "other";
  }
}

std::string incompatible(const std::string& topic, fdds::QosPolicyId_t id) {
  return topic +
         ": an endpoint elsewhere cannot be matched, its QoS is incompatible: " + policy_name(id) +
         " (policy " + std::to_string(static_cast<unsigned>(id)) + ")";
}

/// A participant of a host's has no listener of ours.
template <class Parent>
bool was_judged(const Parent* parent, fdds::QosPolicyId_t id) {
  const fdds::DomainParticipantListener* listener = parent->get_participant()->get_listener();
  return DiscoveryListener::judges(id) &&
         dynamic_cast<const DiscoveryListener*>(listener) != nullptr;
}

}  // namespace

void ReaderListener::watch_life_signs(std::shared_ptr<const DoorWatch> door, double silence_s) {
  const std::lock_guard lock(mutex_);
  // Whoever was matched on the bus before is forgotten with it.
  silent_.clear();
  door_ = std::move(door);
  silence_s_ = silence_s;
}

std::vector<ReaderListener::Match> ReaderListener::take_matches() {
  const std::lock_guard lock(mutex_);
  look_for_life_signs();
  return std::exchange(matches_, {});
}

void ReaderListener::look_for_life_signs() {
  const auto now = std::chrono::steady_clock::now();
  if (door_ == nullptr || now - looked_ < kLook) return;
  looked_ = now;
  for (auto& [writer, was_silent] : silent_) {
    const std::optional<bool> is_silent = door_->is_silent(participant_of(writer), silence_s_);
    if (!is_silent || *is_silent == was_silent) continue;
    was_silent = *is_silent;
    matches_.push_back({writer, now_us(),
                        !was_silent                                ? Mover::kThere
                        : door_->is_barred(participant_of(writer)) ? Mover::kBarred
                                                                   : Mover::kSilent});
  }
}

void ReaderListener::on_data_on_readers(fdds::Subscriber*) { mailbox_.wake(); }
void ReaderListener::on_data_available(fdds::DataReader*) { mailbox_.wake(); }

void ReaderListener::on_subscription_matched(fdds::DataReader*,
                                             const fdds::SubscriptionMatchedStatus& status) {
  {
    const std::lock_guard lock(mutex_);
    const Handle& writer = status.last_publication_handle;
    const bool is_gone = status.current_count_change < 0;
    const auto known = silent_.find(writer);
    // Told already.
    const bool is_news = known == silent_.end() || !is_gone || !known->second;
    if (is_gone) {
      silent_.erase(writer);
    } else {
      silent_[writer] = false;
    }
    const bool is_barred = is_gone && door_ != nullptr && door_->is_barred(participant_of(writer));
    if (is_news)
      matches_.push_back({writer, now_us(),
                          !is_gone    ? Mover::kThere
                          : is_barred ? Mover::kBarred
                                      : Mover::kLeft});
  }
  mailbox_.wake();
}

void WriterListener::forget_readers() {
  const std::lock_guard lock(mutex_);
  readers_.clear();
}

bool WriterListener::take_came() {
  const std::lock_guard lock(mutex_);
  return std::exchange(came_, false);
}

bool WriterListener::has_readers() const {
  const std::lock_guard lock(mutex_);
  return !readers_.empty();
}

bool WriterListener::is_matched_with_participant_of(const Handle& endpoint) const {
  const std::lock_guard lock(mutex_);
  return std::any_of(readers_.begin(), readers_.end(), [&](const Handle& reader) {
    return participant_of(reader) == participant_of(endpoint);
  });
}

bool WriterListener::is_matched_beside_participant_of(const Handle& endpoint) const {
  const std::lock_guard lock(mutex_);
  return std::any_of(readers_.begin(), readers_.end(), [&](const Handle& reader) {
    return participant_of(reader) != participant_of(endpoint);
  });
}

void WriterListener::on_publication_matched(fdds::DataWriter*,
                                            const fdds::PublicationMatchedStatus& status) {
  {
    const std::lock_guard lock(mutex_);
    if (status.current_count_change > 0) {
      readers_.insert(status.last_subscription_handle);
      came_ = true;
    }
    if (status.current_count_change < 0) readers_.erase(status.last_subscription_handle);
  }
  mailbox_.wake();
}

void ReaderListener::on_requested_incompatible_qos(
    fdds::DataReader* reader, const fdds::RequestedIncompatibleQosStatus& status) {
  if (!was_judged(reader->get_subscriber(), status.last_policy_id))
    mailbox_.complain(incompatible(topic_heard_by(*reader), status.last_policy_id));
}

void WriterListener::on_offered_incompatible_qos(fdds::DataWriter* writer,
                                                 const fdds::OfferedIncompatibleQosStatus& status) {
  if (!was_judged(writer->get_publisher(), status.last_policy_id))
    mailbox_.complain(incompatible(writer->get_topic()->get_name(), status.last_policy_id));
}

}  // namespace nearmesh::wire
