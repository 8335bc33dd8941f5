// SPDX-License-Identifier: Apache-2.0
// Models: baking them from arrays, and asking two of them at hand.

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <optional>

#include "bindings.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"

namespace nearmesh::python {
namespace {

using Indices = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;

/// Numbers of vertices. A fraction, or a number that is none, NumPy would cut off, with a warning
/// at most: another mesh.
Indices indices_of(const py::object& given) {
  const auto numbers = py::array::ensure(given);
  if (numbers && numbers.dtype().kind() == 'f') {
    const auto exact = Doubles::ensure(numbers);
    for (py::ssize_t i = 0; i < exact.size(); ++i) {
      const double number = exact.data()[i];
      if (std::trunc(number) != number || std::abs(number) > 0x1p53)
        refuse("faces: " + std::string(py::str(py::float_(number))) + " is no number of a vertex");
    }
  }
  const auto indices = Indices::ensure(given);
  if (!numbers || !indices) {
    PyErr_Clear();
    refuse("faces: expected an array (n, 3) of numbers of vertices");
  }
  return indices;
}

IndexedMesh mesh_of(const Doubles& vertices, const Indices& faces) {
  const auto check = [](const py::array& array, const char* name) {
    if (array.ndim() != 2 || array.shape(1) != 3)
      refuse(std::string(name) + ": expected an array (n, 3), found " +
             std::string(py::str(py::tuple(array.attr("shape")))));
  };
  check(vertices, "vertices");
  check(faces, "faces");
  IndexedMesh mesh;
  mesh.positions_m.resize(static_cast<std::size_t>(vertices.shape(0)));
  mesh.faces.resize(static_cast<std::size_t>(faces.shape(0)));
  const double* x = vertices.data();
  for (std::array<double, 3>& position : mesh.positions_m)
    for (double& coordinate : position) coordinate = *x++;
  const std::int64_t* index = faces.data();
  for (std::size_t face = 0; face < mesh.faces.size(); ++face) {
    for (std::uint32_t& corner : mesh.faces[face]) {
      if (*index < 0 || *index >= vertices.shape(0))
        refuse("faces: face " + std::to_string(face) + " names vertex " + std::to_string(*index) +
               ", of " + std::to_string(vertices.shape(0)));
      corner = static_cast<std::uint32_t>(*index++);
    }
  }
  if (mesh.faces.empty()) refuse("faces: expected at least one");
  return mesh;
}

std::shared_ptr<Model> bake_arrays(const Doubles& vertices, const py::object& faces,
                                   const std::string& path, Whole<int> grid_bits,
                                   Whole<unsigned> threads) {
  const IndexedMesh mesh = mesh_of(vertices, indices_of(faces));
  if (grid_bits < kMinGridBits || grid_bits > kMaxGridBits)
    refuse("grid_bits: expected " + std::to_string(kMinGridBits) + " to " +
           std::to_string(kMaxGridBits) + ", found " + std::to_string(grid_bits));
  const auto write = [&]() -> Status {
    const py::gil_scoped_release others_may_run;
    Result<CleanResult> clean = clean_mesh(mesh, {.grid_bits = grid_bits});
    NEARMESH_RETURN_IF_ERROR(clean);
    SimplifyOptions options;
    options.threads = threads;
    const Result<BakedModel> baked =
        bake(clean.value().mesh, clean.value().report.rounding_error_m, options);
    NEARMESH_RETURN_IF_ERROR(baked);
    return detail::status_of(write_model_file(baked.value().header, baked.value().store,
                                              baked.value().numbers, path, threads));
  };
  need(write());
  return std::make_shared<Model>(path);
}

py::tuple mesh_arrays(Model& model) {
  IndexedMesh mesh;
  const auto read = [&]() -> Status {
    const py::gil_scoped_release others_may_run;
    const std::lock_guard lock(model.mutex);
    const Result<FaceNumbering> numbering = model.file.face_numbering();
    NEARMESH_RETURN_IF_ERROR(numbering);
    const SplitStore& store = model.file.store();
    const Grid& grid = model.file.header().grid;
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
      std::array<double, 3> at = grid.origin_m;
      for (int k = 0; k < 3; ++k)
        at[static_cast<std::size_t>(k)] += std::ldexp(store.position({v})[k], grid.exponent);
      mesh.positions_m.push_back(at);
    }
    std::vector<std::pair<std::uint32_t, std::array<std::uint32_t, 3>>> faces;
    const auto add = [&](FaceKey key, const SplitFace& face) {
      const FaceNumber number = numbering.value()[key];
      const std::array<VertexId, 3> corners = face.corners();
      std::array<std::uint32_t, 3> turned{};
      for (std::size_t k = 0; k < 3; ++k) turned[k] = corners[(number.first_corner + k) % 3].value;
      faces.emplace_back(number.face.value, turned);
    };
    for (std::uint32_t i = 0; i < store.base_faces().size(); ++i)
      add({{}, i}, store.base_faces()[i]);
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
      if (store.is_root({v})) continue;
      std::uint32_t i = 0;
      for (const SplitFace& face : store.faces({v})) add({{v}, i++}, face);
    }
    std::sort(faces.begin(), faces.end());
    for (const auto& numbered : faces) mesh.faces.push_back(numbered.second);
    return Status::ok();
  };
  need(read());
  return py::make_tuple(rows_of(mesh.positions_m), rows_of(mesh.faces));
}

