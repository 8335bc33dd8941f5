// SPDX-License-Identifier: Apache-2.0
// Peers: bodies, pairs, updates. How one is made is in make_sessions.cpp, what a frame says in
// frames.cpp.

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "bindings.hpp"
#include "nearmesh/core/base/parse_content_hash.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "peer.hpp"

namespace nearmesh::python {
namespace {

using subscriber::BodyId;
using subscriber::FrameReport;
using subscriber::Session;

/// Faces, (n, 3, 3).
py::array faces_of(const std::vector<std::array<double, 3>>& corners) {
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(corners.size() / 3), 3, 3};
  return py::array_t<double>(shape, corners.empty() ? nullptr : corners[0].data());
}

/// A pin from its digits; none: none.
ContentHash content_of(const std::string& digits) {
  return digits.empty() ? ContentHash{} : need(parse_content_hash(digits));
}

std::vector<Session::OwnMotion> motions_of(const py::dict& given) {
  std::vector<Session::OwnMotion> motions;
  for (const auto& [body, motion] : given) {
    const BodyId id = body_of(body);
    motions.push_back({id, motion_of(motion, id)});
  }
  return motions;
}

}  // namespace

BodyId body_of(const py::handle& given) { return given_as<BodyId>(given, "number of a body"); }

/// Of a body: a pose, or a pose with velocities.
Motion motion_of(const py::handle& given, BodyId body) {
  const std::string name = "body " + std::to_string(body.value);
  if (py::isinstance<Motion>(given)) return py::cast<Motion>(given);
  const auto matrix = Doubles::ensure(given);
  if (!matrix) {
    PyErr_Clear();
    refuse(name + ": expected an array (4, 4) or a Motion");
  }
  return {.pose = pose_of(matrix, name.c_str())};
}

