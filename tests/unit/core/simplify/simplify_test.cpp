// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/simplify/detail/simplify.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/random.hpp"
#include "rounds.hpp"

namespace nearmesh {
namespace {

using FaceList = std::vector<std::array<std::uint32_t, 3>>;

GridMesh with_face_ids(GridMesh mesh) {
  for (std::uint32_t i = 0; i < mesh.faces.size(); ++i) mesh.face_ids.push_back(FaceId{i});
  return mesh;
}

/// cells x cells squares of `step` units, two faces each, upward; z as given.
GridMesh height_field(std::uint32_t cells, std::int32_t step,
                      const std::function<std::int32_t(std::uint32_t, std::uint32_t)>& z) {
  GridMesh mesh;
  for (std::uint32_t y = 0; y <= cells; ++y)
    for (std::uint32_t x = 0; x <= cells; ++x)
      mesh.positions.push_back(
          {{static_cast<std::int32_t>(x) * step, static_cast<std::int32_t>(y) * step, z(x, y)}});
  const auto at = [&](std::uint32_t x, std::uint32_t y) { return y * (cells + 1) + x; };
  for (std::uint32_t y = 0; y < cells; ++y)
    for (std::uint32_t x = 0; x < cells; ++x) {
      mesh.faces.push_back({at(x, y), at(x + 1, y), at(x + 1, y + 1)});
      mesh.faces.push_back({at(x, y), at(x + 1, y + 1), at(x, y + 1)});
    }
  return with_face_ids(std::move(mesh));
}

GridMesh flat_square(std::uint32_t cells) {
  return height_field(cells, 1000, [](auto, auto) { return 0; });
}

/// Rough ground made of integers only: random heights on lattices of 16, 8, 4, 2 and 1 cells, with
/// slopes below 45 degrees.
GridMesh rough_terrain(std::uint32_t cells) {
  const auto lattice = [](std::uint32_t x, std::uint32_t y, std::uint32_t level) {
    return static_cast<std::int32_t>(
        Random(x * 65536ULL + y + (std::uint64_t{level} << 40)).below(1000));
  };
  return height_field(cells, 1000, [&](std::uint32_t x, std::uint32_t y) {
    std::int32_t sum = 5000;
    for (std::uint32_t level = 0; level < 5; ++level) {
      const std::uint32_t size = 1U << level;
      const auto fx = static_cast<std::int32_t>(x % size), fy = static_cast<std::int32_t>(y % size);
      const auto n = static_cast<std::int32_t>(size);
      const std::uint32_t ix = x / size, iy = y / size;
      const std::int32_t low = lattice(ix, iy, level) * (n - fx) + lattice(ix + 1, iy, level) * fx;
      const std::int32_t high =
          lattice(ix, iy + 1, level) * (n - fx) + lattice(ix + 1, iy + 1, level) * fx;
      sum += (low * (n - fy) + high * fy) / (n * 4);
    }
    return sum;
  });
}

/// Octahedron, each face cut in four `levels` times, pushed out to a sphere: closed and manifold.
GridMesh sphere(int levels) {
  std::vector<std::array<double, 3>> points = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                               {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
  FaceList faces = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                    {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [it, is_new] = middles.try_emplace(std::minmax(a, b), points.size());
      if (is_new) {
        std::array<double, 3> p{};
        double length2 = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          p[k] = points[a][k] + points[b][k];
          length2 += p[k] * p[k];
        }
        for (double& x : p) x /= std::sqrt(length2);
        points.push_back(p);
      }
      return it->second;
    };
    FaceList finer;
    for (const auto& [a, b, c] : faces) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    faces = std::move(finer);
  }
  GridMesh mesh;
  mesh.faces = std::move(faces);
  for (const auto& p : points) {
    GridPoint q;
    for (int k = 0; k < 3; ++k)
      q[k] = static_cast<std::int32_t>(std::floor((p[static_cast<std::size_t>(k)] + 1) * 1e6));
    mesh.positions.push_back(q);
  }
  return with_face_ids(std::move(mesh));
}

/// Thin ring of three-sided section: closed and manifold; its sections are rings of three edges
/// without a face, which only the link condition keeps open.
GridMesh wire_ring(std::uint32_t around, double size, double thickness) {
  GridMesh mesh;
  for (std::uint32_t i = 0; i < around; ++i)
    for (std::uint32_t j = 0; j < 3; ++j) {
      const double turn = 2 * 3.14159265358979 * i / around, tilt = 2 * 3.14159265358979 * j / 3;
      const double radius = size + thickness * std::cos(tilt);
      const std::array<double, 3> p = {radius * std::cos(turn), radius * std::sin(turn),
                                       thickness * std::sin(tilt)};
      GridPoint q;
      for (int k = 0; k < 3; ++k)
        q[k] = static_cast<std::int32_t>(std::floor(p[static_cast<std::size_t>(k)])) + 100000;
      mesh.positions.push_back(q);
    }
  const auto at = [&](std::uint32_t i, std::uint32_t j) { return i % around * 3 + j % 3; };
  for (std::uint32_t i = 0; i < around; ++i)
    for (std::uint32_t j = 0; j < 3; ++j) {
      mesh.faces.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.faces.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return with_face_ids(std::move(mesh));
}

void append(GridMesh& mesh, const GridMesh& other, std::int32_t shift_x) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (GridPoint p : other.positions) {
    p[0] += shift_x;
    mesh.positions.push_back(p);
  }
  for (const auto& [a, b, c] : other.faces) mesh.faces.push_back({first + a, first + b, first + c});
}

void add_tetrahedron(GridMesh& mesh, const GridPoint& corner, std::int32_t size) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (const auto& [x, y, z] : FaceList{{0, 0, 0}, {1, 1, 0}, {1, 0, 1}, {0, 1, 1}}) {
    GridPoint p = corner;
    p[0] += x != 0 ? size : 0;
    p[1] += y != 0 ? size : 0;
    p[2] += z != 0 ? size : 0;
    mesh.positions.push_back(p);
  }
  for (const auto& [a, b, c] : FaceList{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}})
    mesh.faces.push_back({first + a, first + b, first + c});
}

