// SPDX-License-Identifier: Apache-2.0
#include "discovery_listener.hpp"

#include <optional>
#include <utility>

#include "endpoint_names.hpp"
#include "idl/messages/process_name.hpp"
#include "qos.hpp"

namespace nearmesh::wire {

namespace {

/// What Fast DDS calls a participant that was given no name.
constexpr const char* kUnnamed = "RTPSParticipant";

const char* durability_name(fdds::DurabilityQosPolicyKind kind) {
  switch (kind) {
    case fdds::VOLATILE_DURABILITY_QOS:
      return "volatile";
    case fdds::TRANSIENT_LOCAL_DURABILITY_QOS:
      return "transient local";
    case fdds::TRANSIENT_DURABILITY_QOS:
      return "transient";
    default:
      return "persistent";
  }
}

const char* reliability_name(fdds::ReliabilityQosPolicyKind kind) {
  return kind == fdds::RELIABLE_RELIABILITY_QOS ? "reliable" : "best effort";
}

}  // namespace

DiscoveryListener::DiscoveryListener(Mailbox& mailbox, const BusOptions& options)
    : mailbox_(mailbox),
      prefix_(options.transport.prefix),
      names_(prefix_),
      on_writer_(options.on_writer),
      on_reader_(options.on_reader) {}

void DiscoveryListener::set_own(const ParticipantKey& own) {
  const std::lock_guard lock(mutex_);
  own_ = own;
}

bool DiscoveryListener::judges(fdds::QosPolicyId_t id) {
  return id == fdds::RELIABILITY_QOS_POLICY_ID || id == fdds::DURABILITY_QOS_POLICY_ID;
}

void DiscoveryListener::participant_found(const FoundParticipant& found) {
  const std::string name = shown_participant(found.name);
  mailbox_.meet(participant_of(found.participant), found.is_gone || name == kUnnamed ? "" : name);
}

void DiscoveryListener::take(const FoundEndpoint& found, const Tell& tell, bool is_writer) {
  {
    const std::lock_guard lock(mutex_);
    if (participant_of(found.endpoint) != own_) has_found_others_ = true;
  }
  if (tell && (found.is_new || found.is_gone))
    tell({found.endpoint, found.topic, found.partitions.empty() ? "" : found.partitions.front(),
          found.is_gone});
  if (!found.is_new) return;
  judge(found);
  judge_qos(found, is_writer);
}

void DiscoveryListener::judge(const FoundEndpoint& found) {
  if (std::optional<std::string> line = judge_remote_endpoint(
          prefix_, found.topic, found.type, participant_name(found.endpoint, mailbox_)))
    say(std::move(*line));
}

void DiscoveryListener::judge_qos(const FoundEndpoint& found, bool is_writer) {
  const std::optional<TopicPlace> place = names_.find(found.topic);
  if (!place) return;
  const Delivery& delivery = kTopicFacts[*place].delivery;
  const auto too_little = [&](auto theirs, auto ours) {
    return is_writer ? theirs < ours : theirs > ours;
  };
  const auto line = [&](const char* policy, const char* theirs, const char* ours) {
    return found.topic + ": " + (is_writer ? "writer " : "reader ") +
           name_of(found.endpoint, mailbox_) + " cannot be matched: it " +
           (is_writer ? "offers " : "requests ") + policy + " " + theirs + ", this side " +
           (is_writer ? "requests " : "offers ") + ours + "; give it " + policy + " " + ours;
  };
  if (too_little(found.reliability, reliability_of(delivery)))
    say(line("reliability", reliability_name(found.reliability),
             reliability_name(reliability_of(delivery))));
  if (too_little(found.durability, durability_of(delivery)))
    say(line("durability", durability_name(found.durability),
             durability_name(durability_of(delivery))));
}

void DiscoveryListener::say(std::string line) {
  {
    const std::lock_guard lock(mutex_);
    if (said_.size() >= kMaxKnown && !said_.contains(line)) said_.clear();
    if (!said_.insert(line).second) return;
  }
  mailbox_.complain(std::move(line));
}

}  // namespace nearmesh::wire
