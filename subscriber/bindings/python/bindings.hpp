// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the parts of the Python module share: errors, poses and rows of arrays.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <initializer_list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/depth.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh::python {

namespace py = pybind11;

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// Raises the exception of nearmesh/errors.py that stands for the code, with the status's own text.
/// With the interpreter's lock or without.
[[noreturn]] void raise(const Status& status);
inline void need(const Status& status) {
  if (!status.is_ok()) raise(status);
}
template <class T>
[[nodiscard]] T need(Result<T> result) {
  if (!result.is_ok()) raise(result.status());
  return std::move(result).value();
}
[[noreturn]] inline void refuse(const std::string& why) {
  raise({StatusCode::kInvalidArgument, why});
}

/// A whole number as an argument of a function of Python's: an int, or what stands for one
/// (operator.index). What may have a fraction, as numpy.float32 and Decimal, is refused: pybind11
/// would cut the fraction off.
template <class T>
struct Whole {
  T value = 0;
  operator T() const { return value; }  // NOLINT(google-explicit-constructor): it stands for it
};

/// What Python gave as `name`. Raises where it is none of that type, or a number out of its range.
template <class T>
[[nodiscard]] T given_as(const py::handle& given, const std::string& name) {
  try {
    if constexpr (std::is_integral_v<T> && !std::is_same_v<T, bool>) {
      return py::cast<Whole<T>>(given);
    } else {
      return py::cast<T>(given);
    }
  } catch (const py::cast_error&) {
    refuse(name + ": found " + std::string(py::repr(given)) + ", of a wrong type or out of range");
  }
}

/// Rigid placements as homogeneous matrices, x_world = M x_model, metres: an array (n, 4, 4), or
/// (4, 4) for one. Raises where the shape or a last row is another; whether a rotation is one is
/// checked where it is used.
[[nodiscard]] std::vector<Pose> poses_of(const Doubles& matrices, const char* name);
[[nodiscard]] Pose pose_of(const Doubles& matrix, const char* name);
using Matrix = std::array<std::array<double, 4>, 4>;
[[nodiscard]] Matrix matrix_of(const Pose& pose);
[[nodiscard]] Doubles array_of(const Matrix& matrix);
/// An array (3).
[[nodiscard]] Doubles vector_of(const std::array<double, 3>& v);
/// An array (n, 3) of its own.
template <class T>
[[nodiscard]] py::array_t<T> rows_of(const std::vector<std::array<T, 3>>& rows) {
  const std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(rows.size()), 3};
  return py::array_t<T>(shape, rows.empty() ? nullptr : rows[0].data());
}
/// A structured array of its own.
template <class Row>
[[nodiscard]] py::array_t<Row> rows_of(const std::vector<Row>& rows) {
  return py::array_t<Row>(static_cast<py::ssize_t>(rows.size()), rows.data());
}

/// A content's 32 digits, as a field of rows.
using HexText = std::array<char, 32>;
[[nodiscard]] inline HexText hex_of(const ContentHash& content) {
  HexText text{};
  const std::string hex = to_hex(content);
  std::copy(hex.begin(), hex.end(), text.begin());
  return text;
}

/// Clearance by its name in Python: "none", "bound", "exact".
[[nodiscard]] Clearance clearance_of(const std::string& name);

/// A model file that may be shared by whatever is made of it.
struct Model {
  explicit Model(const std::string& path) : file(need(ModelFile::open(path))) {}
  ModelFile file;
  /// Of the file and of all that reads from it: Python's other threads run on meanwhile.
  std::mutex mutex;
  std::optional<LocalModel> probed;  ///< as far as probes have needed it
  bool is_spoiled = false;           ///< see reading()
};

/// Runs `body`, which reads `models` and refines what is held of them. Where it fails, mesh and
/// tree may have parted: `forget` drops them. After an exception, such as want of memory, the
/// files' own tables may be half-way: the models are refused from then on.
template <class Forget, class Body>
[[nodiscard]] Status reading(std::initializer_list<Model*> models, const Forget& forget,
                             const Body& body) {
  for (const Model* model : models)
    if (model->is_spoiled)
      return {StatusCode::kConflict,
              model->file.path() + ": an earlier call ended half-way; open the model again"};
  try {
    const Status status = body();
    if (!status.is_ok() && status.code() != StatusCode::kInvalidArgument) forget();
    return status;
  } catch (...) {
    for (Model* model : models) model->is_spoiled = true;
    throw;
  }
}

/// Contacts as arrays.
[[nodiscard]] py::object contacts_object(const Contacts& contacts);

void add_models(py::module_& module);
/// What the class Model has of probes; poses of quaternions.
void add_probes(py::module_& module, py::class_<Model, std::shared_ptr<Model>> model);
void add_sessions(py::module_& module);
void add_recordings(py::module_& module);

}  // namespace nearmesh::python

template <class T>
struct pybind11::detail::type_caster<nearmesh::python::Whole<T>> {
  PYBIND11_TYPE_CASTER(nearmesh::python::Whole<T>, const_name("int"));

  bool load(handle given, bool) {
    if (PyIndex_Check(given.ptr()) == 0) return false;
    make_caster<T> number;
    if (!number.load(reinterpret_steal<object>(PyNumber_Index(given.ptr())), false)) {
      PyErr_Clear();
      return false;
    }
    value.value = cast_op<T>(number);
    return true;
  }
};
