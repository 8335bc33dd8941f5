// SPDX-License-Identifier: Apache-2.0
#pragma once
// A terrain that was cut into the tiles of a world, a ball, and places where the two are near each
// other.

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "brute_force.hpp"
#include "core/world/world_folder.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "test_models.hpp"

namespace nearmesh::test {

inline constexpr CommonLattice kCutLattice{.origin_m = {40, -8, 0.5}, .exponent = -7};
inline constexpr int kCutSide = 8, kCutCells = 5;

/// Terrain in 64 tiles of 50 faces below three pages, on disk; gone at the end.
class CutTerrain {
 public:
  explicit CutTerrain(double crater_m = 0, bool keeps = false)
      : whole_(generate_terrain(kCutSide * kCutCells, 5)), keeps_(keeps) {
    folder = ::testing::TempDir() + "nearmesh_cut_" + std::to_string(::getpid());
    std::filesystem::create_directories(folder + "/tiles");
    for (auto& p : whole_.positions_m) {
      for (double& x : p) x = x * 0.01 + 7.7;
      p[2] *= 0.3;
    }
    // Inside of a tile near a corner.
    whole_.positions_m[2 * (kCutSide * kCutCells + 1) + 2][2] -= crater_m;
    std::vector<PlacedTile> placed;
    for (int j = 0; j < kCutSide; ++j)
      for (int i = 0; i < kCutSide; ++i) placed.push_back(cut_tile(i, j));
    const auto made = make_pages(kCutLattice, 21, placed);
    EXPECT_TRUE(made.is_ok()) << made.status().message();
    EXPECT_TRUE(write_world(made.value(), folder).is_ok());
    pages = made.value();
    CleanResult clean = clean_mesh(whole_, {.lattice = kCutLattice}).value();
    model.emplace(bake(clean.mesh, 0, {.base_faces = 4}).value());
    faces = all_faces(model->store);
  }
  CutTerrain(const CutTerrain&) = delete;
  CutTerrain& operator=(const CutTerrain&) = delete;
  ~CutTerrain() {
    if (!keeps_) std::filesystem::remove_all(folder);
  }

  [[nodiscard]] const std::vector<std::array<double, 3>>& posts() const {
    return whole_.positions_m;
  }

  std::string folder;
  WorldPages pages;
  std::optional<BakedModel> model;  // of all in one
  std::vector<KeyedFace> faces;

 private:
  PlacedTile cut_tile(int i, int j) {
    IndexedMesh part{whole_.positions_m, {}};
    for (std::size_t f = 0; f < whole_.faces.size(); ++f) {
      const auto cell = static_cast<int>(f / 2);
      if (cell % (kCutSide * kCutCells) / kCutCells == i &&
          cell / (kCutSide * kCutCells) / kCutCells == j)
        part.faces.push_back(whole_.faces[f]);
    }
    CleanResult clean = clean_mesh(part, {.lattice = kCutLattice}).value();
    PlacedTile tile{.place = clean.mesh.grid.lattice_cells, .faces = clean.mesh.faces.size()};
    clean.mesh.grid = {.exponent = kCutLattice.exponent};
    for (const GridPoint& p : clean.mesh.positions)
      for (std::size_t k = 0; k < 3; ++k)
        tile.extent[k] = std::max<std::int64_t>(tile.extent[k], p.v[k]);
    const BakedModel baked = bake(clean.mesh, 0, {.base_faces = 4}).value();
    const TempFile file;
    EXPECT_TRUE(write_model_file(baked.header, baked.store, baked.numbers, file.path()).is_ok());
    tile.content = ModelFile::open(file.path()).value().content_hash();
    std::filesystem::copy_file(file.path(), WorldFolder::tile_path(folder, tile.content),
                               std::filesystem::copy_options::overwrite_existing);
    return tile;
  }

  IndexedMesh whole_;
  bool keeps_;
};

inline const BakedModel& cut_ball() {
  static const BakedModel ball = [] {
    IndexedMesh mesh = generate_sphere(16, 0);
    for (auto& p : mesh.positions_m)
      for (double& x : p) x *= 0.4;
    // As coarse as the world, so that a vertex displaced by a step of the lattice would tell.
    const CleanResult clean = clean_mesh(mesh, {.lattice = CommonLattice{.exponent = -6}}).value();
    return bake(clean.mesh, clean.report.rounding_error_m, {.base_faces = 16}).value();
  }();
  return ball;
}

/// The faces of the ball that touch, once for each face of the terrain, ascending.
inline std::vector<FaceKey> touching_of_whole(const CutTerrain& terrain, const Pose& world,
                                              const Pose& ball) {
  static const std::vector<KeyedFace> faces = all_faces(cut_ball().store);
  const PosedPair posed =
      pose_pair(terrain.model->header.grid, world, "whole", cut_ball().header.grid, ball, "ball")
          .value();
  std::vector<FaceKey> keys;
  for (const FacePair& pair : touching_pairs(terrain.model->store, posed.a, terrain.faces,
                                             cut_ball().store, posed.b, faces))
    keys.push_back(pair.b);
  std::sort(keys.begin(), keys.end());
  return keys;
}

/// The ball near a post of the terrain: those with a tile's number are on seams, and corners.
struct CutScene {
  Pose world;
  Motion ball;
};
inline CutScene random_scene(const CutTerrain& terrain, Random& random, int kind) {
  CutScene scene;
  if (kind > 0) scene.world.rotation = random_rotation(random);
  const double far_m = kind == 2 ? 6.4e6 : 100;
  for (double& t : scene.world.translation_m) t = random.between(-far_m, far_m);
  constexpr std::uint32_t kPosts = kCutSide * kCutCells + 1;
  std::uint32_t column = random.below(kPosts), row = random.below(kPosts);
  if (random.below(3) > 0) column -= column % kCutCells;
  if (random.below(3) > 0) row -= row % kCutCells;
  std::array<double, 3> at = terrain.posts()[row * kPosts + column];
  for (double& x : at) x += random.between(-0.25, 0.25);
  at[2] += random.between(-0.3, 0.6);
  scene.ball.pose = {random_rotation(random), place(scene.world, at)};
  for (double& v : scene.ball.linear_velocity_mps) v = random.between(-1, 1);
  return scene;
}

}  // namespace nearmesh::test
