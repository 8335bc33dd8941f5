// SPDX-License-Identifier: Apache-2.0
// Recorded sessions as arrays.

#include <limits>
#include <map>
#include <mutex>

#include "bindings.hpp"
#include "core/query/answer.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "subscriber/recorded/recorded_scene.hpp"

namespace nearmesh::python {
namespace {

struct ReportRow {
  std::int64_t received_ns;
  std::uint64_t peer, frame;
  double time_s;
  std::int32_t a, b;
  std::uint8_t status;
  bool certified, asked, put_off, cut;
  std::uint32_t pairs;
  double clearance_m, uncertainty_m;
  Matrix pose_a, pose_b;
};

class Recording {
 public:
  explicit Recording(const std::string& path) : reader_(need(RecordingReader::open(path))) {
    need(detail::status_of(wire::RecordedSamples::of(*reader_)));
  }

  [[nodiscard]] double duration_s() const {
    return static_cast<double>(reader_->end_ns() - reader_->begin_ns()) * 1e-9;
  }

  py::tuple reports() {
    std::vector<ReportRow> rows;
    std::map<std::string, std::int32_t> numbers;
    std::vector<std::string> names;
    const auto number_of = [&](const std::string& name) {
      const auto [at, is_new] = numbers.emplace(name, static_cast<std::int32_t>(names.size()));
      if (is_new) names.push_back(name);
      return at->second;
    };
    const auto read = [&]() -> Status {
      const py::gil_scoped_release others_may_run;
      const std::lock_guard lock(mutex_);
      const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(*reader_);
      NEARMESH_RETURN_IF_ERROR(samples);
      return reader_->read(
          1, reader_->message_count() + 1, [&](std::int64_t, const RecordedMessage& message) {
            const auto report = samples.value().read<wire::ContactReport>(message);
            if (!report) return true;
            rows.push_back({message.received_ns, report->peer, report->frame, report->time_s,
                            number_of(report->body_a), number_of(report->body_b), report->status,
                            is_certified(static_cast<AnswerStatus>(report->status)), report->asked,
                            report->put_off, report->cut, report->pair_count, report->clearance_m,
                            report->uncertainty_m, matrix_of(report->a.pose),
                            matrix_of(report->b.pose)});
            return true;
          });
    };
    need(read());
    return py::make_tuple(rows_of(rows), names);
  }

  py::dict topics() {
    std::vector<std::uint64_t> counts(reader_->topics().size());
    const auto read = [&] {
      const py::gil_scoped_release others_may_run;
      const std::lock_guard lock(mutex_);
      return reader_->read(1, reader_->message_count() + 1,
                           [&](std::int64_t, const RecordedMessage& message) {
                             ++counts[reader_->writers()[message.writer].topic];
                             return true;
                           });
    };
    need(read());
    py::dict topics;
    for (std::size_t i = 0; i < counts.size(); ++i)
      topics[py::str(reader_->topics()[i].name)] = counts[i];
    return topics;
  }

  [[nodiscard]] py::dict models() const {
    py::dict models;
    for (const RecordedModel& model : reader_->models())
      models[py::str(to_hex(model.content_hash))] = model.name;
    return models;
  }

  subscriber::RecordedScene scene(std::optional<std::int64_t> received_ns, const std::string& body,
                                  const std::string& other) {
    const auto rebuild = [&]() -> Result<subscriber::RecordedScene> {
      const py::gil_scoped_release others_may_run;
      const std::lock_guard lock(mutex_);
      const Result<std::int64_t> report =
          subscriber::find_report(*reader_, {.received_ns = received_ns.value_or(reader_->end_ns()),
                                             .peer = {},
                                             .body = body,
                                             .other = other});
      NEARMESH_RETURN_IF_ERROR(report);
      Result<std::vector<Result<subscriber::RecordedScene>>> scenes =
          subscriber::rebuild_scenes(*reader_, {report.value()});
      NEARMESH_RETURN_IF_ERROR(scenes);
      return std::move(scenes.value().front());
    };
    return need(rebuild());
  }

 private:
  std::unique_ptr<RecordingReader> reader_;
  std::mutex mutex_;  // of what reads on: Python's other threads run meanwhile
};

}  // namespace

void add_recordings(py::module_& module) {
  PYBIND11_NUMPY_DTYPE(ReportRow, received_ns, peer, frame, time_s, a, b, status, certified, asked,
                       put_off, cut, pairs, clearance_m, uncertainty_m, pose_a, pose_b);
  py::class_<subscriber::RecordedBody>(module, "RecordedBody", "A body's mesh as a peer held it.")
      .def_readonly("name", &subscriber::RecordedBody::name, "As on the bus.")
      .def_property_readonly(
          "vertices",
          [](const subscriber::RecordedBody& b) { return rows_of(b.positions_world_m); },
          "World frame, metres, (n, 3).")
      .def_property_readonly(
          "faces", [](const subscriber::RecordedBody& b) { return rows_of(b.faces); },
          "Corners counter-clockwise seen from outside, (m, 3).")
      .def_property_readonly(
          "error_m", [](const subscriber::RecordedBody& b) { return rows_of(b.eps_m); },
          "Of each vertex, how far the full mesh may be from it: 0 where it is exact.");
  py::class_<subscriber::RecordedScene>(module, "RecordedScene",
                                        "What a peer held when it gave a recorded answer.")
      .def_readonly("received_ns", &subscriber::RecordedScene::received_ns,
                    "When the recorder got the answer, nanoseconds since 1970.")
      .def_property_readonly(
          "status", [](const subscriber::RecordedScene& s) { return s.report.status; },
          "Of the answer: Status.")
      .def_property_readonly(
          "bodies",
          [](const subscriber::RecordedScene& s) {
            return py::make_tuple(s.bodies[0], s.bodies[1]);
          },
          "Both, as RecordedBody.")
      .def_property_readonly(
          "contacts",
          [](const subscriber::RecordedScene& s) { return contacts_object(s.contacts); },
          "Where they touch.");
  py::class_<Recording>(
      module, "Recording",
      "A recording (.db3 with all its parts, or .mcap), also while it is made. NotFoundError, "
      "CorruptError where it is none or a damaged one, UnsupportedError for another version.")
      .def(py::init<const std::string&>(), py::arg("path"))
      .def_property_readonly("duration_s", &Recording::duration_s,
                             "From the first message to the last.")
      .def_property_readonly("models", &Recording::models, "{content: name}.")
      .def("topics", &Recording::topics, "How many samples each topic has.")
      .def("reports", &Recording::reports,
           R"(All answers of all peers in order, and the names of bodies: (structured array, list).

Fields: received_ns, peer, frame, time_s, a and b (indices into the names), status (Status), certified, asked, put_off (for want
of budget), cut (by the peer's own max_tests, max_pairs or any), pairs, clearance_m, uncertainty_m, pose_a and pose_b (4, 4).)")
      .def("scene", &Recording::scene, py::kw_only(), py::arg("received_ns") = py::none(),
           py::arg("body") = "", py::arg("other") = "",
           "Meshes and contacts of the last answer until a time (nanoseconds since 1970; None: the "
           "end), of any pair, or of one body, or of two. NotFoundError where there is none.");
}

}  // namespace nearmesh::python
