// SPDX-License-Identifier: Apache-2.0
#include "stop.hpp"

namespace nearmesh::wire::program {

volatile std::sig_atomic_t stop_requested = 0;

void stop_on_signals() {
  const auto request_stop = [](int) { stop_requested = 1; };
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
}

void end_on_signals() {
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  if (stop_requested != 0) std::raise(SIGTERM);
}

}  // namespace nearmesh::wire::program
