// SPDX-License-Identifier: Apache-2.0
// Peers: sessions from files and on DDS, and what a frame says.

#include <atomic>
#include <exception>
#include <limits>
#include <map>
#include <memory>
#include <thread>

#include "bindings.hpp"
#include "nearmesh/core/base/parse_content_hash.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "peer.hpp"

namespace nearmesh::python {
namespace {

using subscriber::BodyId;
using subscriber::FrameReport;
using subscriber::PairAnswer;
using subscriber::Session;

struct PairRow {
  std::uint32_t a, b;
  std::uint8_t status, contained;
  bool certified, asked;
  std::uint64_t pairs;
  double clearance_m, clearance_share, uncertainty_m, safe_horizon_s, age_a_s, age_b_s;
  Matrix pose_a, pose_b;
  std::uint64_t digest;
  bool put_off, exhausted;
  std::uint8_t last_status;  ///< of the last certified answer; kNone without one
  double last_age_s, last_clearance_m, last_safe_s;
  double distance_at_most_m;
  std::array<double, 3> nearest_a_m, nearest_b_m;
};
/// Of a body that is a world.
struct TileRow {
  HexText tile;
  std::array<std::int32_t, 3> place;
  bool is_here, asked;
  std::uint8_t status;
  std::uint64_t pairs, missing;
};
struct SweptRow {
  std::uint8_t status;  ///< kNone: not answered
  bool exhausted;
  double free_until_s, hit_s;
};
struct EventRow {
  std::uint8_t change;
  std::uint64_t id;
  std::uint32_t a, b, patch;
};
constexpr std::uint8_t kNone = 255;

PairRow row_of(const PairAnswer& pair) {
  const auto& last = pair.last_certified;
  return {pair.a.value,
          pair.b.value,
          static_cast<std::uint8_t>(pair.answer.status),
          static_cast<std::uint8_t>(pair.answer.contained),
          is_certified(pair.answer.status),
          pair.asked,
          pair.answer.pair_total,
          pair.answer.clearance_m,
          pair.answer.clearance_share,
          pair.answer.uncertainty_m,
          pair.safe_horizon_s,
          pair.age_a_s,
          pair.age_b_s,
          matrix_of(pair.pose_a),
          matrix_of(pair.pose_b),
          digest(pair.answer),
          pair.put_off,
          pair.answer.exhausted,
          last ? static_cast<std::uint8_t>(last->status) : kNone,
          last ? last->age_s : std::numeric_limits<double>::infinity(),
          last ? last->clearance_m : 0,
          last ? last->safe_s : 0,
          pair.answer.distance_at_most_m,
          pair.answer.nearest_a_m,
          pair.answer.nearest_b_m};
}

SweptRow swept_of(const PairAnswer& pair) {
  if (!pair.swept) return {kNone, false, 0, std::numeric_limits<double>::infinity()};
  return {static_cast<std::uint8_t>(pair.swept->status), pair.swept->exhausted,
          pair.swept->free_until_s, pair.swept->hit_s};
}

/// Numbers of bodies.
std::vector<std::uint32_t> numbers_of(const std::vector<BodyId>& bodies) {
  std::vector<std::uint32_t> numbers;
  for (const BodyId body : bodies) numbers.push_back(body.value);
  return numbers;
}

/// Faces, (n, 3, 3).
py::array faces_of(const std::vector<std::array<double, 3>>& corners) {
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(corners.size() / 3), 3, 3};
  return py::array_t<double>(shape, corners.empty() ? nullptr : corners[0].data());
}

/// A pin from its digits; none: none.
ContentHash content_of(const std::string& digits) {
  return digits.empty() ? ContentHash{} : need(parse_content_hash(digits));
}

/// Jobs of a frame on so many threads, the caller's among them.
subscriber::RunJobs jobs_on(unsigned threads) {
  if (threads < 2) return {};
  return [threads](std::size_t count, const std::function<void(std::size_t)>& job) {
    std::atomic<std::size_t> next{0};
    const auto work = [&] {
      for (std::size_t i = next++; i < count; i = next++) job(i);
    };
    const std::size_t wanted = std::min<std::size_t>(threads, count) - 1;
    std::vector<std::thread> others;
    others.reserve(wanted);
    try {
      while (others.size() < wanted) others.emplace_back(work);
    } catch (const std::exception&) {
      // There is no room for more threads: those that there are do it all.
    }
    work();
    for (std::thread& other : others) other.join();
  };
}

/// Jobs of a frame as Python's callable spreads them: run_jobs(count, job) calls job(i) for each i below count, on whichever
/// threads, and returns when all are done. A job runs without the interpreter's lock. What the callable raised is raised by update().
subscriber::RunJobs jobs_of(py::function run) {
  // Let go under the lock, wherever the session ends.
  const std::shared_ptr<py::function> held(new py::function(std::move(run)), [](py::function* f) {
    const py::gil_scoped_acquire lock;
    delete f;
  });
  return [held](std::size_t count, const std::function<void(std::size_t)>& job) {
    struct Jobs {
      Jobs(std::size_t jobs, const std::function<void(std::size_t)>& of) : states(jobs), run(&of) {}
      std::vector<std::atomic<bool>> states;  // begun
      std::atomic<std::size_t> done{0};
      const std::function<void(std::size_t)>* run;  // throws nothing
      void work(std::size_t i) {
        if (i >= states.size() || states[i].exchange(true)) return;
        (*run)(i);
        ++done;
      }
    };
    // The callable may keep its job beyond the frame; it does nothing then.
    const auto jobs = std::make_shared<Jobs>(count, job);
    std::exception_ptr fault;
    {
      const py::gil_scoped_acquire lock;
      try {
        (*held)(count, py::cpp_function([jobs](std::size_t i) {
                  const py::gil_scoped_release others_may_run;
                  jobs->work(i);
                }));
      } catch (...) {
        fault = std::current_exception();
      }
    }
    for (std::size_t i = 0; i < count; ++i) jobs->work(i);
    while (jobs->done != count) std::this_thread::yield();
    if (fault) std::rethrow_exception(fault);
  };
}

subscriber::SessionOptions session_options(const py::kwargs& given) {
  subscriber::SessionOptions options;
  for (const auto& [key, value] : given) {
    const std::string name = py::cast<std::string>(key);
    if (name == "max_pose_age_s") {
      options.max_pose_age_s = given_as<double>(value, name);
    } else if (name == "lookahead_s") {
      options.lookahead_s = given_as<double>(value, name);
    } else if (name == "margin_m") {
      options.margin_m = given_as<double>(value, name);
    } else if (name == "sweep_s") {
      options.sweep_s = given_as<double>(value, name);
    } else if (name == "request_timeout_s") {
      options.request_timeout_s = given_as<double>(value, name);
    } else if (name == "max_held_splits") {
      options.max_held_splits = given_as<std::uint32_t>(value, name);
    } else if (name == "window_bytes") {
      options.window_bytes = given_as<std::uint32_t>(value, name);
    } else if (name == "audit_s") {
      options.audit_s = given_as<double>(value, name);
    } else if (name == "clearance") {
      options.clearance = clearance_of(given_as<std::string>(value, name));
    } else if (name == "cache_folder") {
      options.cache_folder = given_as<std::string>(value, name);
    } else if (name == "contacts") {
      options.contacts = given_as<bool>(value, name);
    } else if (name == "depth") {
      options.depth = given_as<bool>(value, name);
    } else if (name == "publish_reports") {
      options.publish_reports = given_as<bool>(value, name);
    } else if (name == "any") {
      options.any = given_as<bool>(value, name);
    } else if (name == "max_pairs") {
      options.max_pairs = given_as<std::size_t>(value, name);
    } else if (name == "max_tests") {
      options.max_tests = given_as<std::uint64_t>(value, name);
    } else if (name == "max_sweep_tests") {
      options.max_sweep_tests = given_as<std::uint64_t>(value, name);
    } else if (name == "max_depth_tests") {
      options.max_depth_tests = given_as<std::uint64_t>(value, name);
    } else if (name == "promise_s") {
      options.promise_s = given_as<double>(value, name);
    } else if (name == "run_jobs") {
      options.run_jobs = jobs_of(py::cast<py::function>(value));
    } else if (name == "threads") {
      options.run_jobs = jobs_on(given_as<unsigned>(value, name));
    } else {
      throw py::type_error("unexpected option " + name +
                           "; help(nearmesh.Session) lists them");
    }
  }
  need(subscriber::check(options));
  return options;
}

std::unique_ptr<Peer> local_session(const std::map<std::string, std::string>& models,
                                    const std::map<std::string, std::string>& worlds,
                                    const py::kwargs& given) {
  auto channel = std::make_unique<subscriber::LocalChannel>();
  for (const auto& [name, path] : models)
    need(channel->add_model(name, need(ModelFile::open(path))));
  for (const auto& [name, folder] : worlds) need(channel->add_world(name, folder));
  auto peer = std::make_unique<Peer>();
  peer->session = std::make_unique<Session>(std::move(channel), session_options(given));
  return peer;
}

std::unique_ptr<Peer> dds_session(std::uint32_t domain, const std::string& interface,
                                  const std::string& name, const std::string& prefix,
                                  const std::string& transport, const std::string& security,
                                  const std::vector<std::string>& initial_peers,
                                  const std::string& discovery_server, const py::kwargs& given) {
  const auto by_name = wire::transport_of(transport);
  if (!by_name)
    refuse("transport: expected lan, thin, tcp, udp-only or same-host, found " + transport);
  subscriber::DdsChannelOptions options;
  options.transport = wire::preset_of(*by_name);
  options.transport.domain = domain;
  options.transport.interface = interface;
  options.transport.name = name;
  options.transport.prefix = prefix;
  options.transport.security = security;
  options.transport.initial_peers = initial_peers;
  options.transport.discovery_server = discovery_server;
  subscriber::SessionOptions session = session_options(given);
  auto channel = [&] {
    const py::gil_scoped_release others_may_run;
    return subscriber::DdsChannel::create(options);
  }();
  auto peer = std::make_unique<Peer>();
  peer->session = std::make_unique<Session>(need(std::move(channel)), std::move(session));
  return peer;
}

std::vector<Session::OwnMotion> motions_of(const py::dict& given) {
  std::vector<Session::OwnMotion> motions;
  for (const auto& [body, motion] : given) {
    const std::uint32_t id = body_of(body);
    motions.push_back({BodyId{id}, motion_of(motion, id)});
  }
  return motions;
}

void need_row(const FrameReport& report, std::size_t row) {
  if (row >= report.answers.size())
    throw py::index_error("row " + std::to_string(row) + ", expected one of the " +
                          std::to_string(report.answers.size()) + " rows of answers, from 0");
}

void add_frame(py::module_& module) {
  py::class_<subscriber::FreeByBounds>(
      module, "FreeByBounds",
      "Of all pairs that are not listed: boxes prove them apart. Certified.")
      .def_readonly("pairs", &subscriber::FreeByBounds::pairs, "How many.")
      .def_readonly("clearance_m", &subscriber::FreeByBounds::clearance_m,
                    "The bodies of each pair are at least so far apart at this frame's poses.")
      .def_readonly("horizon_s", &subscriber::FreeByBounds::horizon_s,
                    "So long after the frame's time none of them can touch, if the bodies keep "
                    "within their speeds.")
      .def_readonly("digest", &subscriber::FreeByBounds::digest,
                    "Equal on peers that know the same bodies at the same places.");
  py::class_<FrameReport>(
      module, "FrameReport",
      "What one update did and said. Rows of answers are numbered from 0; IndexError beyond them. "
      "Times are wall clock of the update, seconds.")
      .def_property_readonly(
          "answers",
          [](const FrameReport& report) {
            std::vector<PairRow> rows;
            rows.reserve(report.answers.size());
            for (const PairAnswer& pair : report.answers) rows.push_back(row_of(pair));
            return rows_of(rows);
          },
          R"(A structured array: a row for each pair that is watched by name or may be near.

a, b: numbers of the bodies. status: Status. certified: free, contact or contained. asked: headers and fresh poses were there. contained: Contained.
pairs: faces that touch. clearance_m, distance_at_most_m: the distance lies between; clearance_share: how near the first is to the greatest that can
be proved. nearest_a_m, nearest_b_m: points of both that are distance_at_most_m apart, where that is positive and finite. uncertainty_m: not
certified, how far unseen faces may be from what is held. safe_horizon_s: so long nothing can touch, if the bodies keep within their speeds.
age_a_s, age_b_s: of the poses. pose_a, pose_b (4, 4): what was asked about; meaningless unless asked. digest: equal answers, equal digests.
exhausted: the search was ended by max_tests. put_off: its turn did not come within the budget; then last_status (255: none), last_age_s,
last_clearance_m and last_safe_s tell of its last certified answer. docs/answers.md has what each promises.)")
      .def_property_readonly(
          "reasons",
          [](const FrameReport& report) {
            std::vector<std::string> reasons;
            for (const PairAnswer& pair : report.answers)
              reasons.push_back(pair.reason.empty() ? pair.awaited : pair.reason);
            return reasons;
          },
          "Of each row of answers: why it is not certified; empty where it is.")
      .def(
          "contacts",
          [](const FrameReport& report, std::size_t row) -> py::object {
            need_row(report, row);
            const auto& contacts = report.answers[row].contacts;
            return contacts ? contacts_object(*contacts) : py::none();
          },
          py::arg("row").noconvert(),
          "Where the bodies of a row of answers touch; None without contact, or without the "
          "session's option contacts.")
      .def(
          "contact_ids",
          [](const FrameReport& report, std::size_t row) {
            need_row(report, row);
            return rows_of(report.answers[row].contact_ids);
          },
          py::arg("row").noconvert(),
          "Of each patch of contacts(row): a number that lasts with the contact.")
      .def(
          "depth",
          [](const FrameReport& report, std::size_t row) -> py::object {
            need_row(report, row);
            const auto& depth = report.answers[row].depth;
            return depth ? py::cast(*depth) : py::none();
          },
          py::arg("row").noconvert(),
          "How deep the bodies of a row of answers are in each other; None without contact, or "
          "without the session's option depth.")
      .def(
          "world",
          [](const FrameReport& report, std::size_t row) -> py::object {
            need_row(report, row);
            const auto& world = report.answers[row].world;
            if (!world) return py::none();
            std::vector<TileRow> rows;
            for (const subscriber::NearTile& tile : world->tiles)
              rows.push_back({hex_of(tile.tile.content), tile.tile.place, tile.is_here, tile.asked,
                              static_cast<std::uint8_t>(tile.status), tile.pairs,
                              tile.missing.size()});
            return py::make_tuple(to_hex(world->world), rows_of(rows), world->missing_pages.size());
          },
          py::arg("row").noconvert(),
          "Where one of the bodies of a row of answers is a world, and was asked: the world's "
          "content, its tiles near the other body as a structured array (tile, place, is_here, "
          "asked, status, pairs, missing), and how many pages have not come. Else None.")
      .def_property_readonly(
          "swept",
          [](const FrameReport& report) {
            std::vector<SweptRow> rows;
            for (const PairAnswer& pair : report.answers) rows.push_back(swept_of(pair));
            return rows_of(rows);
          },
          "With sweep_s, of each row of answers, for the time ahead: status (255: not asked), "
          "free_until_s, hit_s (infinite: none was found), exhausted. A structured array.")
      .def_property_readonly(
          "came", [](const FrameReport& report) { return numbers_of(report.came); },
          "With discover_bodies(): bodies that came.")
      .def_property_readonly(
          "went", [](const FrameReport& report) { return numbers_of(report.went); },
          "With discover_bodies(): bodies that went.")
      .def_readonly("promised", &FrameReport::promised,
                    "Bodies of which no full pose is here, and a promise holds.")
      .def_property_readonly(
          "contact_events",
          [](const FrameReport& report) {
            std::vector<EventRow> rows;
            for (const subscriber::ContactEvent& event : report.contact_events)
              rows.push_back({static_cast<std::uint8_t>(event.change), event.id, event.a.value,
                              event.b.value, event.patch});
            return rows_of(rows);
          },
          "A structured array: change (ContactChange), id, a, b (bodies), patch (of contacts(), "
          "where it begins or persists). One for each contact that there is or was until now.")
      .def(
          "find",
          [](const FrameReport& report, std::uint32_t a, std::uint32_t b) -> py::object {
            const PairAnswer* pair = report.find(BodyId{a}, BodyId{b});
            if (pair == nullptr) return py::none();
            return py::cast(pair - report.answers.data());
          },
          py::arg("a").noconvert(), py::arg("b"),
          "The row of two bodies, in either order; None where it is not listed.")
      .def_property_readonly("all_certified", &FrameReport::all_certified,
                             "Of all pairs, listed or not.")
      .def_readonly("free_by_bounds", &FrameReport::free_by_bounds,
                    "With watch_all() or watch_own(): the pairs that are not listed, all free.")
      .def_property_readonly(
          "unknown",
          [](const FrameReport& report) {
            std::vector<std::pair<std::uint32_t, std::string>> unknown;
            for (const auto& body : report.unknown)
              unknown.emplace_back(body.body.value, body.reason);
            return unknown;
          },
          "With watch_all() or watch_own(): bodies of which nothing can be said, and why. None of "
          "their pairs is certified.")
      .def_readonly("unknown_pairs", &FrameReport::unknown_pairs,
                    "Pairs that are not listed because one of the two is unknown: uncertain.")
      .def_readonly("complaints", &FrameReport::complaints, "One line each, for a log.")
      .def_readonly("state_digest", &FrameReport::state_digest,
                    "Of the detail that is held: equal on peers that were sent the same.")
      .def_readonly("answers_digest", &FrameReport::answers_digest,
                    "Equal on peers that hold and ask the same.")
      .def_readonly("pairs_put_off", &FrameReport::pairs_put_off,
                    "Rows of answers that are, for want of budget.")
      .def_readonly("batches_waiting", &FrameReport::batches_waiting,
                    "Messages of detail that are left over for want of budget.")
      .def_readonly("query_s", &FrameReport::query_s, "Answering, the sum over pairs.")
      .def_readonly("load_s", &FrameReport::load_s, "Decoding detail.")
      .def_readonly("refine_s", &FrameReport::refine_s, "Refining meshes.")
      .def_readonly("tree_s", &FrameReport::tree_s, "Following with the trees.")
      .def_readonly("broad_s", &FrameReport::broad_s, "Finding the pairs that may be near.");
}

}  // namespace

