// SPDX-License-Identifier: Apache-2.0
#include "nodes.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <set>
#include <span>
#include <unordered_map>

#include "plain_formats.hpp"

namespace nearmesh::meshio {
namespace {

/// Faces, with the positions that they use.
IndexedMesh copy_faces(const IndexedMesh& mesh, std::size_t begin, std::size_t count) {
  IndexedMesh out;
  std::unordered_map<std::uint32_t, std::uint32_t> places;
  for (std::size_t f = begin; f < begin + count; ++f) {
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t v = mesh.faces[f][k];
      const auto [at, is_new] =
          places.emplace(v, static_cast<std::uint32_t>(out.positions_m.size()));
      if (is_new) out.positions_m.push_back(mesh.positions_m[v]);
      corners[k] = at->second;
    }
    out.faces.push_back(corners);
  }
  return out;
}

using Vector = std::array<double, 3>;
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// transform = motion * rest, the rest without translation. Gram and Schmidt's columns; where there
/// are none, since the node is flat, all is rest.
struct MotionAndRest {
  Transform motion, rest;
};
MotionAndRest split_motion(const Transform& transform) {
  MotionAndRest out;
  std::array<Vector, 3> columns{}, axes{};
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t r = 0; r < 3; ++r) columns[c][r] = transform.m[r][c];
  bool is_flat = false;
  for (std::size_t c = 0; c < 2; ++c) {
    Vector axis = columns[c];
    // Twice: what the first pass leaves of a narrow angle is rounding.
    for (int pass = 0; pass < 2 && c == 1; ++pass) {
      const double along = dot(axes[0], axis);
      for (std::size_t k = 0; k < 3; ++k) axis[k] -= along * axes[0][k];
    }
    const double length = std::sqrt(dot(axis, axis));
    is_flat = is_flat || !(length > 1e-9 * std::sqrt(dot(columns[c], columns[c])));
    for (std::size_t k = 0; k < 3; ++k) axes[c][k] = axis[k] / length;
  }
  axes[2] = {axes[0][1] * axes[1][2] - axes[0][2] * axes[1][1],
             axes[0][2] * axes[1][0] - axes[0][0] * axes[1][2],
             axes[0][0] * axes[1][1] - axes[0][1] * axes[1][0]};
  for (std::size_t r = 0; r < 3; ++r) out.motion.m[r][3] = transform.m[r][3];
  if (is_flat) {
    out.rest = transform;
    for (auto& row : out.rest.m) row[3] = 0;
    return out;
  }
  double off = 0;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) {
      out.motion.m[r][c] = axes[c][r];
      out.rest.m[r][c] = dot(axes[r], columns[c]);
      off = std::max(off, std::fabs(out.rest.m[r][c] - (r == c ? 1.0 : 0.0)));
    }
  // Rotations come in single precision. What is left of one is no scale that anybody wrote.
  if (off < 1e-6) out.rest = {};
  return out;
}

std::string file_name_of(const std::string& name, std::set<std::string>& taken) {
  std::string safe;
  for (const char c : name)
    safe += std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_' || c == '.'
                ? c
                : '_';
  if (safe.empty() || safe.front() == '.') safe = "node" + safe;
  std::string unique = safe;
  for (int i = 2; !taken.insert(unique).second; ++i) unique = safe + "_" + std::to_string(i);
  return unique;
}

ImportedNode make_node(const SceneMesh& scene, const ScenePart& part, std::size_t first_face,
                       const Transform& to_model) {
  ImportedNode node;
  node.mesh = copy_faces(scene.mesh, first_face, part.face_count);
  const MotionAndRest split = split_motion(part.to_file);
  transform_part(node.mesh, 0, node.mesh.positions_m.size(), 0, node.mesh.faces.size(),
                 compose(to_model, split.rest));
  // The model is turned, so its motion is seen from turned axes: turn * motion * turn^-1.
  const double s =
      std::sqrt(to_model.m[0][0] * to_model.m[0][0]);  // the first axis is never turned
  Transform turn = to_model, back;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) turn.m[r][c] /= s;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) back.m[r][c] = turn.m[c][r];
  const Transform motion = compose(compose(turn, split.motion), back);
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) node.rotation[3 * r + c] = motion.m[r][c];
    node.translation_m[r] = s * motion.m[r][3];
  }
  return node;
}

