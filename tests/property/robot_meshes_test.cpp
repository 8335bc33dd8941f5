// SPDX-License-Identifier: Apache-2.0
// The links of a UR5, each as Collada (Z_UP, for the eye) and as STL (for collisions): where the
// two surfaces lie nearer to each other than the answer is to changing, the answers are the same.
#include <cmath>
#include <filesystem>

#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh/core/query/query.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using Vector = std::array<double, 3>;

Vector operator-(const Vector& a, const Vector& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector along(const Vector& a, const Vector& d, double t) {
  return {a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]};
}

/// Ericson, Real-Time Collision Detection, 2005, section 5.1.5: squared distance of a point from a
/// triangle.
double square_distance(const Vector& p, const std::array<Vector, 3>& t) {
  const Vector ab = t[1] - t[0], ac = t[2] - t[0], ap = p - t[0];
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  const auto to = [&](const Vector& q) { return dot(p - q, p - q); };
  if (d1 <= 0 && d2 <= 0) return to(t[0]);
  const Vector bp = p - t[1];
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return to(t[1]);
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return to(along(t[0], ab, d1 / (d1 - d3)));
  const Vector cp = p - t[2];
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return to(t[2]);
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return to(along(t[0], ac, d2 / (d2 - d6)));
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0)
    return to(along(t[1], t[2] - t[1], (d4 - d3) / ((d4 - d3) + (d5 - d6))));
  const double denominator = va + vb + vc;
  return to(along(along(t[0], ab, vb / denominator), ac, vc / denominator));
}

std::vector<std::array<Vector, 3>> triangles_of(const IndexedMesh& mesh) {
  std::vector<std::array<Vector, 3>> out;
  for (const auto& f : mesh.faces)
    out.push_back({mesh.positions_m[f[0]], mesh.positions_m[f[1]], mesh.positions_m[f[2]]});
  return out;
}

/// Greatest distance of any point of `from` to `to`, too large by at most `step_m`, the distance of
/// samples.
double one_sided_m(const IndexedMesh& from, const IndexedMesh& to, double step_m) {
  const auto targets = triangles_of(to);
  std::vector<std::pair<Vector, double>> balls;
  for (const auto& t : targets) {
    const Vector centre{(t[0][0] + t[1][0] + t[2][0]) / 3, (t[0][1] + t[1][1] + t[2][1]) / 3,
                        (t[0][2] + t[1][2] + t[2][2]) / 3};
    double radius = 0;
    for (const Vector& corner : t)
      radius = std::max(radius, std::sqrt(dot(corner - centre, corner - centre)));
    balls.emplace_back(centre, radius);
  }
  double worst = 0;
  std::size_t last = 0;
  for (const auto& t : triangles_of(from)) {
    double longest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector edge = t[(k + 1) % 3] - t[k];
      longest = std::max(longest, std::sqrt(dot(edge, edge)));
    }
    const int n = std::max(1, static_cast<int>(std::ceil(longest / step_m)));
    for (int i = 0; i <= n; ++i)
      for (int j = 0; i + j <= n; ++j) {
        const Vector p = along(along(t[0], t[1] - t[0], double(i) / n), t[2] - t[0], double(j) / n);
        double best = square_distance(p, targets[last]);
        // What cannot raise the worst need not be known better.
        for (std::size_t k = 0; k < targets.size() && best > worst * worst; ++k) {
          const double gap =
              std::sqrt(dot(p - balls[k].first, p - balls[k].first)) - balls[k].second;
          if (gap > 0 && gap * gap >= best) continue;
          const double found = square_distance(p, targets[k]);
          if (found < best) {
            best = found;
            last = k;
          }
        }
        worst = std::max(worst, std::sqrt(best));
      }
  }
  return worst + step_m;
}

/// A sheet at height 0, wider than any link.
IndexedMesh plate() {
  return {{{-2, -2, 0}, {2, -2, 0}, {2, 2, 0}, {-2, 2, 0}}, {{0, 1, 2}, {0, 2, 3}}};
}

