// SPDX-License-Identifier: Apache-2.0
#include "stop.hpp"

#include <sys/time.h>

namespace nearmesh::wire::program {
namespace {

/// A call that waits is left when a signal comes, with EINTR. One that begins to wait only then is
/// woken by the next one.
void wake_until_it_ends() {
  constexpr suseconds_t kPeriod_us = 100'000;
  const itimerval again{{0, kPeriod_us}, {0, kPeriod_us}};
  static_cast<void>(::setitimer(ITIMER_REAL, &again, nullptr));
}

void handle(int number, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  ::sigemptyset(&action.sa_mask);
  ::sigaction(number, &action, nullptr);  // without SA_RESTART: see above
}

}  // namespace

volatile std::sig_atomic_t stop_requested = 0;

void stop_on_signals() {
  const auto request_stop = [](int) {
    stop_requested = 1;
    wake_until_it_ends();
  };
  handle(SIGALRM, [](int) {});
  handle(SIGINT, request_stop);
  handle(SIGTERM, request_stop);
}

void end_on_signals() {
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  if (stop_requested != 0) std::raise(SIGTERM);
}

}  // namespace nearmesh::wire::program
