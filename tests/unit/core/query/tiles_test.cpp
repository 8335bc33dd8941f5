// SPDX-License-Identifier: Apache-2.0
// A mesh in tiles of one lattice is the mesh: its seams are closed in every pose, and what touches
// the tiles is what touches the mesh, each face once.
#include <map>

#include "brute_force.hpp"

namespace nearmesh {
namespace {

using test::FullModel;

constexpr CommonLattice kLattice{.origin_m = {-64, 32, 0}, .exponent = -6};

struct Tile {
  BakedModel model;
  std::vector<std::uint32_t> face_of;  ///< of the whole mesh, by the tile's input number
};

Tile bake_tile(const IndexedMesh& mesh, const std::vector<std::uint32_t>& faces) {
  IndexedMesh part{mesh.positions_m, {}};
  for (const std::uint32_t face : faces) part.faces.push_back(mesh.faces[face]);
  Result<CleanResult> clean = clean_mesh(part, {.lattice = kLattice});
  EXPECT_TRUE(clean.is_ok()) << clean.status().message();
  Result<BakedModel> baked =
      bake(clean.value().mesh, clean.value().report.rounding_error_m, {.base_faces = 16});
  EXPECT_TRUE(baked.is_ok()) << baked.status().message();
  return {std::move(baked).value(), faces};
}

/// Terrain off its lattice, cut in four unequal parts that meet in one post, and whole.
struct World {
  World() {
    IndexedMesh mesh = generate_terrain(14, 11);
    for (auto& p : mesh.positions_m) {
      for (double& x : p) x = x * 0.01 + 3.3;
      p[2] *= 0.3;
    }
    middle = mesh.positions_m[15 * 9 + 6];
    std::array<std::vector<std::uint32_t>, 4> parts;
    std::vector<std::uint32_t> all;
    for (std::uint32_t f = 0; f < mesh.faces.size(); ++f) {
      std::array<double, 2> at{};
      for (const std::uint32_t v : mesh.faces[f])
        for (std::size_t k = 0; k < 2; ++k) at[k] += mesh.positions_m[v][k] / 3;
      parts[(at[0] > middle[0] ? 1 : 0) + (at[1] > middle[1] ? 2 : 0)].push_back(f);
      all.push_back(f);
    }
    for (const auto& part : parts) tiles.push_back(bake_tile(mesh, part));
    whole.push_back(bake_tile(mesh, all));
  }
  std::array<double, 3> middle{};
  std::vector<Tile> tiles, whole;
};

Pose random_pose(Random& random, int kind) {
  Pose pose;
  if (kind > 0) pose.rotation = test::random_rotation(random);
  const double far_m = kind == 2 ? 6.4e6 : 1000;
  for (double& t : pose.translation_m) t = random.between(-far_m, far_m);
  return pose;
}

/// So that the object's origin comes to where the body's point is, and the object is turned some
/// way.
Pose object_at(Random& random, const Pose& body, const std::array<double, 3>& point, double off) {
  Pose pose{test::random_rotation(random), body.translation_m};
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < 3; ++i)
      pose.translation_m[k] += body.rotation[3 * k + i] * point[i];
    pose.translation_m[k] += random.between(-off, off);
  }
  return pose;
}

/// Of the whole mesh's faces and the object's, ascending.
using Pairs = std::vector<std::pair<std::uint32_t, FaceKey>>;

Pairs in_numbers_of_the_mesh(const Tile& tile, const std::vector<FacePair>& pairs) {
  std::map<FaceKey, std::uint32_t> number;
  const std::vector<test::KeyedFace> faces = test::all_faces(tile.model.store);
  for (std::size_t i = 0; i < faces.size(); ++i)
    number[faces[i].key] = tile.face_of[tile.model.numbers[i].face.value];
  Pairs out;
  for (const FacePair& pair : pairs) out.emplace_back(number.at(pair.a), pair.b);
  return out;
}