/// A part of an OBJ file for each run of faces; the vertices, which all may use, with the first.
Result<SceneMesh> read_obj_runs(std::string_view bytes) {
  std::vector<ObjObject> objects;
  Result<IndexedMesh> mesh = read_obj(bytes, &objects);
  NEARMESH_RETURN_IF_ERROR(mesh);
  SceneMesh scene{.mesh = std::move(mesh).value()};
  const std::size_t faces = scene.mesh.faces.size();
  if (!objects.empty() && objects.front().first_face > 0) objects.insert(objects.begin(), {"", 0});
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const std::size_t end = i + 1 < objects.size() ? objects[i + 1].first_face : faces;
    scene.parts.push_back({.name = objects[i].name, .face_count = end - objects[i].first_face});
  }
  if (!scene.parts.empty()) scene.parts.front().position_count = scene.mesh.positions_m.size();
  return scene;
}

/// Orders the faces of an OBJ by object, objects of one name together, and keeps those wanted: all,
/// or the object of that name.
Status unite_objects(SceneMesh& scene, const std::string& wanted) {
  std::vector<ScenePart> united;
  std::vector<std::vector<std::array<std::uint32_t, 3>>> faces;
  std::map<std::string, std::size_t> places;
  std::size_t first = 0;
  for (const ScenePart& part : scene.parts) {
    const auto [at, is_new] = places.emplace(part.name, united.size());
    if (is_new) {
      united.push_back({.name = part.name});
      faces.emplace_back();
    }
    for (std::size_t f = first; f < first + part.face_count; ++f)
      faces[at->second].push_back(scene.mesh.faces[f]);
    first += part.face_count;
  }
  scene.parts.clear();
  scene.mesh.faces.clear();
  for (std::size_t i = 0; i < united.size(); ++i) {
    if (!wanted.empty() && united[i].name != wanted) continue;
    united[i].face_count = faces[i].size();
    scene.mesh.faces.insert(scene.mesh.faces.end(), faces[i].begin(), faces[i].end());
    scene.parts.push_back(united[i]);
  }
  if (scene.parts.empty()) {
    std::string names;
    for (const auto& [name, place] : places)
      if (!name.empty() && names.size() < 1000) names += (names.empty() ? "" : ", ") + name;
    return {StatusCode::kNotFound, "no object is named " + wanted + "; there are " + names};
  }
  scene.parts.front().position_count = scene.mesh.positions_m.size();
  return Status::ok();
}

}  // namespace

Transform to_model(const MeshOrigin& origin) {
  const double s = origin.unit_m * origin.scale;
  if (origin.z_up && origin.up == UpAxis::kY) return {{{s, 0, 0, 0}, {0, 0, -s, 0}, {0, s, 0, 0}}};
  return {{{s, 0, 0, 0}, {0, s, 0, 0}, {0, 0, s, 0}}};
}

void transform_part(IndexedMesh& mesh, std::size_t position, std::size_t position_count,
                    std::size_t face, std::size_t face_count, const Transform& transform) {
  if (transform.is_identity()) return;  // which leaves even what is not finite as it is
  for (std::size_t v = position; v < position + position_count; ++v)
    mesh.positions_m[v] = transform.apply(mesh.positions_m[v]);
  if (transform.mirrors())
    for (std::size_t f = face; f < face + face_count; ++f)
      std::swap(mesh.faces[f][1], mesh.faces[f][2]);
}

std::vector<ImportedNode> take_apart(const SceneMesh& scene, const Transform& to_model,
                                     const std::string& name) {
  std::vector<ImportedNode> nodes;
  std::set<std::string> taken;
  const ScenePart whole{.name = name, .face_count = scene.mesh.faces.size()};
  const std::span<const ScenePart> parts =
      scene.parts.empty() ? std::span(&whole, 1) : std::span<const ScenePart>(scene.parts);
  std::size_t face = 0;
  for (const ScenePart& part : parts) {
    if (part.face_count > 0) {
      nodes.push_back(make_node(scene, part, face, to_model));
      nodes.back().name = file_name_of(part.name, taken);
    }
    face += part.face_count;
  }
  return nodes;
}

Result<SceneMesh> read_obj_objects(std::string_view bytes, const std::string& wanted) {
  Result<SceneMesh> scene = read_obj_runs(bytes);
  NEARMESH_RETURN_IF_ERROR(scene);
  NEARMESH_RETURN_IF_ERROR(unite_objects(scene.value(), wanted));
  return scene;
}

}  // namespace nearmesh::meshio
