// SPDX-License-Identifier: Apache-2.0
// Scenes of input that is not as one would wish it: F4, F5, F16; and of limits and threads: F13,
// F18.
#include <filesystem>
#include <fstream>
#include <limits>

#include "meshes.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "oracle.hpp"
#include "scenes.hpp"
#include "shapes.hpp"

namespace nearmesh::stability {
namespace {

using Point = std::array<double, 3>;

IndexedMesh unit_box() { return test::make_box({.5, .5, .5}, 2); }

/// The box with one more face, whose corners are the points given, each a vertex of its own.
IndexedMesh with_face(const std::vector<Point>& corners, const std::array<std::uint32_t, 3>& face) {
  return joined(unit_box(), {corners, {face}});
}

}  // namespace

std::vector<Case> degenerate_cases() {
  std::vector<Case> cases;
  const auto add = [&cases](const std::string& name, const IndexedMesh& a, const IndexedMesh& b,
                            const Pose& pose_b = {}) {
    Case c{.name = name, .a = {share(a), {}}, .b = {share(b), pose_b}};
    c.touches = touches(c.a, c.b);
    cases.push_back(c);
  };
  const IndexedMesh plane = test::make_plane(4, 4);
  const Point root{.125, .25, -.5}, tip{.125, .25, -1};
  const double cell = 0x1p-20;
  struct Whisker {
    const char* name;
    IndexedMesh mesh;
  };
  const std::vector<Whisker> whiskers{
      {"whisker of a repeated index", with_face({root, tip}, {0, 1, 1})},
      {"whisker of a repeated position", with_face({root, tip, tip}, {0, 1, 2})},
      {"whisker of three points on a line", with_face({root, tip, {.125, .25, -.75}}, {0, 1, 2})},
      {"point of a repeated index", with_face({tip}, {0, 0, 0})},
      {"point of a repeated position", with_face({tip, tip, tip}, {0, 1, 2})},
      {"sliver one cell wide", with_face({root, tip, {.125 + cell, .25, -1}}, {0, 1, 2})},
      {"sliver of two cells' height",
       with_face({root, tip, {.125 + 2 * cell, .25, -.75}}, {0, 1, 2})},
  };
  for (const Whisker& w : whiskers) {
    add(std::string(w.name) + ", tip on a face", w.mesh, plane, at(0, 0, -1));
    add(std::string(w.name) + ", tip on an edge", w.mesh, plane, at(.125, .25, -1));
    add(std::string(w.name) + ", one cell short", w.mesh, plane, at(0, 0, -1 - cell));
    if (std::string(w.name).starts_with("whisker"))
      add(std::string(w.name) + ", through a face", w.mesh, plane, at(0, 0, -.75));
  }
  const auto segment = [](const Point& p, const Point& q) {
    return IndexedMesh{{p, q}, {{0, 1, 1}}};
  };
  const IndexedMesh along_x = segment({-1, 0, 0}, {1, 0, 0}),
                    along_y = segment({0, -1, 0}, {0, 1, 0});
  add("segments that cross", along_x, along_y);
  add("segments one cell apart", along_x, along_y, at(0, 0, cell));
  add("segments that share an end", along_x, along_y, at(1, 1, 0));
  add("segments one behind the other, touching", along_x, along_x, at(2, 0, 0));
  add("segments one behind the other, apart", along_x, along_x, at(2 + cell, 0, 0));
  add("segments that overlap", along_x, along_x, at(.5, 0, 0));
  const IndexedMesh point{{{0, 0, 0}}, {{0, 0, 0}}};
  add("point on point", point, point);
  add("points one cell apart", point, point, at(0x1p-22, 0, 0));
  add("point on a segment", along_x, point, at(.5, 0, 0));
  add("point beside a segment", along_x, point, at(.5, cell, 0));
  add("point in a triangle", plane, point, at(.25, .125, 0));
  add("point on a corner", plane, point, at(2, 2, 0));
  add("point off the border", plane, point, at(2 + cell, 0, 0));
  add("triangles with vertices of their own, touching", unwelded(unit_box()), unwelded(plane),
      at(0, 0, .5));
  add("triangles with vertices of their own, apart", unwelded(unit_box()), unwelded(plane),
      at(0, 0, .5 + cell));
  IndexedMesh twice = joined(unit_box(), unit_box());
  add("every face twice, touching", twice, plane, at(0, 0, -.5));
  add("every face twice, apart", twice, plane, at(0, 0, -.5 - cell));
  return cases;
}

std::vector<Case> invalid_cases() {
  std::vector<Case> cases;
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kDenormal = std::numeric_limits<double>::denorm_min();
  const MeshPtr box = share(unit_box());
  struct Wrong {
    const char* name;
    double value;
  };
  for (const Wrong& wrong :
       {Wrong{"NaN", kNan}, {"infinity", kInfinity}, {"-infinity", -kInfinity}}) {
    // Bodies that touch, and bodies that do not: neither may be told of a pose that is no pose.
    for (const double x : {.5, 4.0}) {
      const std::string where = x < 1 ? ", bodies at hand" : ", bodies apart";
      Case c{.question = Question::kInvalid, .a = {box, {}}, .b = {box, at(x, 0, 0)}};
      for (std::size_t i = 0; i < 3; ++i) {
        Case moved = c;
        moved.name = "translation " + std::to_string(i) + " is " + wrong.name + where;
        moved.b.pose.translation_m[i] = wrong.value;
        cases.push_back(moved);
      }
      for (const std::size_t i : {0U, 4U, 7U}) {
        Case turned = c;
        turned.name = "rotation " + std::to_string(i) + " is " + wrong.name + where;
        turned.b.pose.rotation[i] = wrong.value;
        cases.push_back(turned);
      }
      for (const std::size_t i : {0U, 2U}) {
        IndexedMesh mesh = unit_box();
        mesh.positions_m[5][i] = wrong.value;
        Case broken = c;
        broken.name = "a vertex's coordinate " + std::to_string(i) + " is " + wrong.name + where;
        broken.b.mesh = share(mesh);
        cases.push_back(broken);
      }
    }
  }
  const auto extreme = [&cases](const std::string& name, const Body& a, const Body& b) {
    cases.push_back(
        {.name = name, .question = Question::kExtreme, .a = a, .b = b, .touches = touches(a, b)});
  };
  for (const double far_m : {1e18, 1e154, 1e308, -1e308})
    for (std::size_t i = 0; i < 3; ++i) {
      Pose pose;
      pose.translation_m[i] = far_m;
      char name[48];
      std::snprintf(name, sizeof name, "translation %zu is %g", i, far_m);
      extreme(name, {box, {}}, {box, pose});
      std::snprintf(name, sizeof name, "both translations %zu are %g", i, far_m);
      extreme(name, {box, pose}, {box, pose});
    }
  for (const double far_m : {1e154, 1e308}) {
    IndexedMesh spike = unit_box();
    spike.positions_m[0] = {far_m, 0, 0};
    char name[48];
    std::snprintf(name, sizeof name, "a vertex at %g m", far_m);
    extreme(name, {box, {}}, {share(spike), at(.25, 0, 0)});
    extreme(std::string(name) + ", apart", {box, {}}, {share(spike), at(4, 0, 0)});
  }
  // Matrices that are no rotations: refused, or taken for the affine maps that they are.
  const auto shaped = [&](const char* name, const std::array<double, 9>& rotation) {
    for (const double x : {1.25, 1.75}) {
      Pose pose = at(x, 0, 0);
      pose.rotation = rotation;
      extreme(std::string(name) + (x < 1.5 ? ", near" : ", farther"), {box, {}}, {box, pose});
    }
  };
  shaped("rotation of twice the size", {2, 0, 0, 0, 2, 0, 0, 0, 2});
  shaped("rotation of half the size", {.5, 0, 0, 0, .5, 0, 0, 0, .5});
  shaped("sheared rotation", {1, 1, 0, 0, 1, 0, 0, 0, 1});
  shaped("reflection", {-1, 0, 0, 0, 1, 0, 0, 0, 1});
  shaped("rotation of zeros", {});
  shaped("rotation from a quaternion of length 2", {4, 0, 0, 0, 4, 0, 0, 0, 4});
  shaped("rotation of 1e200", {1e200, 0, 0, 0, 1e200, 0, 0, 0, 1e200});
  // Odd but sound: these have an answer, and it must be given.
  const auto sound = [&cases](const std::string& name, const Body& a, const Body& b) {
    cases.push_back({.name = name, .a = a, .b = b, .touches = touches(a, b)});
  };
  sound("denormal translation, deep in each other", {box, {}},
        {box, at(.5, kDenormal, -kDenormal)});
  sound("denormal translation, apart", {box, {}}, {box, at(4, kDenormal, kDenormal)});
  sound("negative zeros", {box, {}}, {box, at(1, -0.0, -0.0)});
  const IndexedMesh tiny = one_triangle({0, 0, 0}, {4 * kDenormal, 0, 0}, {0, 4 * kDenormal, 0});
  // Its cell and a metre have no common lattice: such a pair may be refused.
  extreme("a mesh of denormal size in a face", {share(test::make_plane(2, 2)), {}},
          {share(tiny), {}});
  extreme("a mesh of denormal size far from a face", {share(test::make_plane(2, 2)), {}},
          {share(tiny), at(0, 0, 1)});
  return cases;
}

std::vector<Case> thread_cases() {
  std::vector<Case> cases;
  for (Case c : touching_cases()) {
    if (c.a.mesh->faces.size() > 2000) continue;
    c.question = Question::kThreads;
    cases.push_back(c);
  }
  return cases;
}

std::vector<Case> limit_cases() {
  std::vector<Case> cases;
  const MeshPtr cube = share(test::make_box({.5, .5, .5}, 4));
  const MeshPtr sphere = share(snapped(generate_sphere(64, 0), -19));
  const std::vector<std::pair<Body, Body>> bodies{{{cube, {}}, {cube, at(1, 0, 0)}},
                                                  {{cube, {}}, {cube, at(1, 1, 1)}},
                                                  {{cube, {}}, {cube, at(2, 0, 0)}},
                                                  {{sphere, {}}, {sphere, at(0, 0, 2)}}};
  for (const auto& [a, b] : bodies) {
    const std::uint64_t pairs = touching_pairs(a, b).size();
    for (const std::uint64_t limit :
         {std::uint64_t{1}, std::uint64_t{10}, pairs - 1, pairs, pairs + 1}) {
      if (limit < 1 || limit > 10'000) continue;
      cases.push_back({.name = std::to_string(pairs) + " pairs, limit " + std::to_string(limit),
                       .question = Question::kLimit,
                       .a = a,
                       .b = b,
                       .touches = pairs > 0,
                       .pairs = pairs,
                       .limit = limit});
    }
  }
  return cases;
}

std::vector<Case> file_cases(const std::string& data_folder) {
  const std::filesystem::path folder = std::filesystem::path(data_folder) / "bad";
  std::ifstream table(folder / "bad_expected.csv");
  std::vector<Case> cases;
  std::string row;
  std::getline(table, row);  // heading
  while (std::getline(table, row)) {
    const std::size_t comma = row.find(','), next = row.find(',', comma + 1);
    const std::string name = row.substr(0, comma), rule = row.substr(comma + 1, next - comma - 1);
    cases.push_back({.name = name,
                     .question = Question::kFile,
                     .path = (folder / name).string(),
                     .file_rule = rule == "load"     ? FileRule::kLoad
                                  : rule == "reject" ? FileRule::kReject
                                                     : FileRule::kEither});
  }
  return cases;
}

}  // namespace nearmesh::stability
