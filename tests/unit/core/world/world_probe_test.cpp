// SPDX-License-Identifier: Apache-2.0
// Probes of a world on disk, held against all faces of its tiles, and against the one mesh that was
// cut.
#include "nearmesh/core/world/world_probe.hpp"

#include <filesystem>

#include "brute_force.hpp"
#include "core/query/probe_needs.hpp"
#include "core/world/near_tiles.hpp"
#include "core/world/world_folder.hpp"

namespace nearmesh {
namespace {

constexpr CommonLattice kProbedLattice{.origin_m = {40, -8, 0.5}, .exponent = -7};
constexpr int kProbedSide = 6, kProbedCells = 3;

/// Terrain in 36 tiles of 18 faces, on disk; gone at the end.
class ProbedWorld {
 public:
  ProbedWorld() : whole_(generate_terrain(kProbedSide * kProbedCells, 5)) {
    folder = ::testing::TempDir() + "nearmesh_probed_" + std::to_string(::getpid());
    std::filesystem::create_directories(folder + "/tiles");
    for (auto& p : whole_.positions_m) {
      for (double& x : p) x = x * 0.01 + 7.7;
      p[2] *= 0.3;
    }
    std::vector<PlacedTile> placed;
    for (int j = 0; j < kProbedSide; ++j)
      for (int i = 0; i < kProbedSide; ++i) placed.push_back(add_tile(i, j));
    const auto pages = make_pages(kProbedLattice, 21, placed);
    EXPECT_TRUE(pages.is_ok()) << pages.status().message();
    EXPECT_TRUE(write_world(pages.value(), folder).is_ok());
    record = pages.value().world;
    clean = clean_mesh(whole_, {.lattice = kProbedLattice}).value();
  }
  ProbedWorld(const ProbedWorld&) = delete;
  ProbedWorld& operator=(const ProbedWorld&) = delete;
  ~ProbedWorld() { std::filesystem::remove_all(folder); }

  struct Tile {
    BakedModel model;
    Grid grid;  // in its place
    WorldTile name;
  };
  std::string folder;
  WorldRecord record;
  std::vector<Tile> tiles;
  CleanResult clean;  // all of it

  [[nodiscard]] const std::vector<std::array<double, 3>>& posts() const {
    return whole_.positions_m;
  }

