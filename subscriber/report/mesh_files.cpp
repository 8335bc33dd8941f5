// SPDX-License-Identifier: Apache-2.0
#include "mesh_files.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "gltf.hpp"

namespace nearmesh::subscriber::report {
namespace {

/// One vertex of a PLY file.
void put_vertex(std::string& out, const Vector& at, const Colour& colour, double eps_m) {
  for (const double x : at) put(out, x);
  put(out, colour);
  put(out, static_cast<float>(eps_m));
}

/// Slender tetrahedra around the segments of contact, four faces each: few programs draw a file's
/// lines, fewer in their colour.
struct Splints {
  std::vector<Vector> positions;
  std::vector<std::array<std::uint32_t, 3>> faces;
};

/// Half their thickness: a 200th of the extent of all contacts, or of the smaller body where they
/// are at one point.
double splint_radius_m(const RecordedScene& scene) {
  double extent_m = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    double lo = std::numeric_limits<double>::max(), hi = std::numeric_limits<double>::lowest();
    for (const ContactSegment& segment : scene.contacts.segments)
      for (const double at : {segment.p_m[k], segment.q_m[k]}) {
        lo = std::min(lo, at);
        hi = std::max(hi, at);
      }
    extent_m = std::max(extent_m, hi - lo);
  }
  return (extent_m > 0 ? extent_m : std::min(scene.bodies[0].size_m, scene.bodies[1].size_m)) / 200;
}

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
/// Of length 1; +z for what is too short.
Vector direction(const Vector& d) {
  const double length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  if (!(length > 1e-12)) return {0, 0, 1};
  return {d[0] / length, d[1] / length, d[2] / length};
}

Splints splints_of(const RecordedScene& scene) {
  Splints splints;
  const double radius_m = splint_radius_m(scene);
  for (const ContactSegment& segment : scene.contacts.segments) {
    const Vector &p = segment.p_m, &q = segment.q_m;
    const Vector along = direction({q[0] - p[0], q[1] - p[1], q[2] - p[2]});
    Vector axis{};
    std::size_t least = 0;
    for (std::size_t k = 1; k < 3; ++k)
      if (std::abs(along[k]) < std::abs(along[least])) least = k;
    axis[least] = 1;
    const Vector aside = direction(cross(along, axis)), up = cross(along, aside);
    const auto first = static_cast<std::uint32_t>(splints.positions.size());
    // An edge across each end, a little beyond it, at right angles.
    const auto put_end = [&](const Vector& end, double beyond, const Vector& across) {
      for (const double side : {radius_m, -radius_m}) {
        Vector at;
        for (std::size_t k = 0; k < 3; ++k) at[k] = end[k] + beyond * along[k] + side * across[k];
        splints.positions.push_back(at);
      }
    };
    put_end(p, -radius_m, aside);
    put_end(q, radius_m, up);
    for (const auto& [a, b, c] : {std::array{0U, 1U, 2U}, {1U, 0U, 3U}, {2U, 1U, 3U}, {0U, 2U, 3U}})
      splints.faces.push_back({first + a, first + b, first + c});
  }
  return splints;
}

std::vector<Colour> colours_of(const RecordedBody& body, bool other) {
  std::vector<Colour> colours;
  for (const double eps_m : body.eps_m) colours.push_back(vertex_colour(eps_m, body.size_m, other));
  return colours;
}

}  // namespace