std::uint32_t body_of(const py::handle& given) {
  return given_as<std::uint32_t>(given, "number of a body");
}

/// Of a body: a pose, or a pose with velocities.
Motion motion_of(const py::handle& given, std::uint32_t body) {
  const std::string name = "body " + std::to_string(body);
  if (py::isinstance<Motion>(given)) return py::cast<Motion>(given);
  const auto matrix = Doubles::ensure(given);
  if (!matrix) {
    PyErr_Clear();
    refuse(name + ": expected an array (4, 4) or a Motion");
  }
  return {.pose = pose_of(matrix, name.c_str())};
}

void add_sessions(py::module_& module) {
  PYBIND11_NUMPY_DTYPE(PairRow, a, b, status, contained, certified, asked, pairs, clearance_m,
                       clearance_share, uncertainty_m, safe_horizon_s, age_a_s, age_b_s, pose_a,
                       pose_b, digest, put_off, exhausted, last_status, last_age_s,
                       last_clearance_m, last_safe_s, distance_at_most_m, nearest_a_m, nearest_b_m);
  PYBIND11_NUMPY_DTYPE(SweptRow, status, exhausted, free_until_s, hit_s);
  PYBIND11_NUMPY_DTYPE(EventRow, change, id, a, b, patch);
  PYBIND11_NUMPY_DTYPE(TileRow, tile, place, is_here, asked, status, pairs, missing);
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
              "dds", &dds_session, py::kw_only(), py::arg("domain").noconvert() = 0U, py::arg("interface") = "",
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
                 std::uint32_t group, std::uint32_t mask, double max_speed_mps) {
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
                                     }))
                    .value;
              },
              py::arg("name"), py::arg("model"), py::kw_only(), py::arg("own") = false,
              py::arg("solid") = false, py::arg("content") = "",
              py::arg("max_pose_age_s") = py::none(),
              py::arg("group").noconvert() = 1U, py::arg("mask") = 0xffffffffU, py::arg("max_speed_mps") = 0.0,
              R"(Declares a body and gives its number.

