// SPDX-License-Identifier: Apache-2.0
#pragma once
// A session as Python has it.

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "bindings.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::python {

/// A session of Python's, whose other threads run on while it works.
struct Peer {
  Peer() = default;
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;
  /// To leave the bus may take a second.
  ~Peer() {
    const py::gil_scoped_release others_may_run;
    session.reset();
  }

  std::unique_ptr<subscriber::Session> session;
  std::mutex mutex;
  std::atomic<std::thread::id> user{};  ///< who has the mutex
  bool is_spoiled = false;              ///< an exception came half-way, for want of memory say
};

/// Runs what asks or changes the session without the interpreter's lock, one at a time. Of a
/// session that an exception has left half-way nothing is asked.
template <class Work>
auto unlocked(Peer& peer, const Work& work) {
  // A scheduler of the host's that calls the session: it would wait for itself for ever.
  if (peer.user == std::this_thread::get_id())
    raise({StatusCode::kConflict, "the session is in use by the call that this one comes from"});
  const py::gil_scoped_release others_may_run;
  const std::lock_guard lock(peer.mutex);
  if (peer.is_spoiled)
    raise({StatusCode::kConflict,
           "an earlier call ended half-way, for want of memory say; make a new session"});
  struct Using {
    explicit Using(Peer& by) : peer(by) { peer.user = std::this_thread::get_id(); }
    ~Using() { peer.user = std::thread::id(); }
    Using(const Using&) = delete;
    Using& operator=(const Using&) = delete;
    Peer& peer;
  } in_use(peer);
  try {
    return work(*peer.session);
  } catch (const py::error_already_set&) {
    throw;  // of the host's scheduler: the update was carried out
  } catch (...) {
    peer.is_spoiled = true;
    throw;
  }
}

/// Of a body: a pose, or a pose with velocities.
[[nodiscard]] Motion motion_of(const py::handle& given, subscriber::BodyId body);
/// The number of a body, as a key.
[[nodiscard]] subscriber::BodyId body_of(const py::handle& given);

/// Session.local and Session.dds, with their options by keyword.
[[nodiscard]] std::unique_ptr<Peer> local_session(const std::map<std::string, std::string>& models,
                                                  const std::map<std::string, std::string>& worlds,
                                                  const py::kwargs& given);
[[nodiscard]] std::unique_ptr<Peer> dds_session(
    Whole<std::uint32_t> domain, const std::string& interface, const std::string& name,
    const std::string& prefix, const std::string& transport, const std::string& security,
    const std::vector<std::string>& initial_peers, const std::string& discovery_server,
    const py::kwargs& given);

/// The class FrameReport.
void add_frame(py::module_& module);
/// What the class Session has of probes, and poses that the host heard.
void add_probes(py::class_<Peer> peer_class);

}  // namespace nearmesh::python

/// A body is a number in Python.
template <>
struct pybind11::detail::type_caster<nearmesh::subscriber::BodyId> {
  PYBIND11_TYPE_CASTER(nearmesh::subscriber::BodyId, const_name("int"));

  bool load(handle given, bool convert) {
    make_caster<nearmesh::python::Whole<std::uint32_t>> number;
    if (!number.load(given, convert)) return false;
    value.value = cast_op<nearmesh::python::Whole<std::uint32_t>>(number);
    return true;
  }
  static handle cast(nearmesh::subscriber::BodyId body, return_value_policy, handle) {
    return PyLong_FromUnsignedLong(body.value);
  }
};
