// SPDX-License-Identifier: Apache-2.0
#include "logging.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>

#include <algorithm>
#include <chrono>
#include <mutex>

#include "idl/dds/fastdds.hpp"
#include "idl/dds/room.hpp"
#include "nearmesh/idl/messages/messages.hpp"

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

spdlog::level::level_enum level_of(FastDdsLevel level) {
  switch (level) {
    case FastDdsLevel::kError:
      return spdlog::level::err;
    case FastDdsLevel::kWarning:
      return spdlog::level::warn;
    case FastDdsLevel::kInfo:
      break;
  }
  return spdlog::level::info;
}

/// Under a storm of faults Fast DDS complains of each. Threads: one.
class Sluice {
 public:
  /// Out: the line may pass.
  bool pass() {
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double> since = now - last_;
    last_ = now;
    left_ = std::min(kBurst, left_ + since.count());
    if (left_ < 1) {
      ++held_;
      return false;
    }
    --left_;
    return true;
  }
  /// Lines that did not, since this was asked last.
  std::uint64_t take_held() { return std::exchange(held_, 0); }

 private:
  static constexpr double kBurst = 20;
  double left_ = kBurst;
  std::uint64_t held_ = 0;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

void set_fastdds_room(spdlog::level::level_enum level) {
  log(kFastDdsRoom).set_level(level);
  set_fastdds_level(level <= spdlog::level::info   ? FastDdsLevel::kInfo
                    : level == spdlog::level::warn ? FastDdsLevel::kWarning
                                                   : FastDdsLevel::kError);
}

}  // namespace

void begin_logging(const std::string& program) {
  spdlog::set_default_logger(spdlog::stderr_color_mt(program));
  spdlog::set_pattern("%H:%M:%S %n %^%l%$: %v");
  set_fastdds_room(spdlog::level::err);
  // By value: Fast DDS may log until the very end of the process.
  take_fastdds_log([logger = spdlog::get(kFastDdsRoom), sluice = Sluice()](
                       FastDdsLevel level, const std::string& line) mutable {
    if (!logger->should_log(level_of(level)) || !sluice.pass()) return;
    if (const std::uint64_t held = sluice.take_held(); held > 0)
      logger->log(level_of(level), "{} lines were left out here", held);
    logger->log(level_of(level), "{}", line);
  });
}

void add_log_setting(Settings& settings, std::vector<std::string>& levels,
                     const std::vector<std::string>& rooms) {
  const std::vector<std::string> names(std::begin(kLevels), std::end(kLevels));
  const std::string values = joined(names) + "; or LOGGER=LEVEL with logger " + joined(rooms);
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
      // Fast DDS warns of much that is repaired by itself: it has a level of its own, unless
      // nothing at all is wanted.
      set_fastdds_room(std::max(spdlog::level::from_str(level), spdlog::level::err));
    } else if (room == kFastDdsRoom) {
      set_fastdds_room(spdlog::level::from_str(level));
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

void log_fastdds() {
  spdlog::info("Fast DDS {}, {}", fastdds_version(),
               fastdds_asserts() ? "with live assertions: a fault in it ends this process"
                                 : "without assertions");
}

void log_network(const TransportOptions& transport) {
  if (const std::string line = why_alone(transport, ipv4_interfaces()); !line.empty())
    spdlog::warn("{}", line);
}

std::string dds_versions() {
  return "wire version " + std::to_string(kWireVersion) + "\nFast DDS " + fastdds_version() +
         (fastdds_asserts() ? ", with live assertions" : ", without assertions");
}

}  // namespace nearmesh::wire::program
