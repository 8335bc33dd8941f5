// SPDX-License-Identifier: Apache-2.0
#pragma once
// How a program that runs until it is told to stop is told so: Ctrl-C, or SIGTERM.

#include <csignal>

namespace nearmesh::wire::program {

/// Set by SIGINT and SIGTERM once stop_on_signals() was called; until then these end the program.
/// From then on no call of the main thread waits for a pipe: reading and writing fail with EINTR,
/// for nobody may be at its other end.
extern volatile std::sig_atomic_t stop_requested;
void stop_on_signals();
/// Of a verb, or a part of one, that does not look at stop_requested: they end the program again,
/// as they do now where one has come already.
void end_on_signals();

/// Exit code of a program whose identity was revoked or has expired while it ran
/// (docs/security.md).
inline constexpr int kIdentityEnded = 5;

}  // namespace nearmesh::wire::program
