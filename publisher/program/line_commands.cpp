// SPDX-License-Identifier: Apache-2.0
#include "line_commands.hpp"

#include <poll.h>

#include <cmath>
#include <cstdlib>
#include <limits>

namespace nearmesh::publisher::program {

Result<Order> parse_order(std::string_view line) {
  using Kind = Order::Kind;
  const std::size_t begin = line.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return Order{Kind::kPause};
  const std::string word(line.substr(begin, line.find_last_not_of(" \t\r") + 1 - begin));
  if (word == "pause" || word == "p") return Order{Kind::kPause};
  if (word == "step" || word == "s") return Order{Kind::kStep};
  if (word == "quit" || word == "q") return Order{Kind::kQuit};
  if (word == "start") return Order{Kind::kSeek};
  if (word == "end") return Order{Kind::kSeek, std::numeric_limits<double>::infinity()};
  char* end = nullptr;
  const double seconds = std::strtod(word.c_str(), &end);
  if (*end != '\0' || !std::isfinite(seconds))
    return Status{StatusCode::kInvalidArgument, "'" + word + "': expected " + kKnownOrders};
  return Order{word[0] == '+' || word[0] == '-' ? Kind::kMove : Kind::kSeek, seconds};
}

std::optional<std::string> LineInput::read() {
  pollfd ready{.fd = file_, .events = POLLIN, .revents = 0};
  const bool may_read = !ended_ && (::isatty(file_) == 0 || ::tcgetpgrp(file_) == ::getpgrp());
  if (may_read && ::poll(&ready, 1, 0) > 0) {
    char bytes[kMaxLineBytes];
    const ssize_t count = ::read(file_, bytes, sizeof bytes);
    ended_ = count <= 0;
    if (count > 0) pending_.append(bytes, static_cast<std::size_t>(count));
    if (ended_ && !pending_.empty()) pending_ += '\n';  // the last line may lack its end
  }
  std::size_t end = pending_.find('\n');
  if (end == std::string::npos && pending_.size() > kMaxLineBytes) pending_.resize(kMaxLineBytes);
  if (end == std::string::npos) return std::nullopt;
  std::string line = pending_.substr(0, end);
  pending_.erase(0, end + 1);
  return line;
}

}  // namespace nearmesh::publisher::program