GridMesh tetrahedra(std::uint32_t count) {
  GridMesh mesh;
  Random random(7);
  const auto coordinate = [&] { return static_cast<std::int32_t>(random.below(1U << 20)); };
  for (std::uint32_t i = 0; i < count; ++i) {
    const GridPoint corner{{coordinate(), coordinate(), coordinate()}};
    add_tetrahedron(mesh, corner, 100 + static_cast<std::int32_t>(random.below(1000)));
  }
  return with_face_ids(std::move(mesh));
}

GridMesh soup(std::uint32_t vertices, std::uint32_t faces) {
  GridMesh mesh;
  Random random(11);
  for (std::uint32_t i = 0; i < vertices; ++i) {
    GridPoint p;
    for (int k = 0; k < 3; ++k) p[k] = static_cast<std::int32_t>(random.below(1U << 21));
    mesh.positions.push_back(p);
  }
  while (mesh.faces.size() < faces) {
    const std::array<std::uint32_t, 3> f = {random.below(vertices), random.below(vertices),
                                            random.below(vertices)};
    if (f[0] != f[1] && f[1] != f[2] && f[2] != f[0]) mesh.faces.push_back(f);
  }
  return with_face_ids(std::move(mesh));
}

/// Sheets of 8 x 8 cells that share one spine of nine vertices.
GridMesh book(int pages) {
  GridMesh mesh;
  for (std::int32_t y = 0; y <= 8; ++y) mesh.positions.push_back({{50000, y * 1000, 50000}});
  for (std::int32_t page = 0; page < pages; ++page) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    for (std::int32_t x = 1; x <= 8; ++x)
      for (std::int32_t y = 0; y <= 8; ++y)
        mesh.positions.push_back(
            {{50000 + x * (page - 4) * 250, y * 1000, 50000 + x * (page % 3 + 1) * 300}});
    const auto at = [&](std::uint32_t x, std::uint32_t y) {
      return x == 0 ? y : first + (x - 1) * 9 + y;
    };
    for (std::uint32_t x = 0; x < 8; ++x)
      for (std::uint32_t y = 0; y < 8; ++y) {
        mesh.faces.push_back({at(x, y), at(x + 1, y), at(x + 1, y + 1)});
        mesh.faces.push_back({at(x, y), at(x + 1, y + 1), at(x, y + 1)});
      }
  }
  return with_face_ids(std::move(mesh));
}

