// SPDX-License-Identifier: Apache-2.0
// Coordinates are the file's, in metres, whatever the format: one tetrahedron, written by hand in each.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <fstream>

#include "file_bytes.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh {
namespace {

using test::FormatFile;
using Point = std::array<double, 3>;

/// A file of this test's own, gone afterwards.
class TempFile {
 public:
  TempFile(const std::string& ending, const std::string& bytes)
      : path_(testing::TempDir() + "nearmesh_units_" +
              testing::UnitTest::GetInstance()->current_test_info()->name()) {
    std::replace(path_.begin() + static_cast<std::ptrdiff_t>(testing::TempDir().size()),
                 path_.end(), '/', '_');
    path_ += ending;
    std::ofstream(path_, std::ios::binary) << bytes;
  }
  ~TempFile() { std::remove(path_.c_str()); }
  TempFile(const TempFile&) = delete;
  TempFile& operator=(const TempFile&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// The corners of a mesh without repetition, sorted.
std::vector<Point> corners(const IndexedMesh& mesh) {
  std::vector<Point> points;
  for (const auto& face : mesh.faces)
    for (const std::uint32_t v : face) points.push_back(mesh.positions_m[v]);
  std::ranges::sort(points);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

double signed_volume(const IndexedMesh& mesh) {
  double sum = 0;
  for (const auto& f : mesh.faces) {
    const Point &a = mesh.positions_m[f[0]], &b = mesh.positions_m[f[1]],
                &c = mesh.positions_m[f[2]];
    for (std::size_t k = 0; k < 3; ++k)
      sum += a[k] * (b[(k + 1) % 3] * c[(k + 2) % 3] - b[(k + 2) % 3] * c[(k + 1) % 3]);
  }
  return sum / 6;
}

void expect_points(const IndexedMesh& mesh, double unit_m, bool z_negated = false) {
  std::vector<Point> expected(test::kTetrahedron.begin(), test::kTetrahedron.end());
  for (Point& p : expected) {
    for (double& x : p) x *= unit_m;
    if (z_negated) p[2] = -p[2];
  }
  std::ranges::sort(expected);
  const std::vector<Point> found = corners(mesh);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(found[i][k], expected[i][k], 1e-12 * unit_m) << "point " << i << " axis " << k;
  EXPECT_EQ(mesh.faces.size(), 4U);
  EXPECT_GT(signed_volume(mesh), 0) << "faces outward";
}

class EveryFormat : public testing::TestWithParam<FormatFile> {};
INSTANTIATE_TEST_SUITE_P(Formats, EveryFormat, testing::ValuesIn(test::tetrahedron_files()),
                         [](const auto& tested) { return tested.param.name; });

TEST_P(EveryFormat, ComesBackAsWrittenInMetres) {
  const FormatFile& file = GetParam();
  const TempFile on_disk(file.ending, file.bytes);

  const auto mesh = import_mesh(on_disk.path());

  ASSERT_TRUE(mesh.is_ok()) << mesh.status().message();
  expect_points(mesh.value(), file.unit_m, file.left_handed);
}

}  // namespace
}  // namespace nearmesh
