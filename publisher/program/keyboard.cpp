// SPDX-License-Identifier: Apache-2.0
#include "keyboard.hpp"

#include <termios.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <string_view>
#include <utility>

namespace nearmesh::publisher::program {
namespace {

// What the signal handlers need; tcsetattr, sigaction and raise may be called there.
termios line_mode, key_mode;
volatile std::sig_atomic_t in_key_mode = 0;

/// Those that end a process which does not expect them. SIGINT and SIGTERM are the program's own.
constexpr std::array kFatal{SIGHUP, SIGQUIT, SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL};

void set_handler(int signal, void (*handler)(int), int flags = 0) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = flags;
  sigemptyset(&action.sa_mask);
  sigaction(signal, &action, nullptr);
}

void give_back() {
  if (in_key_mode != 0) tcsetattr(STDIN_FILENO, TCSADRAIN, &line_mode);
}

/// As if there had been no handler, the terminal apart.
void die(int signal) {
  give_back();
  raise(signal);  // SA_RESETHAND has set the default again
}

void stop(int) {
  give_back();
  raise(SIGSTOP);  // returns when the process goes on
  if (in_key_mode != 0 && tcgetpgrp(STDIN_FILENO) == getpgrp())
    tcsetattr(STDIN_FILENO, TCSADRAIN, &key_mode);
}

/// Escape sequences of the keys; those of xterm, in both of its modes, and of the Linux console.
constexpr std::array<std::pair<std::string_view, Key>, 18> kSequences{{
    {"\x1b[D", Key::kBack},
    {"\x1bOD", Key::kBack},
    {"\x1b[C", Key::kForward},
    {"\x1bOC", Key::kForward},
    {"\x1b[B", Key::kFarBack},
    {"\x1bOB", Key::kFarBack},
    {"\x1b[A", Key::kFarForward},
    {"\x1bOA", Key::kFarForward},
    {"\x1b[6~", Key::kFarBack},
    {"\x1b[5~", Key::kFarForward},
    {"\x1b[H", Key::kStart},
    {"\x1bOH", Key::kStart},
    {"\x1b[1~", Key::kStart},
    {"\x1b[F", Key::kEnd},
    {"\x1bOF", Key::kEnd},
    {"\x1b[4~", Key::kEnd},
    {"s", Key::kStep},
    {".", Key::kStep},
}};

}  // namespace

Keyboard::Keyboard() {
  if (::isatty(STDIN_FILENO) == 0 || ::tcgetpgrp(STDIN_FILENO) != ::getpgrp() ||
      ::tcgetattr(STDIN_FILENO, &line_mode) != 0)
    return;
  key_mode = line_mode;
  key_mode.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  key_mode.c_cc[VMIN] = 0;
  key_mode.c_cc[VTIME] = 0;
  in_key_mode = 1;
  for (const int signal : kFatal) set_handler(signal, die, static_cast<int>(SA_RESETHAND));
  set_handler(SIGTSTP, stop, SA_RESTART);
  active_ = ::tcsetattr(STDIN_FILENO, TCSADRAIN, &key_mode) == 0;
}

Keyboard::~Keyboard() {
  give_back();
  if (std::exchange(active_, false)) {
    in_key_mode = 0;
    for (const int signal : kFatal) set_handler(signal, SIG_DFL);
    set_handler(SIGTSTP, SIG_DFL);
  }
}

Key Keyboard::read() {
  if (!active_) return Key::kNone;
  char bytes[64];
  if (const ssize_t count = ::read(STDIN_FILENO, bytes, sizeof bytes); count > 0)
    pressed_.append(bytes, static_cast<std::size_t>(count));
  while (!pressed_.empty()) {
    for (const auto& [sequence, key] : kSequences)
      if (pressed_.starts_with(sequence)) {
        pressed_.erase(0, sequence.size());
        return key;
      }
    // The rest of a sequence may still come.
    if (pressed_ == "\x1b" || pressed_ == "\x1b[" || pressed_ == "\x1bO" ||
        (pressed_.size() == 3 && pressed_[0] == '\x1b' && pressed_[1] == '[' &&
         pressed_[2] >= '0' && pressed_[2] <= '9'))
      return Key::kNone;
    const char first = pressed_.front();
    pressed_.erase(0, 1);
    if (first == ' ') return Key::kPause;
    if (first == 'q') return Key::kQuit;
  }
  return Key::kNone;
}

}  // namespace nearmesh::publisher::program