/// A rim of `count` vertices, wavy so that no two of its edges are alike, around the grid's middle.
GridMesh rim(std::uint32_t count) {
  GridMesh mesh;
  for (std::uint32_t i = 0; i < count; ++i) {
    const double turn = 2 * 3.14159265358979 * i / count,
                 size = 900000 + 50000 * std::sin(7 * turn);
    mesh.positions.push_back({{static_cast<std::int32_t>(1000000 + size * std::cos(turn)),
                               static_cast<std::int32_t>(1000000 + size * std::sin(turn)),
                               static_cast<std::int32_t>(500000 + 40000 * std::sin(11 * turn))}});
  }
  return mesh;
}

/// All faces around one vertex, between it and the rim.
GridMesh fan(std::uint32_t faces) {
  GridMesh mesh = rim(faces);
  mesh.positions.push_back({{1000000, 1000000, 900000}});
  for (std::uint32_t i = 0; i < faces; ++i) mesh.faces.push_back({i, (i + 1) % faces, faces});
  return with_face_ids(std::move(mesh));
}

/// The same closed by a second vertex below.
GridMesh two_fans(std::uint32_t faces) {
  GridMesh mesh = fan(faces / 2);
  const std::uint32_t around = faces / 2;
  mesh.positions.push_back({{1000000, 1000000, 100000}});
  for (std::uint32_t i = 0; i < around; ++i)
    mesh.faces.push_back({(i + 1) % around, i, around + 1});
  return with_face_ids(std::move(mesh));
}

/// Every other face of a fan: they have one vertex in common and nothing else.
GridMesh blades(std::uint32_t faces) {
  GridMesh mesh = fan(2 * faces);
  FaceList kept;
  for (std::size_t i = 0; i < mesh.faces.size(); i += 2) kept.push_back(mesh.faces[i]);
  mesh.faces = std::move(kept);
  mesh.face_ids.clear();
  return with_face_ids(std::move(mesh));
}

/// All faces on one edge.
GridMesh faces_on_an_edge(std::uint32_t faces) {
  GridMesh mesh = rim(faces);
  mesh.positions.push_back({{1000000, 1000000, 900000}});
  mesh.positions.push_back({{1000000, 1000000, 100000}});
  for (std::uint32_t i = 0; i < faces; ++i) mesh.faces.push_back({i, faces, faces + 1});
  return with_face_ids(std::move(mesh));
}

/// Side by side, so many of them.
GridMesh many(std::uint32_t count, const GridMesh& one) {
  GridMesh mesh;
  for (std::uint32_t i = 0; i < count; ++i)
    append(mesh, one, static_cast<std::int32_t>(i) * 2000001);
  return with_face_ids(std::move(mesh));
}

/// A tangle in which `hubs` vertices have `faces` each, every one with an edge of a path through
/// random places.
GridMesh tangled_hubs(std::uint32_t hubs, std::uint32_t faces) {
  GridMesh mesh;
  Random random(13);
  const std::uint32_t path = hubs * faces / 2;
  for (std::uint32_t i = 0; i < path + hubs; ++i) {
    GridPoint p;
    for (int k = 0; k < 3; ++k) p[k] = static_cast<std::int32_t>(random.below(1U << 20));
    mesh.positions.push_back(p);
  }
  for (std::uint32_t i = 0; i < hubs * faces; ++i) {
    const std::uint32_t at = random.below(path);
    mesh.faces.push_back({at, (at + 1) % path, path + i % hubs});
  }
  return with_face_ids(std::move(mesh));
}