name: on the bus, unique, 1 to 63 bytes of printable ASCII. model: the publisher's name for it. own: this peer moves it. solid: it has an
inside; its model must be closed. content: as Model.content, no other is ever taken. max_pose_age_s: the session's, for this body.
group, mask: watch_all() watches a pair where the mask of each has a bit of the other's group. max_speed_mps: of an own body, it never
moves faster, so others are promised where it stays; 0: no promise.)")
          .def(
              "place_body",
              [](Peer& peer, std::uint32_t body, const Doubles& pose) {
                const Pose at = pose_of(pose, "pose");
                need(unlocked(
                    peer, [&](Session& session) { return session.place_body(BodyId{body}, at); }));
              },
              py::arg("body").noconvert(), py::arg("pose"),
              "Fixes a body in place, for scenery that nobody moves.")
          .def(
              "link_bodies",
              [](Peer& peer, const std::vector<std::uint32_t>& bodies) {
                std::vector<BodyId> links;
                for (const std::uint32_t body : bodies) links.push_back(BodyId{body});
                need(unlocked(peer, [&](Session& session) { return session.link_bodies(links); }));
              },
              py::arg("bodies").noconvert(),
              "Makes own bodies the links of one robot: whoever hears them takes all poses of one "
              "instant or none. Each update() then gives motions of all links, or of none. Before "
              "any of them has a motion.")
          .def(
              "remove_body",
              [](Peer& peer, std::uint32_t body) {
                need(unlocked(peer,
                              [&](Session& session) { return session.remove_body(BodyId{body}); }));
              },
              py::arg("body").noconvert(),
              "The body is there no more, nor are its pairs. A link takes all of its robot with it.")
          .def(
              "replace_model",
              [](Peer& peer, std::uint32_t body, const std::string& model,
                 const std::string& content) {
                const ContentHash pin = content_of(content);
                need(unlocked(peer, [&](Session& session) {
                  return session.replace_model(BodyId{body}, model, pin);
                }));
              },
              py::arg("body").noconvert(), py::arg("model"), py::arg("content") = "",
              "From now on the body has another model; where it is stays.")
          .def(
              "watch",
              [](Peer& peer, std::uint32_t a, std::uint32_t b) {
                need(unlocked(
                    peer, [&](Session& session) { return session.watch(BodyId{a}, BodyId{b}); }));
              },
              py::arg("a").noconvert(), py::arg("b"),
              "Lists the answer about two bodies in every frame, near or not.")
          .def(
              "unwatch",
              [](Peer& peer, std::uint32_t a, std::uint32_t b) {
                need(unlocked(
                    peer, [&](Session& session) { return session.unwatch(BodyId{a}, BodyId{b}); }));
              },
              py::arg("a").noconvert(), py::arg("b"), "Takes watch() back.")
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
              [](Peer& peer, std::uint32_t body) {
                const subscriber::BodyOptions of = need(
                    unlocked(peer, [&](Session& session) { return session.options_of(BodyId{body}); }));
                using namespace py::literals;  // NOLINT(google-build-using-namespace): "name"_a
                return py::dict("name"_a = of.name, "model"_a = of.model,
                                "content"_a = of.content.is_set() ? to_hex(of.content) : "",
                                "own"_a = of.own, "solid"_a = of.solid, "group"_a = of.group,
                                "mask"_a = of.mask, "max_speed_mps"_a = of.max_speed_mps);
              },
              py::arg("body").noconvert(), "A body as it was declared, here or by its mover.")
          .def(
              "held_mesh",
              [](Peer& peer, std::uint32_t body) {
                const Session::HeldMesh held = need(
                    unlocked(peer, [&](Session& session) { return session.held_mesh(BodyId{body}); }));
                return py::make_tuple(faces_of(held.exact_m), faces_of(held.coarse_m));
              },
              py::arg("body").noconvert(),
              "What is held of a body's model, to be drawn: corners of faces (n, 3, 3), metres, its "
              "frame, of the full mesh; and of those that stand for what is missing.")
          .def(
              "held_state",
              [](Peer& peer, std::uint32_t body) {
                return unlocked(peer,
                                [&](Session& session) { return session.held_state(BodyId{body}); });
              },
              py::arg("body").noconvert(),
              "The same number while held_mesh(body) is the same; 0 where there is none.")
          .def(
              "readiness",
              [](Peer& peer, std::uint32_t body) {
                const subscriber::Readiness found = need(
                    unlocked(peer, [&](Session& session) { return session.readiness(BodyId{body}); }));
                return py::make_tuple(to_string(found.stage), found.reason);
              },
              py::arg("body").noconvert(), "(stage, reason) as of the last update, as of wait_ready.")
          .def(
              "region_readiness",
              [](Peer& peer, std::uint32_t body, const std::array<double, 3>& lo_m,
                 const std::array<double, 3>& hi_m) {
                const subscriber::RegionReadiness found = need(unlocked(peer, [&](Session& session) {
                  return session.region_readiness(BodyId{body}, lo_m, hi_m);
                }));
                return py::make_tuple(found.resolved, found.uncertainty_m, found.reason);
              },
              py::arg("body").noconvert(), py::arg("lo_m"), py::arg("hi_m"),
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
              [](Peer& peer, std::uint32_t body) {
                return unlocked(peer, [&](Session& session) { return session.name_of(BodyId{body}); });
              },
              py::arg("body").noconvert(), "Its name; empty where no such body is declared.")
          .def(
              "update",
              [](Peer& peer, std::uint64_t frame, double time_s, const py::dict& motions,
                 double budget_s) {
                const std::vector<Session::OwnMotion> own = motions_of(motions);
                return need(unlocked(peer, [&](Session& session) {
                  return session.update(frame, time_s, own, budget_s);
                }));
              },
              py::arg("frame").noconvert(), py::arg("time_s"), py::arg("motions") = py::dict(),
              py::arg("budget_s") = 0.005,
              R"(One frame: sends own bodies' motions {body: pose (4, 4) or Motion}, takes in detail, answers watched pairs, all within budget_s.

time_s: the frame's time on the clock that the whole exercise shares. Own bodies that rest need no motion. Never blocks. Where the budget, in
seconds of wall clock, is too little, pairs take turns, who may touch soonest first; a row whose turn did not come is put_off, not asked.)")
          .def(
              "wait_ready",
              [](Peer& peer, std::uint32_t body, double timeout_s, const py::dict& motions,
                 std::uint64_t frame, double time_s) {
                const std::vector<Session::OwnMotion> own = motions_of(motions);
                subscriber::Waited waited = need(unlocked(peer, [&](Session& session) {
                  return subscriber::wait_ready(session, BodyId{body}, timeout_s, own, frame,
                                                time_s);
                }));
                return py::make_tuple(to_string(waited.readiness.stage), waited.readiness.reason,
                                      std::move(waited.report));
              },
              py::arg("body").noconvert(), py::arg("timeout_s"), py::arg("motions") = py::dict(),
              py::arg("frame").noconvert() = 0U, py::arg("time_s") = 0.0,
              R"(Updates until all pairs of a body are certified, or the time is over: (stage, reason, report of the last update).

stage: "waiting", "answering" or "certified".)")
          .def(
              "motion_of",
              [](Peer& peer, std::uint32_t body) {
                return unlocked(peer, [&](Session& session) { return session.motion_of(BodyId{body}); });
              },
              py::arg("body").noconvert(), "Where a body was last known to be; None where no pose has come.")
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