void add_sessions(py::module_& module) {
  py::class_<Motion>(
      module, "Motion",
      "Where a body is, a pose (4, 4), and how it moves: metres and radians a second, "
      "world frame, about the origin of its model.")
      .def(py::init([](const Doubles& pose, const std::array<double, 3>& linear,
                       const std::array<double, 3>& angular) {
             return Motion{pose_of(pose, "pose"), linear, angular};
           }),
           py::arg("pose"), py::arg("linear_velocity_mps") = std::array<double, 3>{},
           py::arg("angular_velocity_radps") = std::array<double, 3>{})
      .def_property_readonly(
          "pose", [](const Motion& motion) { return array_of(matrix_of(motion.pose)); },
          "A copy, (4, 4).")
      .def_readonly("linear_velocity_mps", &Motion::linear_velocity_mps, "Three, world frame.")
      .def_readonly("angular_velocity_radps", &Motion::angular_velocity_radps,
                    "Three, world frame.");
  add_frame(module);
  const auto peer_class =
      py::class_<Peer>(module, "Session",
                       R"(A peer: bodies, watched pairs, one update a frame, answers.

Made by Session.local (from files, no network) or Session.dds. Bodies are numbers, from 0 in the order of add_body().

Options of both, by keyword, each as in SessionOptions of nearmesh/subscriber/peer/session.hpp: max_pose_age_s (2), lookahead_s (0.5),
margin_m (0), sweep_s (0), request_timeout_s (0.5), max_held_splits (0: no limit), clearance ("none", "bound", "exact"; "bound"),
cache_folder, contacts, depth, publish_reports (True), any, max_pairs, max_tests (2,000,000), max_sweep_tests (50,000),
max_depth_tests (500,000), promise_s (8), window_bytes (65,536), audit_s (0: never).

For the pairs of a frame, threads=N or run_jobs=f: f(count, job) calls job(i) for each i below count, on threads of its own, and
returns when all are done; it calls nothing of the session, on no thread.

Errors: InvalidArgumentError for a value out of its range; NotFoundError for the number of a body that is not there;
ConflictError for a name that is taken, and of every call after one that ended half-way (MemoryError).)")
          .def_static("local", &local_session, py::arg("models"),
                      py::arg("worlds") = std::map<std::string, std::string>{},
                      "A session fed from files: {name: path}, and worlds: {name: folder}. No network, no "
                      "DDS; NotFoundError, IoError, CorruptError or UnsupportedError of a file.")
          .def_static(
              "dds", &dds_session, py::kw_only(), py::arg("domain") = 0U, py::arg("interface") = "",
              py::arg("name") = "", py::arg("prefix") = "nearmesh", py::arg("transport") = "lan",
              py::arg("security") = "", py::arg("initial_peers") = std::vector<std::string>{},
              py::arg("discovery_server") = "",
              "A peer on DDS, on a participant of its own: it joins within some ten milliseconds, and "
              "leaves when the session is gone. transport: lan, thin, tcp, udp-only or same-host; "
              "what it sets, and the other settings: docs/operate.md. InvalidArgumentError "
              "names the option, IoError says what Fast DDS refused.")
          .def(
              "add_body",
              [](Peer& peer, const std::string& name, const std::string& model, bool own,
                 bool solid, const std::string& content, std::optional<double> max_pose_age_s,
                 Whole<std::uint32_t> group, Whole<std::uint32_t> mask, double max_speed_mps) {
                const ContentHash pin = content_of(content);
                return need(unlocked(peer,
                                     [&](Session& session) {
                                       return session.add_body({.name = name,
                                                                .model = model,
                                                                .own = own,
                                                                .solid = solid,
                                                                .content = pin,
                                                                .max_pose_age_s = max_pose_age_s,
                                                                .max_speed_mps = max_speed_mps,
                                                                .group = group,
                                                                .mask = mask});
                                     }));
              },
              py::arg("name"), py::arg("model"), py::kw_only(), py::arg("own") = false,
              py::arg("solid") = false, py::arg("content") = "",
              py::arg("max_pose_age_s") = py::none(),
              py::arg("group") = 1U, py::arg("mask") = 0xffffffffU, py::arg("max_speed_mps") = 0.0,
              R"(Declares a body and gives its number.

name: on the bus, unique, 1 to 63 bytes of printable ASCII. model: the publisher's name for it. own: this peer moves it. solid: it has an
inside; its model must be closed. content: as Model.content, no other is ever taken. max_pose_age_s: the session's, for this body.
group, mask: watch_all() watches a pair where the mask of each has a bit of the other's group. max_speed_mps: of an own body, it never
moves faster, so others are promised where it stays; 0: no promise.)")
          .def(
              "place_body",
              [](Peer& peer, BodyId body, const Doubles& pose) {
                const Pose at = pose_of(pose, "pose");
                need(unlocked(
                    peer, [&](Session& session) { return session.place_body(body, at); }));
              },
              py::arg("body"), py::arg("pose"),
              "Fixes a body in place, for scenery that nobody moves.")
          .def(
              "link_bodies",
              [](Peer& peer, const std::vector<BodyId>& links) {
                need(unlocked(peer, [&](Session& session) { return session.link_bodies(links); }));
              },
              py::arg("bodies"),
              "Makes own bodies the links of one robot: whoever hears them takes all poses of one "
              "instant or none. Each update() then gives motions of all links, or of none. Before "
              "any of them has a motion.")
          .def(
              "remove_body",
              [](Peer& peer, BodyId body) {
                need(unlocked(peer,
                              [&](Session& session) { return session.remove_body(body); }));
              },
              py::arg("body"),
              "The body is there no more, nor are its pairs. A link takes all of its robot with it.")
          .def(
              "replace_model",
              [](Peer& peer, BodyId body, const std::string& model,
                 const std::string& content) {
                const ContentHash pin = content_of(content);
                need(unlocked(peer, [&](Session& session) {
                  return session.replace_model(body, model, pin);
                }));
              },
              py::arg("body"), py::arg("model"), py::arg("content") = "",
              "From now on the body has another model; where it is stays.")
          .def(
              "watch",
              [](Peer& peer, BodyId a, BodyId b) {
                need(unlocked(
                    peer, [&](Session& session) { return session.watch(a, b); }));
              },
              py::arg("a"), py::arg("b"),
              "Lists the answer about two bodies in every frame, near or not.")
          .def(
              "unwatch",
              [](Peer& peer, BodyId a, BodyId b) {
                need(unlocked(
                    peer, [&](Session& session) { return session.unwatch(a, b); }));
              },
              py::arg("a"), py::arg("b"), "Takes watch() back.")
          .def(
              "watch_all",
              [](Peer& peer) { unlocked(peer, [](Session& session) { session.watch_all(); }); },
              "Watches all pairs: near ones are listed, the others told of in free_by_bounds.")
          .def(
              "watch_own",
              [](Peer& peer) { unlocked(peer, [](Session& session) { session.watch_own(); }); },
              "As watch_all, of the pairs of own bodies alone.")
          .def(
              "discover_bodies",
              [](Peer& peer) {
                unlocked(peer, [](Session& session) { session.discover_bodies(); });
              },
              "Declares each body that another peer moves, as its mover tells: FrameReport.came, "
              "went.")
          .def(
              "options_of",
              [](Peer& peer, BodyId body) {
                const subscriber::BodyOptions of = need(
                    unlocked(peer, [&](Session& session) { return session.options_of(body); }));
                using namespace py::literals;  // NOLINT(google-build-using-namespace): "name"_a
                return py::dict("name"_a = of.name, "model"_a = of.model,
                                "content"_a = of.content.is_set() ? to_hex(of.content) : "",
                                "own"_a = of.own, "solid"_a = of.solid, "group"_a = of.group,
                                "mask"_a = of.mask, "max_speed_mps"_a = of.max_speed_mps);
              },
              py::arg("body"), "A body as it was declared, here or by its mover.")
          .def(
              "held_mesh",
              [](Peer& peer, BodyId body) {
                const Session::HeldMesh held = need(
                    unlocked(peer, [&](Session& session) { return session.held_mesh(body); }));
                return py::make_tuple(faces_of(held.exact_m), faces_of(held.coarse_m));
              },
              py::arg("body"),
              "What is held of a body's model, to be drawn: corners of faces (n, 3, 3), metres, its "
              "frame, of the full mesh; and of those that stand for what is missing.")
          .def(
              "held_state",
              [](Peer& peer, BodyId body) {
                return unlocked(peer,
                                [&](Session& session) { return session.held_state(body); });
              },
              py::arg("body"),
              "The same number while held_mesh(body) is the same; 0 where there is none.")
          .def(
              "readiness",
              [](Peer& peer, BodyId body) {
                const subscriber::Readiness found = need(
                    unlocked(peer, [&](Session& session) { return session.readiness(body); }));
                return py::make_tuple(to_string(found.stage), found.reason);
              },
              py::arg("body"), "(stage, reason) as of the last update, as of wait_ready.")
          .def(
              "region_readiness",
              [](Peer& peer, BodyId body, const std::array<double, 3>& lo_m,
                 const std::array<double, 3>& hi_m) {
                const subscriber::RegionReadiness found = need(unlocked(peer, [&](Session& session) {
                  return session.region_readiness(body, lo_m, hi_m);
                }));
                return py::make_tuple(found.resolved, found.uncertainty_m, found.reason);
              },
              py::arg("body"), py::arg("lo_m"), py::arg("hi_m"),
              "(resolved, uncertainty_m, reason) of a box in the body's model frame: whether all of "
              "the full mesh there is here.")
          .def(
              "write_cache",
              [](Peer& peer) {
                need(unlocked(peer, [](Session& session) { return session.write_cache(); }));
              },
              "Brings the files of cache_folder up to date, as the session's end does.")
          .def(
              "name_of",
              [](Peer& peer, BodyId body) {
                return unlocked(peer, [&](Session& session) { return session.name_of(body); });
              },
              py::arg("body"), "Its name; empty where no such body is declared.")
          .def(
              "update",
              [](Peer& peer, Whole<std::uint64_t> frame, double time_s, const py::dict& motions,
                 double budget_s) {
                const std::vector<Session::OwnMotion> own = motions_of(motions);
                return need(unlocked(peer, [&](Session& session) {
                  return session.update(frame, time_s, own, budget_s);
                }));
              },
              py::arg("frame"), py::arg("time_s"), py::arg("motions") = py::dict(),
              py::arg("budget_s") = 0.005,
              R"(One frame: sends own bodies' motions {body: pose (4, 4) or Motion}, takes in detail, answers watched pairs, all within budget_s.

time_s: the frame's time on the clock that the whole exercise shares. Own bodies that rest need no motion. Never blocks. Where the budget, in
seconds of wall clock, is too little, pairs take turns, who may touch soonest first; a row whose turn did not come is put_off, not asked.)")
          .def(
              "wait_ready",
              [](Peer& peer, BodyId body, double timeout_s, const py::dict& motions,
                 Whole<std::uint64_t> frame, double time_s) {
                const std::vector<Session::OwnMotion> own = motions_of(motions);
                subscriber::Waited waited = need(unlocked(peer, [&](Session& session) {
                  return subscriber::wait_ready(session, body, timeout_s, own, frame,
                                                time_s);
                }));
                return py::make_tuple(to_string(waited.readiness.stage), waited.readiness.reason,
                                      std::move(waited.report));
              },
              py::arg("body"), py::arg("timeout_s"), py::arg("motions") = py::dict(),
              py::arg("frame") = 0U, py::arg("time_s") = 0.0,
              R"(Updates until all pairs of a body are certified, or the time is over: (stage, reason, report of the last update).

stage: "waiting", "answering" or "certified".)")
          .def(
              "motion_of",
              [](Peer& peer, BodyId body) {
                return unlocked(peer, [&](Session& session) { return session.motion_of(body); });
              },
              py::arg("body"), "Where a body was last known to be; None where no pose has come.")
          .def_property_readonly("heard_time_s",
                                 [](Peer& peer) {
                                   return unlocked(peer, [](Session& session) {
                                     return session.heard_time_s();
                                   });
                                 },
                                 "The latest time that a pose of another peer had; None before. For "
                                 "who has no clock of the exercise.")
          .def_property_readonly(
              "stats",
              [](Peer& peer) {
                const subscriber::SessionStats stats =
                    unlocked(peer, [](Session& session) { return session.stats(); });
                using namespace py::literals;  // NOLINT(google-build-using-namespace): "name"_a
                return py::dict(
                    "batches"_a = stats.batches, "batch_bytes"_a = stats.batch_bytes,
                    "header_bytes"_a = stats.header_bytes, "requests"_a = stats.requests,
                    "held_splits"_a = stats.held_splits, "exact_faces"_a = stats.exact_faces,
                    "tree_bytes"_a = stats.tree_bytes, "mesh_bytes"_a = stats.mesh_bytes);
              },
              "Since the session began: batches, batch_bytes (of detail), header_bytes, requests. Now: "
              "held_splits, exact_faces, tree_bytes, mesh_bytes (what whole replicas would take).");
  add_probes(peer_class);
}

}  // namespace nearmesh::python