 private:
  PlacedTile add_tile(int i, int j) {
    IndexedMesh part{whole_.positions_m, {}};
    for (std::size_t f = 0; f < whole_.faces.size(); ++f) {
      const auto cell = static_cast<int>(f / 2);
      if (cell % (kProbedSide * kProbedCells) / kProbedCells == i &&
          cell / (kProbedSide * kProbedCells) / kProbedCells == j)
        part.faces.push_back(whole_.faces[f]);
    }
    CleanResult made = clean_mesh(part, {.lattice = kProbedLattice}).value();
    const Grid placed_grid = made.mesh.grid;
    made.mesh.grid = {.exponent = kProbedLattice.exponent};
    PlacedTile placed{.place = placed_grid.lattice_cells, .faces = made.mesh.faces.size()};
    for (const GridPoint& p : made.mesh.positions)
      for (std::size_t k = 0; k < 3; ++k)
        placed.extent[k] = std::max<std::int64_t>(placed.extent[k], p.v[k]);
    BakedModel model = bake(made.mesh, 0, {.base_faces = 4}).value();
    const std::string path = folder + "/tiles/baking.spm";
    const auto written = write_model_file(model.header, model.store, model.numbers, path);
    EXPECT_TRUE(written.is_ok());
    placed.content = written.value().content_hash;
    std::filesystem::rename(path, WorldFolder::tile_path(folder, placed.content));
    WorldTile name{.content = placed.content};
    for (std::size_t k = 0; k < 3; ++k)
      name.place[k] = static_cast<std::int32_t>(placed_grid.lattice_cells[k]);
    tiles.push_back({std::move(model), placed_grid, name});
    return placed;
  }
  IndexedMesh whole_;
};

const ProbedWorld& probed_world() {
  static const ProbedWorld world;
  return world;
}

Pose world_pose(Random& random, int kind) {
  Pose pose;
  if (kind > 0) pose.rotation = test::random_rotation(random);
  const double far_m = kind == 2 ? 6.4e6 : 100;
  for (double& t : pose.translation_m) t = random.between(-1, 1) * far_m;
  return pose;
}

/// At posts, on seams, slanted, far, from outside.
std::vector<RayProbe> world_rays(Random& random, const Pose& pose, std::size_t count) {
  const auto& posts = probed_world().posts();
  std::vector<RayProbe> rays(count);
  for (RayProbe& ray : rays) {
    std::array<double, 3> target = posts[random.below(static_cast<std::uint32_t>(posts.size()))];
    std::array<double, 3> from = target;
    switch (random.below(4)) {
      case 0:
        from[2] += 50;
        break;
      case 1:  // along a row of posts
        from[0] -= 100;
        target[0] += 1;
        break;
      case 2:
        for (double& x : from) x += random.between(-60, 60);
        break;
      default:
        for (double& x : from) x += random.between(-3, 3);
        target[2] += random.between(-0.5, 0.5);
    }
    ray.origin_m = test::place(pose, from);
    const auto to = test::place(pose, target);
    for (std::size_t k = 0; k < 3; ++k) ray.direction[k] = to[k] - ray.origin_m[k];
    if (random.below(3) == 0) ray.range_m = random.between(0, 60);
  }
  return rays;
}

TEST(WorldProbe, RaysMeetWhatTheOneMeshWouldWhereverItWasCut) {
  const ProbedWorld& ground = probed_world();
  Result<WorldProbe> probe = WorldProbe::open(ground.folder, 5);
  ASSERT_TRUE(probe.is_ok()) << probe.status().message();
  std::size_t hits = 0;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const Pose pose = world_pose(random, static_cast<int>(seed % 3));
    const std::vector<RayProbe> rays = world_rays(random, pose, 60);
    std::vector<WorldRayAnswer> answers(rays.size());
    const Status status = probe.value().probe(pose, rays, answers);
    ASSERT_TRUE(status.is_ok()) << status.message();
    EXPECT_LE(probe.value().open_tiles(), 5U);
    const PosedFrame whole = probe_frame(ground.clean.mesh.grid, pose).value();
    const PosedFrame in_world = probe_frame(world_grid(ground.record), pose).value();
    ASSERT_EQ(whole.lattice_exp, in_world.lattice_exp);
    const WorldFolder opened = WorldFolder::open(ground.folder).value();
    const CellBox box = opened.root().value().box();
    GridBox reach;
    for (std::size_t k = 0; k < 3; ++k) {
      reach.lo.v[k] = static_cast<std::int32_t>(box.lo[k]);
      reach.hi.v[k] = static_cast<std::int32_t>(box.hi[k]);
    }
    for (std::size_t i = 0; i < rays.size(); ++i) {
      SCOPED_TRACE(i);
      const CutRay cut = cut_ray(rays[i], pose_box(in_world, reach), in_world.lattice_exp);
      RayFound first;
      for (const auto& f : ground.clean.mesh.faces) {
        if (cut.is_empty) break;
        std::array<GridPoint, 3> corners;
        for (std::size_t k = 0; k < 3; ++k) corners[k] = ground.clean.mesh.positions[f[k]];
        RayFound next;
        next.has_face = true;
        next.face = pose_triangle(whole, corners);
        const auto hit = first_hit(cut.ray, next.face);
        if (!hit) continue;
        next.hit = *hit;
        if (!first.has_face || comes_before(cut.ray, next, first)) first = next;
      }
      const RayAnswer& answer = answers[i].ray;
      ASSERT_EQ(answer.status, first.has_face ? ProbeStatus::kHit : ProbeStatus::kMiss);
      if (!first.has_face) continue;
      ++hits;
      EXPECT_LE(answer.at_least_m, cut.at_m(first.hit.t));
      EXPECT_GE(answer.at_most_m, cut.at_m(first.hit.t));
      // The face is one of the tile that is named, and the ray is there.
      const auto tile = std::find_if(ground.tiles.begin(), ground.tiles.end(),
                                     [&](const auto& t) { return t.name == answers[i].tile; });
      ASSERT_NE(tile, ground.tiles.end());
      const PosedFrame placed = probe_frame(tile->grid, pose).value();
      bool is_met = false;
      for (const test::KeyedFace& face : test::all_faces(tile->model.store))
        if (face.key == answer.face)
          is_met =
              first_hit(cut.ray, test::posed(tile->model.store, placed, face.face)).has_value();
      EXPECT_TRUE(is_met);
    }
  }
  EXPECT_GT(hits, 250U);
}

TEST(WorldProbe, BallsAndBoxesMeetWhatSomeTileMeets) {
  const ProbedWorld& ground = probed_world();
  Result<WorldProbe> probed = WorldProbe::open(ground.folder, 3);
  ASSERT_TRUE(probed.is_ok());
  std::size_t hits = 0, misses = 0;
  std::vector<TriangleTree> full;
  for (const auto& tile : ground.tiles) {
    full.push_back(*build_full_tree(tile.model.header, tile.model.store));
    full.back().grid = tile.grid;
  }
  for (std::uint64_t seed = 0; seed < 9; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const Pose pose = world_pose(random, static_cast<int>(seed % 3));
    std::vector<BallProbe> balls(20);
    std::vector<BoxProbe> boxes(20);
    for (std::size_t i = 0; i < balls.size(); ++i) {
      auto at = ground.posts()[random.below(static_cast<std::uint32_t>(ground.posts().size()))];
      const double size = std::ldexp(random.between(0, 4), -static_cast<int>(random.below(6)));
      for (double& x : at) x += random.between(-2, 2) * size;
      balls[i] = {test::place(pose, at), size};
      boxes[i].pose.translation_m = test::place(pose, at);
      boxes[i].pose.rotation = test::random_rotation(random);
      boxes[i].half_m = {size, size * 0.5, size * random.between(0, 1)};
    }
    std::vector<WorldShapeAnswer> of_balls(balls.size()), of_boxes(boxes.size());
    ASSERT_TRUE(probed.value().probe(pose, balls, of_balls).is_ok());
    ASSERT_TRUE(probed.value().probe(pose, boxes, of_boxes).is_ok());
    for (std::size_t i = 0; i < balls.size(); ++i) {
      ShapeAnswer ball, box;
      bool ball_meets_some = false, box_meets_some = false;
      for (const TriangleTree& tree : full) {
        ASSERT_TRUE(
            probe(tree.view(), pose, std::span<const BallProbe>(&balls[i], 1), std::span(&ball, 1))
                .is_ok());
        ASSERT_TRUE(
            probe(tree.view(), pose, std::span<const BoxProbe>(&boxes[i], 1), std::span(&box, 1))
                .is_ok());
        ball_meets_some |= ball.status == ProbeStatus::kHit;
        box_meets_some |= box.status == ProbeStatus::kHit;
      }
      EXPECT_EQ(of_balls[i].shape.status == ProbeStatus::kHit, ball_meets_some);
      EXPECT_EQ(of_boxes[i].shape.status == ProbeStatus::kHit, box_meets_some);
      (ball_meets_some ? hits : misses) += 1;
    }
  }
  EXPECT_GT(hits, 40U);
  EXPECT_GT(misses, 20U);
}

TEST(WorldProbe, SaysWhatIsWrong) {
  const ProbedWorld& ground = probed_world();
  EXPECT_EQ(WorldProbe::open(ground.folder + "/none").status().code(), StatusCode::kNotFound);
  Result<WorldProbe> probed = WorldProbe::open(ground.folder);
  ASSERT_TRUE(probed.is_ok());
  std::vector<WorldRayAnswer> answers(1);
  const RayProbe bad{.direction = {0, 0, 0}};
  EXPECT_FALSE(probed.value().probe({}, std::span(&bad, 1), answers).is_ok());
  // A tile's file that is gone is an error, never a miss.
  const std::string copy = ground.folder + "_copy";
  std::filesystem::copy(ground.folder, copy, std::filesystem::copy_options::recursive);
  Result<WorldProbe> holed = WorldProbe::open(copy);
  ASSERT_TRUE(holed.is_ok());
  std::filesystem::remove_all(copy + "/tiles");
  RayProbe down{.origin_m = ground.posts()[60]};
  down.origin_m[2] += 10;
  const Status gone = holed.value().probe({}, std::span(&down, 1), answers);
  EXPECT_EQ(gone.code(), StatusCode::kIo) << gone.message();
  std::filesystem::remove_all(copy);
}

}  // namespace
}  // namespace nearmesh