CollapseLog run(const GridMesh& mesh, std::uint32_t base_faces) {
  SimplifyOptions options;
  options.base_faces = base_faces;
  return simplify(mesh, options);
}

/// The mesh after the first `count` collapses, straight from the definition.
FaceList replay(const GridMesh& mesh, const CollapseLog& log, std::size_t count) {
  std::vector<std::uint32_t> kept(mesh.positions.size());
  for (std::uint32_t i = 0; i < kept.size(); ++i) kept[i] = i;
  for (std::size_t i = count; i-- > 0;)
    kept[log.collapses[i].removed] = kept[log.collapses[i].kept];
  FaceList faces;
  for (auto f : mesh.faces) {
    for (std::uint32_t& c : f) c = kept[c];
    if (f[0] != f[1] && f[1] != f[2] && f[2] != f[0]) faces.push_back(f);
  }
  return faces;
}
FaceList replay(const GridMesh& mesh, const CollapseLog& log) {
  return replay(mesh, log, log.collapses.size());
}

/// Empty when the log may be replayed; otherwise what is wrong.
std::string first_fault(const GridMesh& mesh, const CollapseLog& log) {
  std::vector<bool> is_removed(mesh.positions.size());
  for (const Collapse& c : log.collapses) {
    if (c.removed >= is_removed.size() || c.kept >= is_removed.size()) return "index out of range";
    if (c.removed == c.kept) return "merged into itself";
    if (is_removed[c.removed]) return "removed twice";
    if (is_removed[c.kept]) return "kept after it was removed";
    is_removed[c.removed] = true;
  }
  if (log.collapses.size() != log.edge_collapses + log.clustered) return "counts do not add up";
  return "";
}

/// Everything simplify promises of any input.
void expect_reached(const GridMesh& mesh, std::uint32_t base_faces) {
  const CollapseLog log = run(mesh, base_faces);
  ASSERT_EQ(first_fault(mesh, log), "");
  const FaceList base = replay(mesh, log);
  EXPECT_EQ(base.size(), log.base_faces);
  EXPECT_LE(base.size(), base_faces);
  std::set<std::uint32_t> used;
  for (const auto& f : base) used.insert(f.begin(), f.end());
  const std::size_t left = mesh.positions.size() - log.collapses.size();
  EXPECT_EQ(left, std::max<std::size_t>(used.size(), 1)) << "vertices left without a face";
}

std::uint64_t hash_of(const CollapseLog& log) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const Collapse& c : log.collapses)
    for (const std::uint32_t x : {c.removed, c.kept}) hash = (hash ^ x) * 0x100000001b3ULL;
  return hash;
}

/// Levels of the merge tree when each collapse joins two subtrees.
std::uint32_t depth_of(const GridMesh& mesh, const CollapseLog& log) {
  std::vector<std::uint32_t> depth(mesh.positions.size());
  std::uint32_t greatest = 0;
  for (const Collapse& c : log.collapses) {
    depth[c.kept] = std::max(depth[c.kept], depth[c.removed]) + 1;
    greatest = std::max(greatest, depth[c.kept]);
  }
  return greatest;
}

/// Twice the signed area of the faces' shadow on z = 0.
std::int64_t shadow_area2(const GridMesh& mesh, const std::array<std::uint32_t, 3>& f) {
  const auto d = [&](std::size_t corner, int axis) {
    return std::int64_t{mesh.positions[f[corner]][axis]} - mesh.positions[f[0]][axis];
  };
  return d(1, 0) * d(2, 1) - d(1, 1) * d(2, 0);
}

TEST(Simplify, ReachesTargetOnTerrain) { expect_reached(rough_terrain(64), 256); }

