// SPDX-License-Identifier: Apache-2.0
#pragma once
// Small baked models for tests, and random poses.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/random.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#include "random_rotation.hpp"
#include "soup.hpp"

namespace nearmesh::test {

/// Cleaned (21 bits) and baked; fails the test when either refuses.
inline BakedModel bake_mesh(const IndexedMesh& mesh,
                            std::uint32_t base_faces = SimplifyOptions{}.base_faces) {
  Result<CleanResult> clean = clean_mesh(mesh);
  if (!clean.is_ok()) ADD_FAILURE() << clean.status().message();
  Result<BakedModel> baked =
      bake(clean.value().mesh, clean.value().report.rounding_error_m, {.base_faces = base_faces});
  if (!baked.is_ok()) ADD_FAILURE() << baked.status().message();
  return std::move(baked).value();
}

// ---- meshes -------------------------------------------------------------------------------------

/// `count` small spheres in random places.
inline IndexedMesh make_components(std::uint32_t count, std::uint64_t seed) {
  Random random(seed);
  const IndexedMesh one = generate_sphere(8, 0);
  IndexedMesh mesh;
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
    const double radius = random.between(0.02, 0.3);
    const double at[3] = {random.between(-3, 3), random.between(-3, 3), random.between(-3, 3)};
    for (const auto& p : one.positions_m)
      mesh.positions_m.push_back(
          {at[0] + radius * p[0], at[1] + radius * p[1], at[2] + radius * p[2]});
    for (const auto& f : one.faces)
      mesh.faces.push_back({f[0] + first, f[1] + first, f[2] + first});
  }
  return mesh;
}

/// A sphere among segments, points and faces on a line, some covered by other faces and some not.
inline IndexedMesh make_degenerate(std::uint64_t seed) {
  Random random(seed);
  IndexedMesh mesh = generate_sphere(12, 0);
  const auto sphere = static_cast<std::uint32_t>(mesh.positions_m.size());
  for (std::uint32_t i = 0; i < 60; ++i) {
    const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
    const std::array<double, 3> p{random.between(-2, 2), random.between(-2, 2),
                                  random.between(-2, 2)};
    const std::array<double, 3> q{random.between(-2, 2), random.between(-2, 2),
                                  random.between(-2, 2)};
    mesh.positions_m.push_back(p);
    mesh.positions_m.push_back(i % 3 == 0 ? p : q);
    mesh.positions_m.push_back({(p[0] + q[0]) / 2, (p[1] + q[1]) / 2, (p[2] + q[2]) / 2});
    mesh.faces.push_back(i % 3 == 1 ? std::array{first, first + 1, first}
                                    : std::array{first, first + 1, first + 2});
    mesh.faces.push_back({random.below(sphere), first, first + 1});
  }
  return mesh;
}

/// Many faces on one edge whose ends are near each other: one split brings them all.
inline IndexedMesh make_book(std::uint32_t pages) {
  IndexedMesh mesh;
  mesh.positions_m = {{0, 0, 0}, {0, 0, 1e-4}};
  Random random(5);
  for (std::uint32_t i = 0; i < pages; ++i) {
    const double x = random.between(-1, 1), y = random.between(-1, 1);
    mesh.positions_m.push_back({x, y, random.between(-1, 1)});
    mesh.faces.push_back({0, 1, i + 2});
  }
  return mesh;
}

inline std::vector<std::string> mesh_names() {
  return {"terrain", "aircraft", "sphere", "soup", "components", "degenerate", "book", "one_face"};
}
/// Those that touch everywhere have the `part`th part of their faces.
inline IndexedMesh make_mesh(const std::string& name, std::uint32_t part = 1) {
  if (name == "terrain") return generate_terrain(24, 7);
  if (name == "aircraft") return generate_aircraft(1000, 7);
  if (name == "sphere") return generate_sphere(24, 0);
  if (name == "soup") return make_soup(300, 1200 / part, 7);
  if (name == "components") return make_components(100 / part, 7);
  if (name == "degenerate") return make_degenerate(7);
  if (name == "book") return make_book(400 / part);
  return IndexedMesh{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
}
/// Small bases, so that most of even a small mesh is progressive.
inline BakedModel bake_named(const std::string& name, std::uint32_t part = 1) {
  return bake_mesh(make_mesh(name, part), 16);
}

// ---- files --------------------------------------------------------------------------------------

/// A path of this process and test alone; the file is removed at the end.
class TempFile {
 public:
  explicit TempFile(const std::string& suffix = ".spm") {
    static int number = 0;
    path_ = ::testing::TempDir() + "nearmesh_" + std::to_string(::getpid()) + "_" +
            std::to_string(number++) + suffix;
  }
  TempFile(const TempFile&) = delete;
  TempFile& operator=(const TempFile&) = delete;
  ~TempFile() { std::remove(path_.c_str()); }
  [[nodiscard]] const std::string& path() const { return path_; }

  /// Replaces the content; in place where the size is the same, since tests do this thousands of
  /// times.
  void write(std::span<const std::uint8_t> bytes) const {
    const int file = ::open(path_.c_str(), O_WRONLY | O_CREAT, 0600);
    ASSERT_GE(file, 0);
    EXPECT_EQ(::pwrite(file, bytes.data(), bytes.size(), 0), static_cast<ssize_t>(bytes.size()));
    EXPECT_EQ(::ftruncate(file, static_cast<off_t>(bytes.size())), 0);
    ::close(file);
  }
  [[nodiscard]] std::vector<std::uint8_t> read() const {
    std::vector<std::uint8_t> bytes;
    std::FILE* file = std::fopen(path_.c_str(), "rb");
    if (file == nullptr) return bytes;
    for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file))
      bytes.push_back(static_cast<std::uint8_t>(c));
    std::fclose(file);
    return bytes;
  }

 private:
  std::string path_;
};