Pairs certified_pairs(const Tile& tile, const Pose& pose, const BakedModel& object,
                      const Pose& object_pose) {
  LocalModel a(tile.model.store, tile.model.header.grid), b(object.store, object.header.grid);
  const auto frames = pose_pair(a.grid, pose, "tile", object.header.grid, object_pose, "object");
  EXPECT_TRUE(frames.is_ok()) << frames.status().message();
  const Require nothing = [](NodeSpan) { return Status::ok(); };
  const Result<Answer> answer =
      certify(a, frames.value().a, nothing, b, frames.value().b, nothing, {});
  EXPECT_TRUE(answer.is_ok() && is_certified(answer.value().status));
  return in_numbers_of_the_mesh(tile, answer.value().pairs);
}

Pairs true_pairs(const Tile& tile, const Pose& pose, const BakedModel& object,
                 const Pose& object_pose) {
  const auto frames =
      pose_pair(tile.model.header.grid, pose, "mesh", object.header.grid, object_pose, "object");
  return in_numbers_of_the_mesh(
      tile,
      test::touching_pairs(tile.model.store, frames.value().a, test::all_faces(tile.model.store),
                           object.store, frames.value().b, test::all_faces(object.store)));
}

TEST(Tiles, ContactsOverSeamsAreThoseOfTheMeshEachOnceInEveryPose) {
  const World world;
  const BakedModel object = test::bake_mesh(generate_aircraft(300, 5), 16);
  IndexedMesh pebble = generate_sphere(8, 0);
  for (auto& p : pebble.positions_m)
    for (double& x : p) x *= 0.05;
  const BakedModel small = test::bake_mesh(pebble, 16);
  Random random(8);
  std::size_t pairs = 0, over_seams = 0;
  for (int round = 0; round < 120; ++round) {
    const Pose pose = random_pose(random, round % 3);
    const bool is_small = round % 2 == 0;
    const BakedModel& other = is_small ? small : object;
    const Pose at = object_at(random, pose, world.middle, is_small ? 0.03 : 1);
    Pairs sum;
    std::size_t touched = 0;
    for (const Tile& tile : world.tiles) {
      const Pairs found = certified_pairs(tile, pose, other, at);
      touched += found.empty() ? 0 : 1;
      sum.insert(sum.end(), found.begin(), found.end());
    }
    std::sort(sum.begin(), sum.end());
    Pairs expected = true_pairs(world.whole.front(), pose, other, at);
    std::sort(expected.begin(), expected.end());
    ASSERT_EQ(sum, expected) << "round " << round;
    pairs += sum.size();
    over_seams += touched > 1 ? 1 : 0;
  }
  EXPECT_GT(pairs, 1000U);
  EXPECT_GT(over_seams, 40U);
}

TEST(Tiles, EveryVertexOfASeamIsEqualInEveryPose) {
  const World world;
  Random random(9);
  std::size_t shared = 0;
  for (int round = 0; round < 60; ++round) {
    const Pose pose = random_pose(random, round % 3);
    // By their places on the lattice: what each tile makes of them.
    std::map<std::array<std::int64_t, 3>, LatticePoint> posed;
    for (const Tile& tile : world.tiles) {
      const SpmHeader& header = tile.model.header;
      const PosedFrame frame =
          make_posed_frame(header.grid, pose, lattice_exponent(header.grid, {.exponent = -10}))
              .value();
      for (std::uint32_t v = 0; v < header.vertex_count; ++v) {
        const GridPoint p = tile.model.store.position({v});
        std::array<std::int64_t, 3> place;
        for (std::size_t k = 0; k < 3; ++k) place[k] = header.grid.lattice_cells[k] + p.v[k];
        const auto [at, is_new] = posed.emplace(place, pose_point(frame, p));
        if (is_new) continue;
        ++shared;
        ASSERT_EQ(at->second, pose_point(frame, p));
      }
    }
  }
  EXPECT_EQ(shared, 60U * (4 * 14 / 2 + 3)) << "two rows of posts, one of them shared by four";
}

}  // namespace
}  // namespace nearmesh