Pose pose_near_plate(Random& random) {
  double q[4];
  double length = 0;
  do {
    length = 0;
    for (double& x : q) {
      x = random.between(-1, 1);
      length += x * x;
    }
  } while (length > 1 || length < 0.01);
  for (double& x : q) x /= std::sqrt(length);
  Pose pose;
  pose.rotation = {1 - 2 * (q[2] * q[2] + q[3] * q[3]), 2 * (q[1] * q[2] - q[0] * q[3]),
                   2 * (q[1] * q[3] + q[0] * q[2]),     2 * (q[1] * q[2] + q[0] * q[3]),
                   1 - 2 * (q[1] * q[1] + q[3] * q[3]), 2 * (q[2] * q[3] - q[0] * q[1]),
                   2 * (q[1] * q[3] - q[0] * q[2]),     2 * (q[2] * q[3] + q[0] * q[1]),
                   1 - 2 * (q[1] * q[1] + q[2] * q[2])};
  pose.translation_m = {random.between(-0.2, 0.2), random.between(-0.2, 0.2),
                        random.between(-0.4, 0.4)};
  return pose;
}

/// How far the mesh is above or below the plate, or how deep in it: what must move for the answer
/// to change.
double margin_m(const IndexedMesh& mesh, const Pose& pose) {
  double lo = 1e9, hi = -1e9;
  for (const auto& face : mesh.faces)
    for (const std::uint32_t v : face) {
      const Vector& p = mesh.positions_m[v];
      const double z = pose.rotation[6] * p[0] + pose.rotation[7] * p[1] + pose.rotation[8] * p[2] +
                       pose.translation_m[2];
      lo = std::min(lo, z);
      hi = std::max(hi, z);
    }
  return lo > 0 ? lo : hi < 0 ? -hi : std::min(-lo, hi);
}

class RobotMeshes : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Ur5, RobotMeshes,
                         ::testing::Values("base", "shoulder", "upperarm", "forearm", "wrist1",
                                           "wrist2", "wrist3"));

TEST_P(RobotMeshes, AnswerAlikeAsColladaAndAsStl) {
  const fs::path folder = fs::path(NEARMESH_TEST_DATA) / "robot/ur5";
  if (!fs::exists(folder)) GTEST_SKIP() << "no test data at " << folder;
  const std::string link = GetParam();
  const auto dae = import_mesh((folder / "visual" / (link + ".dae")).string());
  const auto stl = import_mesh((folder / "collision" / (link + ".stl")).string());
  ASSERT_TRUE(dae.is_ok() && stl.is_ok());
  const BakedModel models[] = {test::bake_mesh(dae.value(), 256), test::bake_mesh(stl.value(), 256),
                               test::bake_mesh(plate(), 256)};
  TriangleTree trees[3];
  for (std::size_t i = 0; i < 3; ++i) {
    auto tree = build_full_tree(models[i].header, models[i].store);
    ASSERT_TRUE(tree.has_value());
    trees[i] = *std::move(tree);
  }
  const double hausdorff_m = std::max(one_sided_m(dae.value(), stl.value(), 0.002),
                                      one_sided_m(stl.value(), dae.value(), 0.002));
  const auto ask = [&](std::size_t i, const Pose& pose) {
    const auto posed = pose_pair(trees[i].grid, pose, "link", trees[2].grid, Pose{}, "plate");
    return query(trees[i].view(), posed.value().a, trees[2].view(), posed.value().b,
                 {.clearance = Clearance::kNone})
        .status;
  };
  Random random(17);
  int clear = 0, contacts = 0;
  for (int i = 0; i < 200; ++i) {
    const Pose pose = pose_near_plate(random);
    if (margin_m(stl.value(), pose) <= hausdorff_m) continue;
    ++clear;
    const AnswerStatus answer = ask(0, pose);
    contacts += answer == AnswerStatus::kContact ? 1 : 0;
    EXPECT_EQ(answer, ask(1, pose)) << "pose " << i;
  }
  std::printf("%s: Hausdorff distance %.4f m; %d of 200 poses clear of it, %d in contact\n",
              link.c_str(), hausdorff_m, clear, contacts);
  EXPECT_GE(clear, 100);
  EXPECT_GT(contacts, 5);
}

}  // namespace
}  // namespace nearmesh