TEST(Simplify, TerrainNeedsEdgeCollapsesAlone) {
  const CollapseLog log = run(rough_terrain(64), 256);
  EXPECT_EQ(log.stop, StopReason::kReachedTarget);
  EXPECT_EQ(log.clustered, 0U);
}

TEST(Simplify, SaysWhenPartsVanishedWhole) {
  const CollapseLog log = run(tetrahedra(300), 256);
  EXPECT_EQ(log.stop, StopReason::kClustered);
  EXPECT_GT(log.clustered, 0U);
}

TEST(Simplify, StopsAtTheTargetNotFarBelow) {
  const CollapseLog log = run(rough_terrain(64), 1000);
  EXPECT_GE(log.base_faces, 998U);
}

TEST(Simplify, DoesNothingToAMeshSmallEnough) {
  const CollapseLog log = run(flat_square(4), 32);
  EXPECT_TRUE(log.collapses.empty());
  EXPECT_EQ(log.stop, StopReason::kNothingToDo);
  EXPECT_EQ(log.base_faces, 32U);
}

TEST(Simplify, GivesTheSameLogForTheSameInput) {
  EXPECT_EQ(hash_of(run(rough_terrain(48), 64)), hash_of(run(rough_terrain(48), 64)));
}

TEST(Simplify, GivesTheSameLogOnEveryMachine) {
  EXPECT_EQ(hash_of(run(rough_terrain(48), 64)), 17007857245013079591ULL);
}

void expect_closed_manifold(const GridMesh& mesh, std::uint32_t base_faces) {
  const CollapseLog log = run(mesh, base_faces);
  for (const std::size_t percent : {0U, 10U, 50U, 90U, 97U, 100U}) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    for (const auto& f : replay(mesh, log, log.collapses.size() * percent / 100))
      for (std::size_t k = 0; k < 3; ++k) ++edges[{f[k], f[(k + 1) % 3]}];
    for (const auto& [edge, faces] : edges) {
      ASSERT_EQ(faces, 1) << "two faces run along an edge the same way, at " << percent << " %";
      ASSERT_TRUE(edges.contains({edge.second, edge.first})) << "open edge at " << percent << " %";
    }
  }
}
TEST(Simplify, KeepsASphereClosedAndManifold) { expect_closed_manifold(sphere(5), 64); }
TEST(Simplify, KeepsAThinRingClosedAndManifold) {
  expect_closed_manifold(wire_ring(128, 40000, 1500), 50);
}

TEST(Simplify, KeepsTheBorderOfASquareInPlace) {
  const GridMesh mesh = flat_square(32);
  const FaceList base = replay(mesh, run(mesh, 40));
  std::int64_t area2 = 0;
  for (const auto& f : base) area2 += std::abs(shadow_area2(mesh, f));
  EXPECT_EQ(area2, std::int64_t{2} * 32000 * 32000);
}

TEST(Simplify, FlipsNoFaceOfAHeightField) {
  const GridMesh mesh = rough_terrain(96);
  for (const auto& f : replay(mesh, run(mesh, 96 * 96 * 2 / 10)))
    ASSERT_GE(shadow_area2(mesh, f), 0);  // upright slivers are no flips
}

TEST(Simplify, StaysCloseToASphere) {
  const GridMesh mesh = sphere(5);  // 8,192 faces
  for (const auto& f : replay(mesh, run(mesh, 800))) {
    double height2 = 0;
    for (int k = 0; k < 3; ++k) {
      double middle = -1e6;
      for (const std::uint32_t c : f) middle += mesh.positions[c][k] / 3.0;
      height2 += middle * middle;
    }
    ASSERT_GT(std::sqrt(height2), 0.97e6);  // the middle of a face of an even sphere of 800: 0.993
  }
}

TEST(Simplify, KeepsTheForestShallowOnAFlatSquare) {
  const GridMesh mesh = flat_square(128);
  EXPECT_LE(depth_of(mesh, run(mesh, 64)), 24U);
}

