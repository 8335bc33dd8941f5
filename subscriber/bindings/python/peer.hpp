// SPDX-License-Identifier: Apache-2.0
#pragma once
// A session as Python has it.

#include <memory>
#include <mutex>

#include "bindings.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::python {

/// A session of Python's, whose other threads run on while it works.
struct Peer {
  std::unique_ptr<subscriber::Session> session;
  std::mutex mutex{};
};

/// Runs what may take long without the interpreter's lock, one at a time.
template <class Work>
auto unlocked(Peer& peer, const Work& work) {
  const py::gil_scoped_release others_may_run;
  const std::lock_guard lock(peer.mutex);
  return work(*peer.session);
}

/// Of a body: a pose, or a pose with velocities.
[[nodiscard]] Motion motion_of(const py::handle& given, std::uint32_t body);

/// What the class Session has of probes, and poses that the host heard.
void add_probes(py::class_<Peer> peer_class);

}  // namespace nearmesh::python
