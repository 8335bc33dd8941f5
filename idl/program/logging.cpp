// SPDX-License-Identifier: Apache-2.0
#include "logging.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>

#include <algorithm>
#include <mutex>

namespace nearmesh::wire::program {
namespace {

constexpr const char* kLevels[] = {"trace", "debug", "info", "warning", "error", "off"};

std::pair<std::string, std::string> room_and_level(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) return {"", text};
  return {text.substr(0, equals), text.substr(equals + 1)};
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

}  // namespace

void begin_logging(const std::string& program) {
  spdlog::set_default_logger(spdlog::stderr_color_mt(program));
  spdlog::set_pattern("%H:%M:%S %n %^%l%$: %v");
}

void add_log_setting(Settings& settings, std::vector<std::string>& levels,
                     const std::vector<std::string>& rooms) {
  const std::vector<std::string> names(std::begin(kLevels), std::end(kLevels));
  const std::string values = joined(names) + "; or ROOM=LEVEL with room " + joined(rooms);
  settings.add("log", levels, "What is logged", values,
               [rooms, names, values](const std::string& text) {
                 const auto [room, level] = room_and_level(text);
                 if (std::find(names.begin(), names.end(), level) != names.end() &&
                     (text == level || std::find(rooms.begin(), rooms.end(), room) != rooms.end()))
                   return Status::ok();
                 return Status{StatusCode::kInvalidArgument,
                               "expected one of " + values + ", found " + text};
               });
}

void set_log_levels(const std::vector<std::string>& levels) {
  for (const std::string& text : levels) {
    const auto [room, level] = room_and_level(text);
    if (room.empty()) {
      spdlog::set_level(spdlog::level::from_str(level));
    } else {
      log(room).set_level(spdlog::level::from_str(level));
    }
  }
}

spdlog::logger& log(const std::string& room) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  if (const auto known = spdlog::get(room); known != nullptr) return *known;
  const auto made = spdlog::default_logger()->clone(room);
  spdlog::register_logger(made);
  return *made;
}

}  // namespace nearmesh::wire::program
