// SPDX-License-Identifier: Apache-2.0
#include "process_name.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cstdio>
#include <utility>

#include "core/base/hash.hpp"

namespace nearmesh::wire {
namespace {

constexpr std::string_view kOn = " on ";

}  // namespace

Status check_process_name(std::string_view name) {
  const std::string expected =
      "expected 1 to " + std::to_string(kMaxNameBytes) + " bytes of printable ASCII, found ";
  const auto wrong = [&](const std::string& found) {
    return Status{StatusCode::kInvalidArgument, expected + found};
  };
  if (name.empty()) return wrong("none");
  if (name.size() > kMaxNameBytes) return wrong(std::to_string(name.size()) + " bytes");
  const auto bad = std::find_if_not(name.begin(), name.end(), is_printable);
  if (bad != name.end()) {
    char text[48];
    std::snprintf(text, sizeof text, "byte 0x%02x at place %zu",
                  static_cast<unsigned>(static_cast<unsigned char>(*bad)),
                  static_cast<std::size_t>(bad - name.begin()) + 1);
    return wrong(text);
  }
  if (name.front() == ' ' || name.back() == ' ') return wrong("a blank at an end");
  return Status::ok();
}

std::string host_name() {
  std::array<char, HOST_NAME_MAX + 1> name{};
  if (::gethostname(name.data(), name.size()) != 0) return "unknown";
  const std::string shown = shown_name(name.data());
  return shown.empty() ? "unknown" : shown;
}

std::string default_process_name() {
  const std::string process = "/" + std::to_string(::getpid());
  return host_name().substr(0, kMaxNameBytes - process.size()) + process;
}

std::string name_of_process(const std::string& given) {
  return given.empty() ? default_process_name() : given;
}

std::string announced_name(const std::string& given) {
  return given.empty() ? default_process_name() : given + std::string(kOn) + default_process_name();
}

std::string shown_name(std::string name, std::size_t most_bytes) {
  if (name.size() > most_bytes) name.resize(most_bytes);
  for (char& c : name)
    if (!is_printable(c)) c = '?';
  const std::size_t first = name.find_first_not_of(' ');
  if (first == std::string::npos) return {};
  return name.substr(first, name.find_last_not_of(' ') + 1 - first);
}

std::string shown_participant(std::string name) {
  return shown_name(std::move(name), 2 * kMaxNameBytes + kOn.size());
}

std::string called(SessionId session, const std::string& name) {
  return name.empty() ? to_hex(session) : to_hex(session) + " (" + name + ")";
}

}  // namespace nearmesh::wire