struct AnswerRow {
  std::uint8_t status, contained;
  bool certified;
  std::uint64_t pairs;
  double clearance_m, clearance_share, uncertainty_m;
  std::uint64_t digest;
  bool exhausted;
  double distance_at_most_m;
  std::array<double, 3> nearest_a_m, nearest_b_m;
};

/// Two models at hand, each refined as far as any question needed.
class Pair {
 public:
  Pair(std::shared_ptr<Model> a, std::shared_ptr<Model> b, bool solid_a, bool solid_b)
      : a_(std::move(a)), b_(std::move(b)) {
    if (solid_a) need(check_solid(a_->file.header().surface, "a"));
    if (solid_b) need(check_solid(b_->file.header().surface, "b"));
    solid_.solid_a = solid_a;
    solid_.solid_b = solid_b;
  }

  py::array_t<AnswerRow> query(const Doubles& poses_a, const Doubles& poses_b,
                               const std::string& clearance, bool any,
                               std::optional<std::uint64_t> max_tests) {
    const std::vector<Pose> at_a = poses_of(poses_a, "poses_a"),
                            at_b = poses_of(poses_b, "poses_b");
    if (at_a.size() != at_b.size() && at_a.size() != 1 && at_b.size() != 1)
      refuse("poses_a has " + std::to_string(at_a.size()) + " poses, poses_b " +
             std::to_string(at_b.size()) + ": expected as many, or one");
    QueryOptions options = solid_;
    options.any = any;
    options.max_tests = max_tests.value_or(kAllTests);
    options.clearance = clearance_of(clearance);
    std::vector<AnswerRow> rows(at_a.empty() || at_b.empty() ? 0
                                                             : std::max(at_a.size(), at_b.size()));
    read([&]() -> Status {
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const Result<Asked> asked =
            ask(at_a[at_a.size() == 1 ? 0 : i], at_b[at_b.size() == 1 ? 0 : i], options);
        if (!asked.is_ok())
          return {asked.status().code(),
                  "pose " + std::to_string(i) + ": " + asked.status().message()};
        const Answer& answer = asked.value().answer;
        rows[i] = {static_cast<std::uint8_t>(answer.status),
                   static_cast<std::uint8_t>(answer.contained),
                   is_certified(answer.status),
                   answer.pair_total,
                   answer.clearance_m,
                   answer.clearance_share,
                   answer.uncertainty_m,
                   digest(answer),
                   answer.exhausted,
                   answer.distance_at_most_m,
                   answer.nearest_a_m,
                   answer.nearest_b_m};
      }
      return Status::ok();
    });
    return rows_of(rows);
  }

  py::object contacts(const Doubles& pose_a, const Doubles& pose_b) {
    const Pose at_a = pose_of(pose_a, "pose_a"), at_b = pose_of(pose_b, "pose_b");
    Contacts contacts;
    read([&]() -> Status {
      const Result<Asked> asked = ask(at_a, at_b, solid_);
      NEARMESH_RETURN_IF_ERROR(asked);
      contacts = find_contacts(held_a_->view(), asked.value().posed.a, held_b_->view(),
                               asked.value().posed.b, asked.value().answer);
      return Status::ok();
    });
    return contacts_object(contacts);
  }

  py::object depth(const Doubles& pose_a, const Doubles& pose_b,
                   const std::vector<std::array<double, 3>>& directions,
                   Whole<std::uint64_t> max_tests) {
    const Pose at_a = pose_of(pose_a, "pose_a"), at_b = pose_of(pose_b, "pose_b");
    std::optional<Depth> depth;
    read([&]() -> Status {
      const Result<Asked> asked = ask(at_a, at_b, solid_);
      NEARMESH_RETURN_IF_ERROR(asked);
      const Answer& answer = asked.value().answer;
      if (answer.pairs.empty()) return Status::ok();
      const Contacts contacts = find_contacts(held_a_->view(), asked.value().posed.a,
                                              held_b_->view(), asked.value().posed.b, answer);
      Result<Depth> found = certify_depth(*held_a_, at_a, require_of(a_->file), *held_b_, at_b,
                                          require_of(b_->file), answer, contacts,
                                          {.directions = directions,
                                           .solid_a = solid_.solid_a,
                                           .solid_b = solid_.solid_b,
                                           .max_tests = max_tests});
      NEARMESH_RETURN_IF_ERROR(found);
      depth = std::move(found).value();
      return Status::ok();
    });
    return depth ? py::cast(*depth) : py::none();
  }

  py::array_t<std::uint32_t> faces(const Doubles& pose_a, const Doubles& pose_b) {
    const Pose at_a = pose_of(pose_a, "pose_a"), at_b = pose_of(pose_b, "pose_b");
    std::vector<std::array<std::uint32_t, 2>> faces;
    read([&]() -> Status {
      const Result<Asked> asked = ask(at_a, at_b, solid_);
      NEARMESH_RETURN_IF_ERROR(asked);
      for (const auto& [model, numbering] :
           {std::pair{a_.get(), &numbering_a_}, std::pair{b_.get(), &numbering_b_}}) {
        if (*numbering) continue;
        Result<FaceNumbering> read = model->file.face_numbering();
        NEARMESH_RETURN_IF_ERROR(read);
        *numbering = std::move(read).value();
      }
      for (const FacePair& pair : asked.value().answer.pairs)
        faces.push_back({(*numbering_a_)[pair.a].face.value, (*numbering_b_)[pair.b].face.value});
      std::sort(faces.begin(), faces.end());
      return Status::ok();
    });
    const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(faces.size()), 2};
    return py::array_t<std::uint32_t>(shape, faces.empty() ? nullptr : faces[0].data());
  }

  [[nodiscard]] std::size_t held_splits() {
    const py::gil_scoped_release others_may_run;
    const Locks locks = lock();
    return (held_a_ ? held_a_->mesh.split_count() : 0) +
           (held_b_ ? held_b_->mesh.split_count() : 0);
  }

 private:
  /// Both models may be one, and other pairs may have them too.
  using Locks = std::array<std::unique_lock<std::mutex>, 2>;
  [[nodiscard]] Locks lock() {
    Locks locks{std::unique_lock(a_->mutex, std::defer_lock), {}};
    if (a_ == b_) {
      locks[0].lock();
    } else {
      locks[1] = std::unique_lock(b_->mutex, std::defer_lock);
      std::lock(locks[0], locks[1]);
    }
    return locks;
  }

  template <class Body>
  void read(const Body& body) {
    const auto run = [&]() -> Status {
      const py::gil_scoped_release others_may_run;
      const Locks locks = lock();
      const auto forget = [this] {
        held_a_.reset();
        held_b_.reset();
      };
      return reading({a_.get(), b_.get()}, forget, body);
    };
    need(run());
  }

  static Require require_of(ModelFile& file) {
    return [&file](NodeSpan node) { return file.require(node); };
  }

  struct Asked {
    PosedPair posed;
    Answer answer;
  };
  Result<Asked> ask(const Pose& at_a, const Pose& at_b, const QueryOptions& options) {
    const Result<PosedPair> posed =
        pose_pair(a_->file.header().grid, at_a, "a", b_->file.header().grid, at_b, "b");
    NEARMESH_RETURN_IF_ERROR(posed);
    if (!held_a_) held_a_.emplace(a_->file.store(), a_->file.header().grid);
    if (!held_b_) held_b_.emplace(b_->file.store(), b_->file.header().grid);
    Result<Answer> answer = certify(*held_a_, posed.value().a, require_of(a_->file), *held_b_,
                                    posed.value().b, require_of(b_->file), options);
    NEARMESH_RETURN_IF_ERROR(answer);
    return Asked{posed.value(), std::move(answer).value()};
  }

  std::shared_ptr<Model> a_, b_;
  std::optional<LocalModel> held_a_, held_b_;  // as far as questions have needed them
  QueryOptions solid_;
  std::optional<FaceNumbering> numbering_a_, numbering_b_;
};

}  // namespace

