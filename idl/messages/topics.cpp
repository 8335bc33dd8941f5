// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/messages/topics.hpp"

#include <algorithm>
#include <charconv>
#include <random>

#include "core/base/hash.hpp"

namespace nearmesh::wire {

namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

bool is_prefix_char(char c) {
  return is_digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || c == '-' ||
         c == '/';
}

}  // namespace

std::vector<std::string> recorded_topics() {
  std::vector<std::string> names;
  for (const TopicFacts& topic : kTopicFacts)
    if (topic.is_recorded) names.emplace_back(topic.name);
  return names;
}

TopicNames::TopicNames(std::string_view prefix, std::string_view version) {
  for (TopicPlace place = 0; place < kTopicCount; ++place) {
    std::string& name = names_[place] = prefix;
    if (kTopicFacts[place].is_versioned) name.append("/v").append(version);
    name.append("/").append(kTopicFacts[place].name);
  }
}

std::optional<TopicPlace> TopicNames::find(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found == names_.end()) return std::nullopt;
  return static_cast<TopicPlace>(found - names_.begin());
}

std::string key_of(std::uint64_t id) { return to_hex(id); }
std::string key_of(const ContentHash& content) { return to_hex(content); }
std::string key_of(SessionId peer, std::uint32_t part) {
  return to_hex(peer) + "/" + std::to_string(part);
}

std::string partition_of(SessionId peer) { return to_hex(peer); }

SessionId peer_of(std::string_view partition) {
  SessionId peer = 0;
  std::from_chars(partition.data(), partition.data() + partition.size(), peer, 16);
  return partition == partition_of(peer) ? peer : 0;
}

SessionId make_session_id() {
  std::random_device device;
  SessionId id = 0;
  while (id == 0) id = (static_cast<SessionId>(device()) << 32) | device();
  return id;
}

std::optional<std::string> judge_remote_endpoint(std::string_view prefix, std::string_view topic,
                                                 std::string_view type, std::string_view program) {
  const std::string who = program.empty() ? "a program" : std::string(program);
  if (!topic.starts_with(prefix)) return std::nullopt;
  if (const auto place = TopicNames(prefix).find(topic)) {
    const std::string_view expected = kTopicFacts[*place].type;
    if (type == expected) return std::nullopt;
    return who + " uses topic " + std::string(topic) + " with type " + std::string(type) +
           ", expected " + std::string(expected) + ": the two will never exchange data";
  }
  std::string_view rest = topic.substr(prefix.size());
  if (!rest.starts_with("/v")) return std::nullopt;
  rest.remove_prefix(2);
  const std::size_t digits =
      static_cast<std::size_t>(std::find_if_not(rest.begin(), rest.end(), is_digit) - rest.begin());
  if (digits == 0 || digits >= rest.size() || rest[digits] != '/') return std::nullopt;
  if (rest.substr(0, digits) == std::to_string(kWireVersion)) return std::nullopt;
  return who + " uses prefix " + std::string(prefix) + " with wire version " +
         std::string(rest.substr(0, digits)) + ", this build speaks " +
         std::to_string(kWireVersion) + ": the two will not exchange data";
}

Status check_prefix(std::string_view prefix) {
  const bool sized = !prefix.empty() && prefix.size() <= kMaxPrefixBytes;
  if (sized && prefix.front() != '/' && prefix.back() != '/' &&
      std::all_of(prefix.begin(), prefix.end(), is_prefix_char))
    return Status::ok();
  return {StatusCode::kInvalidArgument,
          "topic prefix: expected 1 to " + std::to_string(kMaxPrefixBytes) +
              " letters, digits, '_', '-' or inner '/', found " + std::to_string(prefix.size()) +
              " bytes that do not fit"};
}

}  // namespace nearmesh::wire
