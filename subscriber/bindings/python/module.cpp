// SPDX-License-Identifier: Apache-2.0
// The Python module nearmesh._nearmesh. What users import is nearmesh/__init__.py, whose types
// stand in __init__.pyi.

#include "bindings.hpp"

namespace nearmesh::python {
namespace {

struct SegmentRow {
  std::array<double, 3> p_m, q_m;
  std::uint32_t patch;
};
struct PatchRow {
  std::uint32_t first, count;
  std::array<double, 3> centroid_m, normal;
  double normal_error_rad, length_m;
  bool normal_is_of_a;
  std::array<std::array<double, 3>, 4> manifold_m;
  std::uint32_t manifold_count;
  double manifold_error_m;
};

struct ContactArrays {
  py::array_t<SegmentRow> segments;
  py::array_t<PatchRow> patches;
  double position_error_m;
  bool truncated;
};

}  // namespace

void raise(const Status& status) {
  const char* name = "Error";
  switch (status.code()) {
    case StatusCode::kInvalidArgument:
      name = "InvalidArgumentError";
      break;
    case StatusCode::kNotFound:
      name = "NotFoundError";
      break;
    case StatusCode::kCorrupt:
      name = "CorruptError";
      break;
    case StatusCode::kUnsupported:
      name = "UnsupportedError";
      break;
    case StatusCode::kIo:
      name = "IoError";
      break;
    case StatusCode::kConflict:
      name = "ConflictError";
      break;
    case StatusCode::kOk:
      break;
  }
  const py::gil_scoped_acquire lock;
  const py::object type = py::module_::import("nearmesh.errors").attr(name);
  PyErr_SetString(type.ptr(), status.message().c_str());
  throw py::error_already_set();
}

std::vector<Pose> poses_of(const Doubles& matrices, const char* name) {
  const py::ssize_t dimensions = matrices.ndim();
  if ((dimensions != 2 && dimensions != 3) || matrices.shape(dimensions - 1) != 4 ||
      matrices.shape(dimensions - 2) != 4)
    refuse(std::string(name) + ": expected an array (4, 4) or (n, 4, 4), found " +
           std::string(py::str(py::tuple(matrices.attr("shape")))));
  const auto count = static_cast<std::size_t>(dimensions == 3 ? matrices.shape(0) : 1);
  std::vector<Pose> poses(count);
  const double* m = matrices.data();
  for (Pose& pose : poses) {
    for (std::size_t row = 0; row < 3; ++row) {
      for (std::size_t column = 0; column < 3; ++column)
        pose.rotation[3 * row + column] = m[4 * row + column];
      pose.translation_m[row] = m[4 * row + 3];
    }
    if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
      refuse(std::string(name) + ": the last row of a pose is 0 0 0 1");
    m += 16;
  }
  return poses;
}

Pose pose_of(const Doubles& matrix, const char* name) {
  if (matrix.ndim() != 2) refuse(std::string(name) + ": expected one pose, an array (4, 4)");
  return poses_of(matrix, name)[0];
}

Matrix matrix_of(const Pose& pose) {
  Matrix matrix{};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column)
      matrix[row][column] = pose.rotation[3 * row + column];
    matrix[row][3] = pose.translation_m[row];
  }
  matrix[3][3] = 1;
  return matrix;
}

Doubles vector_of(const std::array<double, 3>& v) { return Doubles(3, v.data()); }

Doubles array_of(const Matrix& matrix) {
  return Doubles(std::vector<py::ssize_t>{4, 4}, matrix[0].data());
}

Clearance clearance_of(const std::string& name) {
  if (name == "none") return Clearance::kNone;
  if (name == "bound") return Clearance::kBound;
  if (name == "exact") return Clearance::kExact;
  refuse("clearance: expected none, bound or exact, found " + name);
}

py::object contacts_object(const Contacts& contacts) {
  std::vector<SegmentRow> segments;
  for (const ContactSegment& segment : contacts.segments)
    segments.push_back({segment.p_m, segment.q_m, 0});
  std::vector<PatchRow> patches;
  for (const ContactPatch& patch : contacts.patches) {
    for (std::uint32_t i = patch.first; i < patch.first + patch.count; ++i)
      segments[i].patch = static_cast<std::uint32_t>(patches.size());
    patches.push_back({patch.first, patch.count, patch.centroid_m, patch.normal,
                       patch.normal_error_rad, patch.length_m, patch.normal_is_of_a,
                       patch.manifold_m, patch.manifold_count, patch.manifold_error_m});
  }
  return py::cast(ContactArrays{rows_of(segments), rows_of(patches), contacts.position_error_m,
                                contacts.truncated});
}

}  // namespace nearmesh::python

PYBIND11_MODULE(_nearmesh, module) {
  using namespace nearmesh::python;
  using nearmesh::Depth;
  PYBIND11_NUMPY_DTYPE(SegmentRow, p_m, q_m, patch);
  PYBIND11_NUMPY_DTYPE(PatchRow, first, count, centroid_m, normal, normal_error_rad, length_m,
                       normal_is_of_a, manifold_m, manifold_count, manifold_error_m);
  module.attr("__version__") = NEARMESH_VERSION;
  py::class_<ContactArrays>(module, "Contacts", R"(Where two bodies touch, world frame, metres.

segments: p_m, q_m (ends of what two faces have in common), patch (index into patches); each exact to position_error_m.
patches: segments [first, first + count), centroid_m, normal (unit, from a to b), normal_error_rad (pi: no normal),
length_m, normal_is_of_a; manifold_m: at most four points that span it, the first manifold_count of the rows, of whose hull no
point of its segments is farther than manifold_error_m.)")
      .def_readonly("segments", &ContactArrays::segments, "A structured array, by patch.")
      .def_readonly("patches", &ContactArrays::patches, "A structured array.")
      .def_readonly("position_error_m", &ContactArrays::position_error_m,
                    "Every point lies within this of both faces.")
      .def_readonly("truncated", &ContactArrays::truncated,
                    "There are more than these, and patches may be torn.");
  py::class_<Depth>(
      module, "Depth",
      R"(How deep b is in a along a direction, metres: how far b has to be moved until it is free of a.

Both bounds are proofs. Moved by less than at_least_m along direction, b touches a all the way; with separation_m added to the
translation of b's pose both are certified free (at_most_m is infinite where no such place was found).)")
      .def_property_readonly(
          "direction", [](const Depth& depth) { return vector_of(depth.direction); },
          "Unit vector, world frame: the way b is moved.")
      .def_readonly("at_least_m", &Depth::at_least_m, "The depth is no less; 0: nothing is proved.")
      .def_readonly("at_most_m", &Depth::at_most_m,
                    "The depth is no more; infinite where no free place was found.")
      .def_property_readonly(
          "separation_m", [](const Depth& depth) { return vector_of(depth.separation_m); },
          "Add it to the translation of b's pose: then both are certified free.")
      .def_property_readonly(
          "missing",
          [](const Depth& depth) { return depth.missing_a.size() + depth.missing_b.size(); },
          "Nodes whose detail would narrow it.")
      .def_readonly("exhausted", &Depth::exhausted, "The search was ended by its length.");
  add_models(module);
  add_sessions(module);
  add_recordings(module);
}