void add_models(py::module_& module) {
  PYBIND11_NUMPY_DTYPE(AnswerRow, status, contained, certified, pairs, clearance_m, clearance_share,
                       uncertainty_m, digest, exhausted, distance_at_most_m, nearest_a_m,
                       nearest_b_m);
  const auto model_class =
      py::class_<Model, std::shared_ptr<Model>>(
          module, "Model",
          "A .spm file. Detail is read from it when it is first needed. IoError where it cannot be "
          "read, CorruptError where it is damaged, UnsupportedError for another version.")
          .def(py::init<const std::string&>(), py::arg("path"))
          .def_property_readonly(
              "path", [](const Model& m) { return m.file.path(); }, "As it was opened.")
          .def_property_readonly(
              "content", [](const Model& m) { return to_hex(m.file.content_hash()); },
              "Names the whole content: models with equal values are the same.")
          .def_property_readonly(
              "vertex_count", [](const Model& m) { return m.file.header().vertex_count; },
              "Of the full mesh.")
          .def_property_readonly(
              "face_count", [](const Model& m) { return m.file.header().face_count; },
              "Of the full mesh.")
          .def_property_readonly(
              "cell_m",
              [](const Model& m) { return std::ldexp(1.0, m.file.header().grid.exponent); },
              "Vertices were rounded to a grid of this cell, metres.")
          .def_property_readonly(
              "rounding_error_m", [](const Model& m) { return m.file.header().rounding_bound_m(); },
              "No input vertex is farther from its place on the grid, metres.")
          .def("mesh", &mesh_arrays,
               "The full mesh: vertices (n, 3) float64, metres, and faces (m, 3) uint32 in the "
               "input's "
               "order.");
  add_probes(module, model_class);
  module.def("bake", &bake_arrays, py::arg("vertices"), py::arg("faces"), py::arg("path"),
             py::kw_only(), py::arg("grid_bits") = 21, py::arg("threads") = 0U,
             R"(Writes a progressive model of a triangle mesh to `path` and opens it.

vertices (n, 3), metres; faces (m, 3), counter-clockwise seen from outside. Vertices are rounded to a grid of so many bits
an axis (4 to 31), equal ones welded, double faces dropped. threads: 0 for one a core; the file is the same for any number. Some seconds a
million faces. InvalidArgumentError names the vertex or face; ConflictError where `path` is there and is no model.)");
  py::class_<Pair>(module, "Pair", R"(Two models at hand, asked about as often as one likes.

Holds what the questions so far needed of each. One question at a time; other threads of Python run meanwhile.)")
      .def(py::init<std::shared_ptr<Model>, std::shared_ptr<Model>, bool, bool>(), py::arg("a"),
           py::arg("b"), py::kw_only(), py::arg("solid_a") = false, py::arg("solid_b") = false)
      .def(
          "query", &Pair::query, py::arg("poses_a"), py::arg("poses_b"), py::kw_only(),
          py::arg("clearance") = "bound", py::arg("any") = false, py::arg("max_tests") = py::none(),
          R"(Answers for poses (n, 4, 4), or (4, 4) that stands for all: a structured array of n rows.

status: Status. certified: True but where max_tests ended the search, or a solid has too many parts. pairs: how many pairs of faces touch.
clearance_m: lower bound of the distance where free; clearance_share: how near it is to the greatest that can be proved; distance_at_most_m:
it is no more, between nearest_a_m and nearest_b_m. contained: Contained. uncertainty_m: not certified, how far unseen faces may be from
what is held. digest: equal answers, equal digests. exhausted: max_tests, of 2 to 25 ns, were spent; partial or uncertain then, with what
was found.

clearance: "none", "bound" (three quarters of what can be known) or "exact". any: stop at the first pair that touches. max_tests: None, no
end.)")
      .def("depth", &Pair::depth, py::arg("pose_a"), py::arg("pose_b"),
           py::arg("directions") = std::vector<std::array<double, 3>>{},
           py::arg("max_tests") = kDepthTests,
           "How deep b is in a, and which way it is out soonest: of the directions given, else of "
           "the contacts' normals. None where nothing touches. The search ends after max_tests, of "
           "2 to 5 ns: exhausted.")
      .def("contacts", &Pair::contacts, py::arg("pose_a"), py::arg("pose_b"),
           "Where they touch, for one pose (4, 4) of each: Contacts.")
      .def("faces", &Pair::faces, py::arg("pose_a"), py::arg("pose_b"),
           "Which faces touch, (n, 2) uint32: places in the arrays or files that the models were "
           "baked from.")
      .def_property_readonly("held_splits", &Pair::held_splits,
                             "Vertex splits that the questions so far needed, of both models.");
}

}  // namespace nearmesh::python