std::string to_ply(const RecordedScene& scene, std::size_t looked_at) {
  const std::array<const RecordedBody*, 2> bodies{&scene.bodies[looked_at],
                                                  &scene.bodies[1 - looked_at]};
  const std::size_t segments = scene.contacts.segments.size();
  const Splints splints = splints_of(scene);
  std::size_t vertices = splints.positions.size() + 2 * segments, faces = splints.faces.size();
  for (const RecordedBody* body : bodies) {
    vertices += body->positions_world_m.size();
    faces += body->faces.size();
  }
  std::string out = "ply\nformat binary_little_endian 1.0\n";
  out += std::string("comment ") + kColourScale + "\n";
  out += "comment quality: eps in metres, 0 where exact\n";
  out += "element vertex " + std::to_string(vertices) + "\n";
  out += "property double x\nproperty double y\nproperty double z\n";
  out += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  out += "property float quality\n";
  out += "element face " + std::to_string(faces) + "\n";
  out += "property list uchar int vertex_indices\n";
  out += "element edge " + std::to_string(segments) + "\n";
  out += "property int vertex1\nproperty int vertex2\n";
  out += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  for (const RecordedBody* body : bodies)
    for (std::size_t i = 0; i < body->positions_world_m.size(); ++i)
      put_vertex(out, body->positions_world_m[i],
                 vertex_colour(body->eps_m[i], body->size_m, body != bodies[0]), body->eps_m[i]);
  for (const Vector& at : splints.positions) put_vertex(out, at, kContactColour, 0);
  for (const ContactSegment& segment : scene.contacts.segments) {
    put_vertex(out, segment.p_m, kContactColour, 0);
    put_vertex(out, segment.q_m, kContactColour, 0);
  }
  std::uint32_t first = 0;
  const auto put_faces = [&](const auto& some, std::size_t vertices_of_them) {
    for (const auto& face : some) {
      put(out, std::uint8_t{3});
      for (const std::uint32_t corner : face) put(out, first + corner);
    }
    first += static_cast<std::uint32_t>(vertices_of_them);
  };
  for (const RecordedBody* body : bodies) put_faces(body->faces, body->positions_world_m.size());
  put_faces(splints.faces, splints.positions.size());
  for (std::size_t i = 0; i < segments; ++i, first += 2) {
    put(out, first);
    put(out, first + 1);
    put(out, kContactColour);
  }
  return out;
}

Result<std::string> to_glb(const RecordedScene& scene, std::size_t looked_at) {
  const Vector origin = (looked_at == 0 ? scene.report.a : scene.report.b).pose.translation_m;
  Gltf gltf;
  for (const bool other : {false, true}) {
    const RecordedBody& body = scene.bodies[other ? 1 - looked_at : looked_at];
    if (body.faces.empty()) continue;  // an accessor may not be empty
    const auto positions = gltf.add_positions(body.positions_world_m, origin);
    const auto colours = gltf.add_colours(colours_of(body, other));
    const auto eps_m = gltf.add_numbers(body.eps_m);
    const std::size_t mesh = gltf.add_mesh(
        body.name,
        {{{"attributes", {{"POSITION", positions}, {"COLOR_0", colours}, {"_EPS_M", eps_m}}},
          {"indices", gltf.add_indices(body.faces)},
          {"mode", 4}}});
    gltf.set(gltf.add_node(body.name), "mesh", mesh);
  }
  if (!scene.contacts.segments.empty()) {
    std::vector<Vector> ends;
    for (const ContactSegment& segment : scene.contacts.segments) {
      ends.push_back(segment.p_m);
      ends.push_back(segment.q_m);
    }
    const Splints splints = splints_of(scene);
    const auto attributes = [&](const std::vector<Vector>& at) -> nlohmann::ordered_json {
      const auto positions = gltf.add_positions(at, origin);
      return {{"POSITION", positions},
              {"COLOR_0", gltf.add_colours(std::vector<Colour>(at.size(), kContactColour))}};
    };
    nlohmann::ordered_json lines = {{"attributes", attributes(ends)}, {"mode", 1}};
    nlohmann::ordered_json solids = {{"attributes", attributes(splints.positions)},
                                     {"indices", gltf.add_indices(splints.faces)},
                                     {"mode", 4}};
    const std::size_t mesh = gltf.add_mesh("contacts", {std::move(lines), std::move(solids)});
    gltf.set(gltf.add_node("contacts"), "mesh", mesh);
  }
  return std::move(gltf).finish(origin, {{"colours", kColourScale}});
}

}  // namespace nearmesh::subscriber::report
