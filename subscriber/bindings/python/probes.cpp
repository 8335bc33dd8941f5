// SPDX-License-Identifier: Apache-2.0
// Probes of models at hand, of worlds and of a session's bodies, as arrays; poses that the host
// heard.

#include "peer.hpp"

#include <algorithm>
#include <limits>
#include <memory>
#include <span>

#include "nearmesh/core/query/probe.hpp"
#include "nearmesh/core/world/world_probe.hpp"

namespace nearmesh::python {
namespace {

using Point = std::array<double, 3>;
using subscriber::BodyId;
using subscriber::ProbeReport;
using subscriber::Session;

struct RayRow {
  std::uint8_t status;
  bool has_face;
  std::uint32_t missing;
  std::array<std::uint32_t, 2> face;
  double distance_m, at_least_m, at_most_m;
  Point point_m, normal;
};
struct PointRow {
  std::uint8_t status;
  bool on_surface;
  std::uint32_t missing;
};
struct ShapeRow {
  std::uint8_t status;
  bool has_face;
  std::uint32_t missing;
  std::array<std::uint32_t, 2> face;
};

RayRow row_of(const RayAnswer& answer) {
  return {static_cast<std::uint8_t>(answer.status),
          answer.has_face,
          answer.missing,
          {answer.face.split.value, answer.face.index},
          answer.distance_m(),
          answer.at_least_m,
          answer.at_most_m,
          answer.point_m,
          answer.normal};
}
PointRow row_of(const PointAnswer& answer) {
  return {static_cast<std::uint8_t>(answer.status), answer.on_surface, answer.missing};
}
ShapeRow row_of(const ShapeAnswer& answer) {
  return {static_cast<std::uint8_t>(answer.status),
          answer.has_face,
          answer.missing,
          {answer.face.split.value, answer.face.index}};
}

/// Of a world: the answer, and whose face it names.
using Place = std::array<std::int32_t, 3>;
struct WorldRayRow {
  std::uint8_t status;
  bool has_face;
  std::array<std::uint32_t, 2> face;
  HexText tile;
  Place place;
  double distance_m;
  Point point_m, normal;
};
struct WorldShapeRow {
  std::uint8_t status;
  bool has_face;
  std::array<std::uint32_t, 2> face;
  HexText tile;
  Place place;
};
HexText name_of(const WorldTile& tile, bool has_face) {
  return has_face ? hex_of(tile.content) : HexText{};
}
WorldRayRow row_of(const WorldRayAnswer& answer) {
  const RayRow row = row_of(answer.ray);
  return {row.status,        row.has_face,   row.face,    name_of(answer.tile, row.has_face),
          answer.tile.place, row.distance_m, row.point_m, row.normal};
}
WorldShapeRow row_of(const WorldShapeAnswer& answer) {
  const ShapeRow row = row_of(answer.shape);
  return {row.status, row.has_face, row.face, name_of(answer.tile, row.has_face),
          answer.tile.place};
}

/// A world that several of Python's threads may share: one of them probes at a time.
struct World {
  World(const std::string& folder, Whole<std::size_t> most_tiles)
      : probe(need(WorldProbe::open(folder, most_tiles))) {}
  WorldProbe probe;
  std::mutex mutex;
};

/// An array (n, 3), or (3,) for one.
std::vector<Point> points_of(const Doubles& array, const char* name) {
  const py::ssize_t dimensions = array.ndim();
  if ((dimensions != 1 && dimensions != 2) || array.shape(dimensions - 1) != 3)
    refuse(std::string(name) + ": expected an array (3,) or (n, 3), found " +
           std::string(py::str(py::tuple(array.attr("shape")))));
  std::vector<Point> points(static_cast<std::size_t>(dimensions == 2 ? array.shape(0) : 1));
  const double* x = array.data();
  for (Point& point : points)
    for (double& coordinate : point) coordinate = *x++;
  return points;
}
std::vector<double> numbers_of(const Doubles& array, const char* name) {
  if (array.ndim() > 1) refuse(std::string(name) + ": expected a number or an array (n,)");
  return {array.data(), array.data() + array.size()};
}
/// Of many, or one that stands for all.
template <class T>
const T& at(const std::vector<T>& all, std::size_t i) {
  return all[all.size() == 1 ? 0 : i];
}
template <class T>
void check_count(const std::vector<T>& all, std::size_t count, const char* name) {
  if (all.size() != 1 && all.size() != count)
    refuse(std::string(name) + ": expected one or " + std::to_string(count) + ", found " +
           std::to_string(all.size()));
}

std::vector<RayProbe> rays_of(const Doubles& origins, const Doubles& directions,
                              const Doubles& range_m) {
  const std::vector<Point> from = points_of(origins, "origins"),
                           along = points_of(directions, "directions");
  const std::vector<double> ranges = numbers_of(range_m, "range_m");
  check_count(along, from.size(), "directions");
  check_count(ranges, from.size(), "range_m");
  std::vector<RayProbe> rays(from.size());
  for (std::size_t i = 0; i < rays.size(); ++i) rays[i] = {from[i], at(along, i), at(ranges, i)};
  return rays;
}
std::vector<BallProbe> balls_of(const Doubles& centers, const Doubles& radii) {
  const std::vector<Point> middles = points_of(centers, "centers");
  const std::vector<double> radius = numbers_of(radii, "radii");
  check_count(radius, middles.size(), "radii");
  std::vector<BallProbe> balls(middles.size());
  for (std::size_t i = 0; i < balls.size(); ++i) balls[i] = {middles[i], at(radius, i)};
  return balls;
}
std::vector<BoxProbe> boxes_of(const Doubles& poses, const Doubles& halves) {
  const std::vector<Pose> places = poses_of(poses, "poses");
  const std::vector<Point> half_m = points_of(halves, "half_m");
  check_count(half_m, places.size(), "half_m");
  std::vector<BoxProbe> boxes(places.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) boxes[i] = {places[i], at(half_m, i)};
  return boxes;
}

template <class Answer>
auto rows(const std::vector<Answer>& answers) {
  std::vector<decltype(row_of(answers[0]))> all;
  all.reserve(answers.size());
  for (const Answer& answer : answers) all.push_back(row_of(answer));
  return rows_of(all);
}

template <class Answer, class Probe>
auto of_model(Model& model, const Doubles& pose, const std::vector<Probe>& probes) {
  const Pose place = pose_of(pose, "pose");
  std::vector<Answer> answers(probes.size());
  const auto ask = [&]() -> Status {
    const py::gil_scoped_release others_may_run;
    const std::lock_guard lock(model.mutex);
    const auto forget = [&model] { model.probed.reset(); };
    return reading({&model}, forget, [&] {
      if (!model.probed) model.probed.emplace(model.file.store(), model.file.header().grid);
      return certify_probes(
          *model.probed, place, [&](NodeSpan node) { return model.file.require(node); },
          std::span<const Probe>(probes), std::span<Answer>(answers));
    });
  };
  need(ask());
  return rows(answers);
}

template <class Answer, class Probe>
auto of_world(World& world, const Doubles& pose, const std::vector<Probe>& probes) {
  const Pose place = pose_of(pose, "pose");
  std::vector<Answer> answers(probes.size());
  const auto ask = [&]() -> Status {
    const py::gil_scoped_release others_may_run;
    const std::lock_guard lock(world.mutex);
    return world.probe.probe(place, std::span<const Probe>(probes), std::span<Answer>(answers));
  };
  need(ask());
  return rows(answers);
}

template <class Answer, class Probe>
py::tuple of_body(Peer& peer, BodyId body, const std::vector<Probe>& probes) {
  std::vector<Answer> answers(probes.size());
  const ProbeReport report = need(unlocked(peer, [&](Session& session) {
    return session.probe(body, std::span<const Probe>(probes), std::span<Answer>(answers));
  }));
  return py::make_tuple(rows(answers), report.reason.empty() ? report.awaited : report.reason);
}

Doubles matrix(const Point& translation, const std::array<double, 4>& quaternion) {
  return array_of(matrix_of({need(rotation_of_quaternion(quaternion, "it")), translation}));
}

constexpr double kInfinite = std::numeric_limits<double>::infinity();
const Point kDown{0, 0, -1};

void add_world(py::module_& module) {
  PYBIND11_NUMPY_DTYPE(WorldRayRow, status, has_face, face, tile, place, distance_m, point_m,
                       normal);
  PYBIND11_NUMPY_DTYPE(WorldShapeRow, status, has_face, face, tile, place);
  py::class_<World>(
      module, "World",
      R"(A folder that `nearmesh-model build-world` made: its tiles, as if they were one mesh.

At most most_tiles are held open, the least recently used going first. Answers are certified. There are no probes of points,
since tiles are not closed: a ray down tells whether a point is below a ground.)")
      .def(py::init<const std::string&, Whole<std::size_t>>(), py::arg("folder"), py::kw_only(),
           py::arg("most_tiles") = 64)
      .def(
          "probe_rays",
          [](World& w, const Doubles& pose, const Doubles& origins, const Doubles& directions,
             const Doubles& range_m) {
            return of_world<WorldRayAnswer>(w, pose, rays_of(origins, directions, range_m));
          },
          py::arg("pose"), py::arg("origins"), py::arg("directions") = kDown,
          py::arg("range_m") = kInfinite,
          R"(The first face that each ray meets, of the world in a pose (4, 4): a structured array of n rows.

As Model.probe_rays; tile is the content of the model that the face belongs to, place where its grid begins, in cells.)")
      .def(
          "probe_balls",
          [](World& w, const Doubles& pose, const Doubles& centers, const Doubles& radii) {
            return of_world<WorldShapeAnswer>(w, pose, balls_of(centers, radii));
          },
          py::arg("pose"), py::arg("centers"), py::arg("radii"),
          "Whether balls meet the surface; has_face, face, tile, place: which.")
      .def(
          "probe_boxes",
          [](World& w, const Doubles& pose, const Doubles& poses, const Doubles& half_m) {
            return of_world<WorldShapeAnswer>(w, pose, boxes_of(poses, half_m));
          },
          py::arg("pose"), py::arg("poses"), py::arg("half_m"),
          "Whether filled boxes, poses (n, 4, 4) and half extents (n, 3), meet the surface.");
}

}  // namespace

void add_probes(py::module_& module, py::class_<Model, std::shared_ptr<Model>> model) {
  PYBIND11_NUMPY_DTYPE(RayRow, status, has_face, missing, face, distance_m, at_least_m, at_most_m,
                       point_m, normal);
  PYBIND11_NUMPY_DTYPE(PointRow, status, on_surface, missing);
  PYBIND11_NUMPY_DTYPE(ShapeRow, status, has_face, missing, face);
  model
      .def(
          "probe_rays",
          [](Model& m, const Doubles& pose, const Doubles& origins, const Doubles& directions,
             const Doubles& range_m) {
            return of_model<RayAnswer>(m, pose, rays_of(origins, directions, range_m));
          },
          py::arg("pose"), py::arg("origins"), py::arg("directions") = kDown,
          py::arg("range_m") = kInfinite,
          R"(The first face that each ray meets, of the model in a pose (4, 4): a structured array of n rows.

origins (n, 3), directions (n, 3) or (3,), straight down without; range_m (n,) or one. status: ProbeStatus. distance_m, NaN for
a miss; point_m, normal. Certified: detail is read as rays need it.)")
      .def(
          "probe_points",
          [](Model& m, const Doubles& pose, const Doubles& points) {
            return of_model<PointAnswer>(m, pose, points_of(points, "points"));
          },
          py::arg("pose"), py::arg("points"),
          "Whether points (n, 3) lie in the model, which must be closed: HIT inside or on_surface.")
      .def(
          "probe_balls",
          [](Model& m, const Doubles& pose, const Doubles& centers, const Doubles& radii) {
            return of_model<ShapeAnswer>(m, pose, balls_of(centers, radii));
          },
          py::arg("pose"), py::arg("centers"), py::arg("radii"),
          "Whether balls meet the surface; has_face, face: which.")
      .def(
          "probe_boxes",
          [](Model& m, const Doubles& pose, const Doubles& poses, const Doubles& half_m) {
            return of_model<ShapeAnswer>(m, pose, boxes_of(poses, half_m));
          },
          py::arg("pose"), py::arg("poses"), py::arg("half_m"),
          "Whether filled boxes, poses (n, 4, 4) and half extents (n, 3), meet the surface.");
  add_world(module);
  module.def("pose", &matrix, py::arg("translation") = Point{},
             py::arg("quaternion") = std::array<double, 4>{1, 0, 0, 0},
             "A pose (4, 4) of a translation, metres, and a quaternion (w, x, y, z) of length 1 "
             "within 1e-3.");
}

void add_probes(py::class_<Peer> peer_class) {
  peer_class
      .def(
          "probe_rays",
          [](Peer& peer, BodyId body, const Doubles& origins, const Doubles& directions,
             const Doubles& range_m) {
            return of_body<RayAnswer>(peer, body, rays_of(origins, directions, range_m));
          },
          py::arg("body"), py::arg("origins"), py::arg("directions") = kDown,
          py::arg("range_m") = kInfinite,
          R"((rows, why) of rays against a body where it was as of the last update, from the detail that is held.

Rows as of Model.probe_rays, some perhaps UNCERTAIN: then `why` says what is missing, and the next updates ask for it. An uncertain ray
meets nothing before at_least_m.)")
      .def(
          "probe_points",
          [](Peer& peer, BodyId body, const Doubles& points) {
            return of_body<PointAnswer>(peer, body, points_of(points, "points"));
          },
          py::arg("body"), py::arg("points"), "(rows, why), as Model.probe_points.")
      .def(
          "probe_balls",
          [](Peer& peer, BodyId body, const Doubles& centers, const Doubles& radii) {
            return of_body<ShapeAnswer>(peer, body, balls_of(centers, radii));
          },
          py::arg("body"), py::arg("centers"), py::arg("radii"),
          "(rows, why), as Model.probe_balls.")
      .def(
          "probe_boxes",
          [](Peer& peer, BodyId body, const Doubles& poses, const Doubles& half_m) {
            return of_body<ShapeAnswer>(peer, body, boxes_of(poses, half_m));
          },
          py::arg("body"), py::arg("poses"), py::arg("half_m"),
          "(rows, why), as Model.probe_boxes.")
      .def(
          "hear",
          [](Peer& peer, const py::dict& heard) {
            std::vector<Session::HeardPose> poses;
            for (const auto& [body, given] : heard) {
              const BodyId id = body_of(body);
              const std::string number = std::to_string(id.value);
              const auto pair = py::cast<py::tuple>(given);
              if (pair.size() != 2)
                refuse("body " + number + ": expected (time_s, pose or Motion)");
              poses.push_back({id, given_as<double>(pair[0], "time_s of body " + number),
                               motion_of(pair[1], id)});
            }
            need(unlocked(peer, [&](Session& session) { return session.hear(poses); }));
          },
          py::arg("poses"),
          "Poses of bodies that others move, heard on a topic of the host's: {body: (time_s, pose "
          "or Motion)}. The next "
          "update takes them in; they age alike, and are not sent again.");
}

}  // namespace nearmesh::python
