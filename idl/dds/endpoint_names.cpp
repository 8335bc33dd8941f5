// SPDX-License-Identifier: Apache-2.0
#include "endpoint_names.hpp"

#include <fastdds/dds/topic/ContentFilteredTopic.hpp>
#include <fastdds/dds/topic/Topic.hpp>

#include <algorithm>
#include <array>
#include <sstream>

namespace nearmesh::wire {

ParticipantKey participant_of(const Handle& endpoint) {
  const rtps::GuidPrefix_t prefix = rtps::iHandle2GUID(endpoint).guidPrefix;
  ParticipantKey key;
  std::copy_n(prefix.value, key.size(), key.begin());
  return key;
}

const char* name_of(const ReturnCode& code) {
  static constexpr std::array<const char*, 14> kNames{"ok",
                                                      "error",
                                                      "unsupported",
                                                      "bad parameter",
                                                      "precondition not met",
                                                      "out of resources",
                                                      "not enabled",
                                                      "immutable policy",
                                                      "inconsistent policy",
                                                      "already deleted",
                                                      "timeout",
                                                      "no data",
                                                      "illegal operation",
                                                      "not allowed by security"};
  return number_of(code) < kNames.size() ? kNames[number_of(code)] : "unknown";
}

std::string topic_heard_by(const fdds::DataReader& reader) {
  const fdds::TopicDescription* topic = reader.get_topicdescription();
  const auto* routed = dynamic_cast<const fdds::ContentFilteredTopic*>(topic);
  return routed == nullptr ? topic->get_name() : routed->get_related_topic()->get_name();
}

bool have_one_participant(const Handle& a, const Handle& b) {
  return participant_of(a) == participant_of(b);
}

std::string name_of(const Handle& endpoint) {
  std::ostringstream text;
  text << rtps::iHandle2GUID(endpoint);
  return text.str();
}

std::string participant_name(const Handle& endpoint, const Mailbox& mailbox) {
  return mailbox.name_of(participant_of(endpoint));
}

std::string name_of(const Handle& endpoint, const Mailbox& mailbox) {
  const std::string name = participant_name(endpoint, mailbox);
  return name_of(endpoint) + (name.empty() ? "" : " (" + name + ")");
}

}  // namespace nearmesh::wire
