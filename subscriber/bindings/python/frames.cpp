// SPDX-License-Identifier: Apache-2.0
// What a frame says.

#include <limits>
#include <vector>

#include "bindings.hpp"
#include "peer.hpp"

namespace nearmesh::python {
namespace {

using subscriber::BodyId;
using subscriber::FrameReport;
using subscriber::PairAnswer;

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

void need_row(const FrameReport& report, Whole<std::size_t> row) {
  if (row >= report.answers.size())
    throw py::index_error("row " + std::to_string(row) + ", expected one of the " +
                          std::to_string(report.answers.size()) + " rows of answers, from 0");
}

}  // namespace

void add_frame(py::module_& module) {
  PYBIND11_NUMPY_DTYPE(PairRow, a, b, status, contained, certified, asked, pairs, clearance_m,
                       clearance_share, uncertainty_m, safe_horizon_s, age_a_s, age_b_s, pose_a,
                       pose_b, digest, put_off, exhausted, last_status, last_age_s,
                       last_clearance_m, last_safe_s, distance_at_most_m, nearest_a_m, nearest_b_m);
  PYBIND11_NUMPY_DTYPE(SweptRow, status, exhausted, free_until_s, hit_s);
  PYBIND11_NUMPY_DTYPE(EventRow, change, id, a, b, patch);
  PYBIND11_NUMPY_DTYPE(TileRow, tile, place, is_here, asked, status, pairs, missing);
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
          [](const FrameReport& report, Whole<std::size_t> row) -> py::object {
            need_row(report, row);
            const auto& contacts = report.answers[row].contacts;
            return contacts ? contacts_object(*contacts) : py::none();
          },
          py::arg("row"),
          "Where the bodies of a row of answers touch; None without contact, or without the "
          "session's option contacts.")
      .def(
          "contact_ids",
          [](const FrameReport& report, Whole<std::size_t> row) {
            need_row(report, row);
            return rows_of(report.answers[row].contact_ids);
          },
          py::arg("row"), "Of each patch of contacts(row): a number that lasts with the contact.")
      .def(
          "depth",
          [](const FrameReport& report, Whole<std::size_t> row) -> py::object {
            need_row(report, row);
            const auto& depth = report.answers[row].depth;
            return depth ? py::cast(*depth) : py::none();
          },
          py::arg("row"),
          "How deep the bodies of a row of answers are in each other; None without contact, or "
          "without the session's option depth.")
      .def(
          "world",
          [](const FrameReport& report, Whole<std::size_t> row) -> py::object {
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
          py::arg("row"),
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
      .def_readonly("came", &FrameReport::came, "With discover_bodies(): bodies that came.")
      .def_readonly("went", &FrameReport::went, "With discover_bodies(): bodies that went.")
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
          [](const FrameReport& report, BodyId a, BodyId b) -> py::object {
            const PairAnswer* pair = report.find(a, b);
            if (pair == nullptr) return py::none();
            return py::cast(pair - report.answers.data());
          },
          py::arg("a"), py::arg("b"),
          "The row of two bodies, in either order; None where it is not listed.")
      .def_property_readonly("all_certified", &FrameReport::all_certified,
                             "Of all pairs, listed or not.")
      .def_readonly("free_by_bounds", &FrameReport::free_by_bounds,
                    "With watch_all() or watch_own(): the pairs that are not listed, all free.")
      .def_property_readonly(
          "unknown",
          [](const FrameReport& report) {
            std::vector<std::pair<BodyId, std::string>> unknown;
            for (const auto& body : report.unknown) unknown.emplace_back(body.body, body.reason);
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

}  // namespace nearmesh::python