TEST(Simplify, KeepsTheForestShallowOnTerrain) {
  const GridMesh mesh = rough_terrain(128);
  EXPECT_LE(depth_of(mesh, run(mesh, 64)), 30U);
}

TEST(Simplify, KeepsTheForestShallowAmongDebris) {
  const GridMesh mesh = tetrahedra(3000);
  EXPECT_LE(depth_of(mesh, run(mesh, 64)), 40U);
}

TEST(Simplify, DropsSmallPartsBeforeItSpoilsLargeOnes) {
  GridMesh mesh = sphere(4);
  for (std::int32_t i = 0; i < 50; ++i)
    add_tetrahedron(mesh, GridPoint{{3000000 + 5000 * i, 0, 0}}, 2000);
  mesh = with_face_ids(std::move(mesh));
  const auto sphere_vertices = static_cast<std::uint32_t>(sphere(4).positions.size());
  for (const auto& f : replay(mesh, run(mesh, 200))) EXPECT_LT(f[0], sphere_vertices);
}

TEST(Simplify, GivesUpSmallRingsBeforeItSpoilsASphere) {
  GridMesh mesh = sphere(4);
  const auto sphere_vertices = static_cast<std::uint32_t>(mesh.positions.size());
  for (std::int32_t i = 0; i < 40; ++i)
    append(mesh, wire_ring(16, 3000, 300), 3000000 + 100000 * i);
  mesh = with_face_ids(std::move(mesh));
  const FaceList base = replay(mesh, run(mesh, 300));
  const auto on_sphere = std::count_if(base.begin(), base.end(),
                                       [&](const auto& f) { return f[0] < sphere_vertices; });
  EXPECT_GT(on_sphere, 200);
}

TEST(Simplify, ReachesTargetOnSeparateTetrahedra) { expect_reached(tetrahedra(300), 256); }
TEST(Simplify, ReachesTargetOnASoup) { expect_reached(soup(3000, 3000), 100); }
TEST(Simplify, ReachesTargetOnATangle) { expect_reached(soup(1000, 5000), 100); }
TEST(Simplify, ReachesTargetOnABook) { expect_reached(book(9), 20); }
TEST(Simplify, ReachesOneFaceOnASphere) { expect_reached(sphere(3), 1); }
TEST(Simplify, ReachesOneFaceOnTerrain) { expect_reached(rough_terrain(16), 1); }

TEST(Simplify, ReachesTargetOnAFan) { expect_reached(fan(20000), 256); }
TEST(Simplify, ReachesTargetOnTwoFans) { expect_reached(two_fans(20000), 64); }
TEST(Simplify, ReachesOneFaceOnAFan) { expect_reached(fan(20000), 1); }
TEST(Simplify, ReachesTargetOnBlades) { expect_reached(blades(20000), 256); }
TEST(Simplify, ReachesTargetOnFacesOnAnEdge) { expect_reached(faces_on_an_edge(20000), 256); }
TEST(Simplify, ReachesTargetOnATangleOfFewVertices) { expect_reached(soup(12, 60000), 100); }
TEST(Simplify, KeepsTwoFansClosedAndManifold) { expect_closed_manifold(two_fans(20000), 64); }

// What is counted is the same under sanitizers, and takes them seconds.
class SimplifyWork : public ::testing::Test {
 protected:
  void SetUp() override {
    if (test::kSanitized) GTEST_SKIP() << "counts only";
  }
};

/// What simplification looks at, for each face of the mesh.
double work_per_face(const GridMesh& mesh) {
  return static_cast<double>(run(mesh, 256).work) / static_cast<double>(mesh.faces.size());
}

TEST_F(SimplifyWork, IsNoMoreThanTwiceThatOfTerrainAroundOneVertex) {
  const double terrain = work_per_face(rough_terrain(200));
  EXPECT_LT(work_per_face(fan(80000)), 2 * terrain);
  EXPECT_LT(work_per_face(two_fans(80000)), 2 * terrain);
  EXPECT_LT(work_per_face(blades(80000)), 2 * terrain);
  EXPECT_LT(work_per_face(faces_on_an_edge(80000)), 2 * terrain);
}

