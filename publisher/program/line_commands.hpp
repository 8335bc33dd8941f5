// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a user, or a script, tells a running replay: a line of standard input each.

#include <unistd.h>

#include <optional>
#include <string>
#include <string_view>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::publisher::program {

struct Order {
  enum class Kind {
    kPause,  ///< "pause", "p" or nothing: pauses, or goes on
    kStep,   ///< "step" or "s": to the next pose
    kSeek,   ///< "12.5": to this time in the session; also "start" and "end"
    kMove,   ///< "+5" or "-60": so much further on or back
    kQuit,   ///< "quit" or "q"
  };
  Kind kind = Kind::kPause;
  double seconds = 0;  ///< of kSeek and kMove; infinite for the end
};

/// What a line may be, for whoever is to type one.
inline constexpr const char* kKnownOrders =
    "pause, step, start, end, quit, a time (12.5) or a way on or back (+5, -60) in seconds";

/// Blanks around the line do not matter. Errors: kInvalidArgument with the line and kKnownOrders.
[[nodiscard]] Result<Order> parse_order(std::string_view line);

/// Lines as they come, without waiting for them. A terminal is read only while this process is in
/// its foreground: else the system would stop it.
class LineInput {
 public:
  explicit LineInput(int file = STDIN_FILENO) : file_(file) {}
  /// The next whole line, without its end. Never blocks.
  [[nodiscard]] std::optional<std::string> read();

 private:
  static constexpr std::size_t kMaxLineBytes = 256;  ///< what is longer is no order, and is cut
  const int file_;
  bool ended_ = false;
  std::string pending_;
};

}  // namespace nearmesh::publisher::program
