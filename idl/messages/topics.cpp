// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/messages/topics.hpp"

#include <algorithm>
#include <array>
#include <random>
#include <utility>

namespace nearmesh::wire {

namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

bool is_prefix_char(char c) {
  return is_digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || c == '-' ||
         c == '/';
}

}  // namespace

TopicNames::TopicNames(std::string_view prefix) : hello(std::string(prefix) + "/hello") {
  const std::string versioned = std::string(prefix) + "/v" + std::to_string(kWireVersion) + "/";
  mesh_header = versioned + "mesh_header";
  region_subscription = versioned + "region_subscription";
  split_batch = versioned + "split_batch";
  body_pose = versioned + "body_pose";
  contact_report = versioned + "contact_report";
  process_status = versioned + "process_status";
  echo = versioned + "echo";
  probe = versioned + "probe";
}

std::string partition_of(SessionId peer) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string name(16, '0');
  for (std::size_t i = 16; i-- > 0; peer >>= 4) name[i] = kDigits[peer & 0xf];
  return name;
}

SessionId make_session_id() {
  std::random_device device;
  SessionId id = 0;
  while (id == 0) id = (static_cast<SessionId>(device()) << 32) | device();
  return id;
}

std::optional<std::string> judge_remote_endpoint(std::string_view prefix, std::string_view topic,
                                                 std::string_view type) {
  if (!topic.starts_with(prefix)) return std::nullopt;
  const TopicNames names(prefix);
  const std::array<std::pair<std::string_view, std::string_view>, 9> known{{
      {names.hello, kHelloType},
      {names.mesh_header, kMeshHeaderType},
      {names.region_subscription, kRegionSubscriptionType},
      {names.split_batch, kSplitBatchType},
      {names.body_pose, kBodyPoseType},
      {names.contact_report, kContactReportType},
      {names.process_status, kProcessStatusType},
      {names.echo, kEchoType},
      {names.probe, kEchoType},
  }};
  for (const auto& [name, expected] : known) {
    if (topic != name) continue;
    if (type == expected) return std::nullopt;
    return "topic " + std::string(topic) + " is used elsewhere with type " + std::string(type) +
           ", expected " + std::string(expected) + ": the two will never exchange data";
  }
  std::string_view rest = topic.substr(prefix.size());
  if (!rest.starts_with("/v")) return std::nullopt;
  rest.remove_prefix(2);
  const std::size_t digits =
      static_cast<std::size_t>(std::find_if_not(rest.begin(), rest.end(), is_digit) - rest.begin());
  if (digits == 0 || digits >= rest.size() || rest[digits] != '/') return std::nullopt;
  if (rest.substr(0, digits) == std::to_string(kWireVersion)) return std::nullopt;
  return "a program with wire version " + std::string(rest.substr(0, digits)) + " uses prefix " +
         std::string(prefix) + ", this build speaks " + std::to_string(kWireVersion) +
         ": the two will not exchange data";
}

Status check_prefix(std::string_view prefix) {
  const bool sized = !prefix.empty() && prefix.size() <= 100;
  if (sized && prefix.front() != '/' && prefix.back() != '/' &&
      std::all_of(prefix.begin(), prefix.end(), is_prefix_char))
    return Status::ok();
  return {StatusCode::kInvalidArgument,
          "topic prefix: expected 1 to 100 letters, digits, '_', '-' or inner '/', found " +
              std::to_string(prefix.size()) + " bytes that do not fit"};
}

}  // namespace nearmesh::wire