/// The model written to a file; fails the test when that is refused.
inline std::unique_ptr<TempFile> write_model(const BakedModel& model) {
  auto file = std::make_unique<TempFile>();
  const auto written = write_model_file(model.header, model.store, model.numbers, file->path());
  if (!written.is_ok()) ADD_FAILURE() << written.status().message();
  return file;
}

// ---- poses --------------------------------------------------------------------------------------

inline std::array<double, 3> place(const Pose& pose, const std::array<double, 3>& p) {
  std::array<double, 3> out = pose.translation_m;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) out[r] += pose.rotation[3 * r + c] * p[c];
  return out;
}

/// Position of a vertex in the model's frame, metres.
inline std::array<double, 3> position_m(const SpmHeader& header, const SplitStore& store,
                                        VertexId v) {
  std::array<double, 3> at = header.grid.origin_m;
  for (int k = 0; k < 3; ++k)
    at[static_cast<std::size_t>(k)] += std::ldexp(store.position(v)[k], header.grid.exponent);
  return at;
}

/// Radius of a model about its grid's middle, metres.
inline double radius_m(const BakedModel& model) {
  double greatest = 0;
  const double half = std::ldexp(1.0, model.header.grid.exponent + model.header.grid.bits - 1);
  for (std::uint32_t v = 0; v < model.header.vertex_count; ++v) {
    const auto p = position_m(model.header, model.store, {v});
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double d = p[k] - model.header.grid.origin_m[k] - half;
      square += d * d;
    }
    greatest = std::max(greatest, square);
  }
  return std::sqrt(greatest);
}

struct PairOfPoses {
  Pose a, b;
};
/// Both bodies turned at random. A vertex of b stands next to one of a, at a distance drawn from
/// all magnitudes; or b's middle lies beyond a vertex of a, outward or in any direction, about its
/// own radius away, where it may be clear of a. Radii as radius_m gives them.
inline PairOfPoses near_poses(Random& random, const BakedModel& a, double radius_a_m,
                              const BakedModel& b, double radius_b_m) {
  PairOfPoses poses;
  poses.a.rotation = random_rotation(random);
  poses.b.rotation = random_rotation(random);
  if (random.below(4) == 0) poses.a.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const auto va = position_m(a.header, a.store, {random.below(a.header.vertex_count)});
  const auto vb = position_m(b.header, b.store, {random.below(b.header.vertex_count)});
  const std::array<double, 3> at = place(poses.a, va), turned = place(poses.b, vb);
  // Exact powers of two: digests of answers must not depend on a library's exp2.
  const double mantissa = random.between(0.5, 1);
  const double scale =
      std::min(radius_a_m, radius_b_m) * std::ldexp(mantissa, -static_cast<int>(random.below(20)));
  const std::uint32_t kind = random.below(4);
  std::array<double, 3> direction = at;
  if (kind > 1)
    for (double& x : direction) x = random.between(-1, 1);
  double length = 1e-30;
  for (const double x : direction) length += x * x;
  const double reach = radius_b_m * random.between(0.3, 1.6) / std::sqrt(length);
  for (std::size_t k = 0; k < 3; ++k)
    poses.b.translation_m[k] = kind == 0 ? at[k] - turned[k] + random.between(-1, 1) * scale
                                         : at[k] + direction[k] * reach;
  return poses;
}
inline PosedPair near_pose(Random& random, const BakedModel& a, const BakedModel& b) {
  const PairOfPoses poses = near_poses(random, a, radius_m(a), b, radius_m(b));
  Result<PosedPair> posed = pose_pair(a.header.grid, poses.a, "a", b.header.grid, poses.b, "b");
  if (!posed.is_ok()) ADD_FAILURE() << posed.status().message();
  return posed.value();
}

// ---- refinement ---------------------------------------------------------------------------------

/// All splits of a complete store, parents first.
inline std::vector<VertexId> all_splits(const SplitStore& store) {
  return global_order(store, 0xffffffffU);
}

template <class T>
void shuffle(std::vector<T>& items, Random& random) {
  for (std::size_t i = items.size(); i > 1; --i)
    std::swap(items[i - 1], items[random.below(static_cast<std::uint32_t>(i))]);
}

/// A random state: none, some or all of the splits, together in places.
inline void refine_at_random(LocalModel& model, Random& random) {
  RefineDelta delta;
  const std::uint32_t n = model.mesh.store().vertex_count();
  const std::uint32_t share = random.below(5);  // 0: the base; 4: nearly everything
  for (std::uint32_t runs = share * 6; runs > 0; --runs) {
    const std::uint32_t first = random.below(n), count = 1 + random.below(1 + n * share / 40);
    for (std::uint32_t v = first; v < std::min(n, first + count); ++v) {
      ASSERT_TRUE(model.mesh.split({v}, delta));
    }
  }
  model.tree.update(delta);
}

/// For who shares files, of one that outlives it.
inline std::shared_ptr<ModelFile> lent(ModelFile& file) {
  return {std::shared_ptr<ModelFile>(), &file};
}

inline Status no_require(NodeSpan) { return Status::ok(); }

}  // namespace nearmesh::test