TEST_F(SimplifyWork, IsNoMoreThanFourTimesThatOfTerrainAroundManyVertices) {
  const double terrain = work_per_face(rough_terrain(200));
  for (const auto& one : {fan(2000), two_fans(4000), blades(2000), faces_on_an_edge(2000)})
    EXPECT_LT(work_per_face(many(20, one)), 4 * terrain);
}

TEST_F(SimplifyWork, OfATangleIsLessThanHalfWhereItsFacesShareFewVertices) {
  EXPECT_LT(2 * work_per_face(tangled_hubs(10, 2000)), work_per_face(tangled_hubs(400, 50)));
}

TEST_F(SimplifyWork, IsTheSameForEachFaceHoweverManyShareAVertex) {
  for (const auto& mesh : {fan, two_fans, blades, faces_on_an_edge})
    EXPECT_LT(work_per_face(mesh(80000)), 1.5 * work_per_face(mesh(20000)) + 10);
}

TEST(Simplify, LeavesASingleTriangleAlone) {
  GridMesh mesh;
  mesh.positions = {{{0, 0, 0}}, {{5, 0, 0}}, {{0, 5, 0}}};
  mesh.faces = {{0, 1, 2}};
  EXPECT_TRUE(run(with_face_ids(mesh), 1).collapses.empty());
}

TEST(Simplify, ReachesTargetWhenAllPositionsAreEqual) {
  GridMesh mesh = flat_square(10);
  for (GridPoint& p : mesh.positions) p = GridPoint{{3, 3, 3}};
  expect_reached(mesh, 10);
}

TEST(Simplify, ReachesTargetOnFacesWithoutArea) {
  GridMesh mesh = flat_square(10);
  for (GridPoint& p : mesh.positions) p[1] = 0;
  expect_reached(mesh, 10);
}

TEST(Simplify, ReachesTargetWhenFacesLieTwice) {
  GridMesh mesh = rough_terrain(12);
  mesh.faces.insert(mesh.faces.end(), mesh.faces.begin(), mesh.faces.end());
  mesh.face_ids.clear();
  expect_reached(with_face_ids(mesh), 30);
}

TEST(Simplify, ReachesTargetAtTheEndsOfTheGrid) {
  GridMesh mesh = rough_terrain(24);
  for (GridPoint& p : mesh.positions)
    for (int k = 0; k < 3; ++k)
      p[k] = static_cast<std::int32_t>(std::int64_t{p[k]} * 0x7fffffff / 24000);
  mesh.grid.bits = 31;
  expect_reached(mesh, 30);
}

TEST(Simplify, MergesVerticesWithoutFaces) {
  GridMesh mesh = flat_square(4);
  for (std::int32_t i = 0; i < 100; ++i)
    mesh.positions.push_back({{i * 37 % 4000, i * 91 % 4000, 500}});
  expect_reached(mesh, 32);
}

TEST(Simplify, ReportsProgressInOrderAndSeldom) {
  std::vector<double> shares;
  SimplifyOptions options;
  options.base_faces = 10;
  options.on_progress = [&](double share) { shares.push_back(share); };
  static_cast<void>(simplify(rough_terrain(64), options));
  EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
  EXPECT_EQ(shares.back(), 1.0);
  EXPECT_LE(shares.size(), 200U);
  EXPECT_GE(shares.size(), 50U);
}

// ---- meshes large enough to be simplified cell by cell first ------------------------------------

CollapseLog run_on(const GridMesh& mesh, std::uint32_t base_faces, unsigned threads) {
  return simplify(mesh, {.base_faces = base_faces, .threads = threads});
}

