// SPDX-License-Identifier: Apache-2.0
#pragma once
// Single keys from a terminal, without Enter.

#include <string>

namespace nearmesh::publisher::program {

enum class Key {
  kNone,
  kPause,       ///< space
  kStep,        ///< s or .
  kBack,        ///< left
  kForward,     ///< right
  kFarBack,     ///< down or page down
  kFarForward,  ///< up or page up
  kStart,       ///< home
  kEnd,         ///< end
  kQuit,        ///< q
};

/// Takes the terminal out of line mode and gives it back: at its end, while the process is stopped, and when a signal kills
/// it, but for SIGKILL. Does nothing where standard input is no terminal, or not ours (a job in the background).
/// One at a time in a process. Ctrl-C stays a signal.
class Keyboard {
 public:
  Keyboard();
  ~Keyboard();
  Keyboard(const Keyboard&) = delete;
  Keyboard& operator=(const Keyboard&) = delete;

  [[nodiscard]] bool is_active() const { return active_; }
  /// The next key that was pressed; others than those above are skipped. Never blocks.
  [[nodiscard]] Key read();

 private:
  bool active_ = false;
  std::string pressed_;
};

}  // namespace nearmesh::publisher::program
