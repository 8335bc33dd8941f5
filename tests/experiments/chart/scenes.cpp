// SPDX-License-Identifier: Apache-2.0
#include "scenes.hpp"

#include <cmath>
#include <cstdio>
#include <map>

#include "core/base/csv.hpp"
#include "core/world/near_tiles.hpp"
#include "core/world/pages.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "shapes.hpp"
#include "tests/experiments/perf/touching.hpp"

namespace nearmesh::chart {
namespace {

using perf::Model;
using perf::PosePair;

Pose lifted(Pose pose, const std::array<double, 3>& way, double distance_m) {
  for (std::size_t k = 0; k < 3; ++k) pose.translation_m[k] += distance_m * way[k];
  return pose;
}

std::optional<IndexedMesh> read_mesh(const SceneOptions& options, const std::string& name) {
  Result<IndexedMesh> mesh = import_mesh(options.data + "/" + name);
  if (mesh.is_ok()) return std::move(mesh).value();
  std::fprintf(stderr, "left out: %s\n", mesh.status().message().c_str());
  return std::nullopt;
}

// ---- a ball on a terrain ------------------------------------------------------------------------

constexpr double kBallShare = 0.02;  // radius, of the ground's side

Scene ball_scene(const std::string& name, const IndexedMesh& ground, double radius_m) {
  return {name, perf::make_model(ground), perf::make_model(perf::make_ball(radius_m)), false, {},
          false};
}

std::uint32_t terrain_size(const SceneOptions& options) { return options.quick ? 48 : 256; }

// Set down in random places: sunk by a fiftieth of the radius, by a thousandth, just clear of the
// ground, a tenth above it.
void add_grazing_poses(Scene& scene, double radius_m, std::size_t count) {
  const double lifts[] = {-0.02, 0, 0.002, 0.1};
  const auto places = perf::touching_poses(scene.a.tree.view(), scene.b.tree.view(),
                                           scene.a.baked.store, radius_m, count);
  for (std::size_t i = 0; i < places.size(); ++i)
    scene.poses.push_back({{}, lifted(places[i].pose, places[i].away, lifts[i % 4] * radius_m)});
}

std::optional<Scene> terrain_grazing(const SceneOptions& options) {
  const IndexedMesh ground = generate_terrain(terrain_size(options), 42);
  const double radius_m = kBallShare * 32 * terrain_size(options);
  Scene scene = ball_scene("terrain-grazing", ground, radius_m);
  add_grazing_poses(scene, radius_m, options.quick ? 8 : 24);
  return scene;
}

std::optional<Scene> flight(const SceneOptions& options, const std::string& name, double lift) {
  const IndexedMesh ground = generate_terrain(terrain_size(options), 42);
  const double radius_m = kBallShare * 32 * terrain_size(options);
  Scene scene = ball_scene(name, ground, radius_m);
  scene.frames = true;
  for (const Pose& pose :
       perf::flight_poses(scene.a.tree.view(), scene.b.tree.view(), scene.a.baked.store, radius_m,
                          options.quick ? 12 : 100))
    scene.poses.push_back({{}, lifted(pose, {0, 0, 1}, lift * radius_m)});
  return scene;
}
std::optional<Scene> touching_flight(const SceneOptions& o) {
  return flight(o, "touching-flight", 0);
}
// Who joins in the middle of that flight starts from nothing there.
std::optional<Scene> late_flight(const SceneOptions& o) {
  std::optional<Scene> scene = flight(o, "late-flight", 0);
  scene->poses.erase(scene->poses.begin(),
                     scene->poses.begin() + static_cast<std::ptrdiff_t>(scene->poses.size() / 2));
  return scene;
}
std::optional<Scene> near_flight(const SceneOptions& o) { return flight(o, "near-flight", 0.25); }
std::optional<Scene> clear_flight(const SceneOptions& o) { return flight(o, "clear-flight", 1); }

// A terrain of so many cells a side, and a ball that touches it in places that all sizes have.
template <std::uint32_t kSize>
std::optional<Scene> growth(const SceneOptions& /*options*/) {
  const double radius_m = kBallShare * 32 * 70;
  Scene scene =
      ball_scene("growth-" + std::to_string(kSize), generate_terrain(kSize, 42), radius_m);
  const Model least = perf::make_model(generate_terrain(70, 42));
  const auto places =
      perf::touching_poses(least.tree.view(), scene.b.tree.view(), least.baked.store, radius_m, 24);
  for (const auto& place : places) {
    // Clear of the borders, where a greater terrain goes on.
    const auto& at = place.pose.translation_m;
    if (std::abs(at[0]) < 900 && std::abs(at[1]) < 900 && scene.poses.size() < 10)
      scene.poses.push_back({{}, place.pose});
  }
  return scene;
}

// The greatest of these that all methods are given, as a tile that stands so many times along both
// sides of a world; the ball touches the one in the middle.
template <std::int64_t kTiles>
std::optional<Scene> world_growth(const SceneOptions& options) {
  std::optional<Scene> scene = growth<708>(options);
  scene->name = "growth-world-" + std::to_string(kTiles);
  const SpmHeader& tile = scene->a.baked.header;
  const ContentHash content{1, 1};
  PlacedTile placed{.content = content, .faces = tile.face_count};
  GridBox all;
  for (std::uint32_t v = 0; v < tile.vertex_count; ++v)
    all.add(scene->a.baked.store.position(VertexId{v}));
  for (int k = 0; k < 3; ++k) placed.extent[static_cast<std::size_t>(k)] = all.hi[k];
  std::vector<PlacedTile> tiles;
  for (std::int64_t x = 0; x < kTiles; ++x)
    for (std::int64_t y = 0; y < kTiles; ++y) {
      placed.place = {(x - kTiles / 2) * placed.extent[0], (y - kTiles / 2) * placed.extent[1], 0};
      tiles.push_back(placed);
    }
  const WorldPages pages =
      make_pages({.origin_m = tile.grid.origin_m, .exponent = tile.grid.exponent}, tile.grid.bits,
                 tiles)
          .value();
  scene->world_faces = pages.world.faces;
  std::map<ContentHash, std::pair<WorldPage, std::size_t>> by_content;
  for (const auto& [name, bytes] : pages.pages)
    by_content.emplace(name, std::pair(decode_page(bytes).value(), bytes.size()));
  GridBox ball;
  for (std::uint32_t v = 0; v < scene->b.baked.header.vertex_count; ++v)
    ball.add(scene->b.baked.store.position(VertexId{v}));
  for (const PosePair& pose : scene->poses) {
    const auto& root = by_content.at(pages.world.root);
    Scene::Pages met{.count = 1, .bytes = kWorldRecordBytes + framed(root.second)};
    const PageOf page_of = [&](const WorldEntry& entry, int) -> Result<const WorldPage*> {
      const auto& [page, size] = by_content.at(entry.content);
      ++met.count;
      met.bytes += framed(size);
      return &page;
    };
    const PosedPair posed = pose_pair(world_grid(pages.world), pose.a, "world",
                                      scene->b.baked.header.grid, pose.b, "ball")
                                .value();
    const NearTiles near = find_near_tiles(pages.world, root.first, page_of,
                                           make_relative_frame(posed.a, posed.b), ball)
                               .value();
    NEARMESH_ASSERT(near.tiles.size() == 1);
    scene->pages.push_back(met);
  }
  return scene;
}

// ---- bodies that meet ---------------------------------------------------------------------------

// Apart, near misses and overlaps, as perf's distances make them; the deepest left out.
void add_distances(Scene& scene, int draws) {
  for (const perf::PoseSet& set : perf::distances(scene.a, scene.b, draws))
    if (set.name != "apart_2" && set.name != "deep_0.5")
      scene.poses.insert(scene.poses.end(), set.poses.begin(), set.poses.end());
}

std::optional<Scene> two_scans(const SceneOptions& options) {
  const auto a = read_mesh(options, "scans/armadillo_86k.obj"),
             b = read_mesh(options, "scans/camelhead.off");
  if (!a || !b) return std::nullopt;
  Scene scene{"two-scans", perf::make_model(*a), perf::make_model(*b), true, {}, false};
  add_distances(scene, 4);
  return scene;
}

// One vertex of a plain is drawn out to a needle, which every coarse level has lost or keeps by
// luck.
std::optional<Scene> needle(const SceneOptions& options) {
  const std::uint32_t quads = options.quick ? 48 : 200;
  IndexedMesh plain = test::make_plane(4, quads);
  const std::uint32_t middle = static_cast<std::uint32_t>(plain.positions_m.size() / 2);
  const std::array<double, 3> foot = plain.positions_m[middle];
  plain.positions_m[middle][2] = 0.5;
  const double radius_m = 0.08;
  Scene scene = ball_scene("needle-in-plain", plain, radius_m);
  for (int i = 0; i < (options.quick ? 4 : 12); ++i) {
    const double height = 0.12 + 0.03 * i;  // on the needle, beside it, and above its tip
    const double beside = i % 3 == 2 ? radius_m + 0.05 : 0.3 * radius_m * (i % 3);
    scene.poses.push_back({{}, {.translation_m = {foot[0] + beside, foot[1], height}}});
  }
  return scene;
}

// A ground and its own cast, just above it or shifted by a sixth of a cell: everything is near
// everything.
std::optional<Scene> conforming(const SceneOptions& options) {
  const IndexedMesh ground = generate_terrain(options.quick ? 32 : 96, 42);
  Scene scene{"conforming", perf::make_model(ground), perf::make_model(ground), true, {}, false};
  for (const double gap_m : {0.5, 8.0, 32.0})
    scene.poses.push_back({{}, {.translation_m = {0, 0, gap_m}}});
  for (const double gap_m : {0.0, 2.0, 8.0})
    scene.poses.push_back({{}, {.translation_m = {5, 3, gap_m}}});
  return scene;
}

std::optional<Scene> bolt_in_nut(const SceneOptions& options) {
  const auto bolt = read_mesh(options, "assembly/factory_bolt_m16_loose.obj"),
             nut = read_mesh(options, "assembly/factory_nut_m16_loose_subdiv_3x.obj");
  if (!bolt || !nut) return std::nullopt;
  Scene scene{"bolt-in-nut", perf::make_model(*bolt), perf::make_model(*nut), true, {}, false};
  for (const char* file : {"/reference/m16_loose_helix.csv", "/reference/m16_loose_spin.csv"}) {
    const Result<CsvTable> table = CsvTable::read(options.data + file);
    if (!table.is_ok()) {
      std::fprintf(stderr, "left out: %s\n", table.status().message().c_str());
      return std::nullopt;
    }
    const auto read = [&](std::size_t row, const std::string& body) {
      Pose pose;
      for (std::size_t i = 0; i < 12; ++i) {
        const std::string name = i < 9 ? body + "_R" + std::to_string(i / 3) + std::to_string(i % 3)
                                       : body + "_T" + std::to_string(i - 9);
        const double x = table.value().number(row, table.value().column(name)).value();
        (i < 9 ? pose.rotation[i] : pose.translation_m[i - 9]) = x;
      }
      return pose;
    };
    for (std::size_t row = 0; row < table.value().row_count(); row += 23)
      scene.poses.push_back({read(row, "A"), read(row, "B")});
  }
  return scene;
}

// ---- the paper's models -------------------------------------------------------------------------

// 2,050 vertices, 4,096 faces: 64 slices, 33 stacks. (generate_sphere has half as many stacks as
// slices.)
IndexedMesh paper_sphere_mesh() {
  test::ShapeBuilder shape;
  const auto at = [](std::uint32_t stack, std::uint32_t slice) {
    if (stack == 0 || stack == 33) return std::array<double, 3>{0, 0, stack == 0 ? 1.0 : -1.0};
    const auto [down, out] = test::unit_circle(stack, 66);
    const auto [x, y] = test::unit_circle(slice, 64);
    return std::array<double, 3>{out * x, out * y, down};
  };
  for (std::uint32_t slice = 0; slice < 64; ++slice) {
    shape.triangle(at(0, 0), at(1, slice), at(1, (slice + 1) % 64));
    shape.triangle(at(33, 0), at(32, (slice + 1) % 64), at(32, slice));
    for (std::uint32_t stack = 1; stack < 32; ++stack)
      shape.quad(at(stack, slice), at(stack + 1, slice), at(stack + 1, (slice + 1) % 64),
                 at(stack, (slice + 1) % 64));
  }
  return shape.take();
}

std::optional<Scene> paper_sphere(const SceneOptions& options) {
  Scene scene{"paper-sphere",
              perf::make_model(paper_sphere_mesh(), 50),
              perf::make_model(paper_sphere_mesh(), 50),
              true,
              {},
              false};
  add_distances(scene, options.quick ? 1 : 4);
  return scene;
}

// The bunny at 20,000 vertices: a level of the one at hand.
std::optional<Scene> paper_bunny(const SceneOptions& options) {
  const auto fine = read_mesh(options, "scans/stanford_bunny.obj");
  if (!fine) return std::nullopt;
  const Model model = perf::make_model(*fine);
  const SplitStore& store = model.baked.store;
  ActiveMesh mesh(store);
  RefineDelta delta;
  for (const VertexId u :
       global_order(store, 20000 - static_cast<std::uint32_t>(store.roots().size())))
    static_cast<void>(mesh.split(u, delta));
  test::ShapeBuilder shape;
  for (const TreeFace& face : current_triangles(mesh))
    shape.triangle(perf::in_metres(model.baked.header.grid, face.corners[0]),
                   perf::in_metres(model.baked.header.grid, face.corners[1]),
                   perf::in_metres(model.baked.header.grid, face.corners[2]));
  const IndexedMesh bunny = shape.take();
  Scene scene{"paper-bunny", perf::make_model(bunny, 500), perf::make_model(bunny, 500), true, {},
              false};
  add_distances(scene, 4);
  return scene;
}

}  // namespace

const std::vector<SceneInfo>& scenes() {
  static const std::vector<SceneInfo> all{
      {"terrain-grazing", false, terrain_grazing}, {"touching-flight", false, touching_flight},
      {"late-flight", false, late_flight},         {"near-flight", false, near_flight},
      {"clear-flight", false, clear_flight},       {"two-scans", true, two_scans},
      {"needle-in-plain", false, needle},          {"conforming", false, conforming},
      {"bolt-in-nut", true, bolt_in_nut},          {"paper-sphere", false, paper_sphere},
      {"paper-bunny", true, paper_bunny},          {"growth-70", false, growth<70>},
      {"growth-224", true, growth<224>},           {"growth-708", true, growth<708>},
      {"growth-2236", true, growth<2236>},         {"growth-world-10", true, world_growth<10>},
      {"growth-world-32", true, world_growth<32>}, {"growth-world-100", true, world_growth<100>},
  };
  return all;
}

}  // namespace nearmesh::chart