void expect_same_on_threads(const GridMesh& mesh) {
  ASSERT_GT(mesh.positions.size(), 65536U) << "a mesh without cells proves nothing";
  const std::uint64_t alone = hash_of(run_on(mesh, 256, 1));
  for (const unsigned threads : {2U, 3U, 8U}) {
    if (test::kSanitized && threads != 3) continue;
    EXPECT_EQ(hash_of(run_on(mesh, 256, threads)), alone) << threads << " threads";
  }
}
TEST(SimplifyInCells, GivesTheSameLogOnAnyThreadsOfTerrain) {
  expect_same_on_threads(rough_terrain(260));
}
TEST(SimplifyInCells, GivesTheSameLogOnAnyThreadsOfASphere) { expect_same_on_threads(sphere(7)); }
TEST(SimplifyInCells, GivesTheSameLogOnAnyThreadsOfDebris) {
  expect_same_on_threads(tetrahedra(20000));
}
TEST(SimplifyInCells, GivesTheSameLogOnAnyThreadsOfASoup) {
  expect_same_on_threads(soup(70000, 30000));
}

TEST(SimplifyInCells, GivesTheSameLogOnEveryMachine) {
  EXPECT_EQ(hash_of(run(rough_terrain(260), 256)), 12546729323031583016ULL);
}

TEST(SimplifyInCells, ReachesTargetOnTerrain) { expect_reached(rough_terrain(260), 256); }
TEST(SimplifyInCells, ReachesTargetOnDebris) { expect_reached(tetrahedra(20000), 256); }
TEST(SimplifyInCells, ReachesTargetOnASoup) { expect_reached(soup(70000, 30000), 256); }
TEST(SimplifyInCells, ReachesTargetOnAFan) { expect_reached(fan(100000), 256); }
TEST(SimplifyInCells, ReachesATargetThatCellsWouldMiss) {
  const GridMesh mesh = rough_terrain(260);
  const auto target = static_cast<std::uint32_t>(mesh.faces.size() * 9 / 10);
  const CollapseLog log = run(mesh, target);
  EXPECT_LE(log.base_faces, target);
  EXPECT_GE(log.base_faces, target - 2);
}

TEST(SimplifyInCells, KeepsASphereClosedAndManifold) { expect_closed_manifold(sphere(7), 64); }

TEST(SimplifyInCells, KeepsTheBorderOfASquareInPlace) {
  const GridMesh mesh = flat_square(260);
  std::int64_t area2 = 0;
  for (const auto& f : replay(mesh, run(mesh, 300))) {
    ASSERT_GE(shadow_area2(mesh, f), 0);
    area2 += shadow_area2(mesh, f);
  }
  EXPECT_EQ(area2, std::int64_t{2} * 260000 * 260000);
}

TEST(SimplifyInCells, FlipsNoFaceOfAHeightField) {
  const GridMesh mesh = rough_terrain(260);
  for (const auto& f : replay(mesh, run(mesh, 260 * 260 * 2 / 10)))
    ASSERT_GE(shadow_area2(mesh, f), 0);
}

TEST(SimplifyInCells, KeepsTheForestShallow) {
  const GridMesh square = flat_square(260), terrain = rough_terrain(260);
  EXPECT_LE(depth_of(square, run(square, 64)), 24U);
  EXPECT_LE(depth_of(terrain, run(terrain, 64)), 30U);
}

TEST(SimplifyInCells, ReportsProgressInOrderAndFromTheCallersThread) {
  const std::thread::id caller = std::this_thread::get_id();
  std::vector<double> shares;
  bool is_caller = true;
  SimplifyOptions options;
  options.threads = 4;
  options.on_progress = [&](double share) {
    is_caller = is_caller && std::this_thread::get_id() == caller;
    shares.push_back(share);
  };
  static_cast<void>(simplify(rough_terrain(260), options));
  EXPECT_TRUE(is_caller);
  EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
  EXPECT_EQ(shares.back(), 1.0);
}

}  // namespace
}  // namespace nearmesh
