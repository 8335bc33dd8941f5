// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <iterator>

#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {
namespace {

std::string read_bytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(WritePly, WritesHeaderAndLittleEndianBody) {
  const std::string path = testing::TempDir() + "nearmesh_write_ply.ply";
  const IndexedMesh mesh{{{1, 0, -2}, {0, 0, 0}, {0, 0, 0}}, {{0, 1, 258}}};

  ASSERT_TRUE(write_ply(mesh, path).is_ok());

  const std::string bytes = read_bytes(path);
  std::remove(path.c_str());
  const std::string header =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty double x\n"
      "property double y\nproperty double z\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n";
  ASSERT_EQ(bytes.size(), header.size() + 3 * 24 + 13);
  EXPECT_EQ(bytes.substr(0, header.size()), header);
  EXPECT_EQ(bytes.substr(header.size(), 8), std::string("\0\0\0\0\0\0\xf0\x3f", 8));
  EXPECT_EQ(bytes.substr(bytes.size() - 13), std::string("\x03\0\0\0\0\x01\0\0\0\x02\x01\0\0", 13));
}

TEST(WritePly, WritesEveryBatch) {
  const std::string path = testing::TempDir() + "nearmesh_write_ply_batches.ply";
  const IndexedMesh mesh = generate_terrain(50, 1);

  ASSERT_TRUE(write_ply(mesh, path).is_ok());

  const std::string bytes = read_bytes(path);
  std::remove(path.c_str());
  const std::size_t header = bytes.find("end_header\n") + 11;
  EXPECT_EQ(bytes.size() - header, mesh.positions_m.size() * 24 + mesh.faces.size() * 13);
}

TEST(WritePly, NamesPathItCannotCreate) {
  const Status status = write_ply(generate_sphere(4, 0), "/nonexistent/folder/a.ply");

  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_NE(status.message().find("/nonexistent/folder/a.ply"), std::string::npos);
}

TEST(WritePly, ReplacesPlyFilesAndNothingElse) {
  const std::string path = testing::TempDir() + "nearmesh_write_ply_over.ply";
  for (const char* old : {"ply\nformat ascii 1.0\n", "ply\r\n", "solid"}) {
    std::ofstream(path) << old;
    const bool is_ply = old[0] == 'p';
    EXPECT_EQ(write_ply(generate_sphere(4, 0), path).code(),
              is_ply ? StatusCode::kOk : StatusCode::kConflict);
    EXPECT_EQ(read_bytes(path) == old, !is_ply);
  }
  std::remove(path.c_str());
}

TEST(WritePly, TellsOfFullDisk) {
  EXPECT_EQ(write_ply(generate_sphere(4, 0), "/dev/full").code(), StatusCode::kIo);
  EXPECT_EQ(write_ply(generate_sphere(64, 0), "/dev/full").code(), StatusCode::kIo);
}

}  // namespace
}  // namespace nearmesh
