// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <clocale>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh {
namespace {

using Triple = std::array<std::uint32_t, 3>;
using Point = std::array<double, 3>;

/// A file of this test's own, gone afterwards.
class TempFile {
 public:
  TempFile(const std::string& ending, const std::string& bytes)
      : path_(testing::TempDir() + "nearmesh_" +
              testing::UnitTest::GetInstance()->current_test_info()->name() + ending) {
    std::ofstream(path_, std::ios::binary) << bytes;
  }
  ~TempFile() { std::remove(path_.c_str()); }
  TempFile(const TempFile&) = delete;
  TempFile& operator=(const TempFile&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

Result<IndexedMesh> import_bytes(const std::string& ending, const std::string& bytes) {
  const TempFile file(ending, bytes);
  return import_mesh(file.path());
}

IndexedMesh import_good(const std::string& ending, const std::string& bytes) {
  auto mesh = import_bytes(ending, bytes);
  EXPECT_TRUE(mesh.is_ok()) << mesh.status().message();
  return mesh.is_ok() ? std::move(mesh).value() : IndexedMesh{};
}

void expect_refused(const std::string& ending, const std::string& bytes, StatusCode code,
                    const std::string& message_part) {
  const TempFile file(ending, bytes);
  const auto mesh = import_mesh(file.path());
  ASSERT_FALSE(mesh.is_ok());
  EXPECT_EQ(mesh.status().code(), code) << mesh.status().message();
  EXPECT_NE(mesh.status().message().find(message_part), std::string::npos)
      << mesh.status().message();
  EXPECT_TRUE(mesh.status().message().starts_with(file.path()));
}

// --- what is no file ---

/// For our own readers and for assimp's.
TEST(ImportMesh, RefusesWhatIsNoRegularFileAtOnce) {
  const std::string stem =
      testing::TempDir() + "nearmesh_no_file_" + std::to_string(::getpid()) + "_";
  for (const std::string ending : {".obj", ".ply", ".stl", ".off", ".dae"}) {
    const std::string fifo = stem + "fifo" + ending, folder = stem + "folder" + ending,
                      device = stem + "device" + ending;
    ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
    ASSERT_EQ(::mkdir(folder.c_str(), 0700), 0);
    ASSERT_EQ(::symlink("/dev/zero", device.c_str()), 0);
    ::alarm(10);
    for (const std::string& path : {fifo, folder, device}) {
      const auto mesh = import_mesh(path);
      ASSERT_FALSE(mesh.is_ok());
      EXPECT_EQ(mesh.status().code(), StatusCode::kIo);
      EXPECT_EQ(mesh.status().message(), path + ": expected a regular file");
    }
    ::alarm(0);
    for (const std::string& path : {fifo, folder, device}) std::filesystem::remove(path);
  }
}

// --- PLY ---

std::string ascii_ply(const std::string& vertices, const std::string& faces,
                      const std::string& body) {
  return "ply\nformat ascii 1.0\nelement vertex " + vertices +
         "\nproperty float x\nproperty float y\nproperty float z\nelement face " + faces +
         "\nproperty list uchar int vertex_indices\nend_header\n" + body;
}

TEST(ImportMesh, ReadsBackWhatWritePlyWrote) {
  const std::string path = testing::TempDir() + "nearmesh_roundtrip.ply";
  const IndexedMesh mesh = generate_terrain(30, 1);
  ASSERT_TRUE(write_ply(mesh, path).is_ok());

  const auto read = import_mesh(path);
  std::remove(path.c_str());

  ASSERT_TRUE(read.is_ok()) << read.status().message();
  EXPECT_EQ(read.value().positions_m, mesh.positions_m);
  EXPECT_EQ(read.value().faces, mesh.faces);
}

TEST(ImportMesh, KeepsDoublePrecisionOfPly) {
  const std::string path = testing::TempDir() + "nearmesh_doubles.ply";
  const IndexedMesh mesh{{{1e7 + 0.1, 0.1, 0}, {1e7, 1, 0}, {1e7, 0, 1.0 / 3}}, {{0, 1, 2}}};
  ASSERT_TRUE(write_ply(mesh, path).is_ok());

  const auto read = import_mesh(path);
  std::remove(path.c_str());

  ASSERT_TRUE(read.is_ok());
  EXPECT_EQ(read.value().positions_m, mesh.positions_m);
}

TEST(ImportMesh, RefusesEveryTruncationOfPly) {
  const std::string path = testing::TempDir() + "nearmesh_truncation.ply";
  ASSERT_TRUE(write_ply(generate_sphere(4, 0), path).is_ok());
  std::ifstream file(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), {}};
  std::remove(path.c_str());
  ASSERT_TRUE(import_bytes(".ply", bytes).is_ok());

  for (std::size_t size = 0; size < bytes.size(); ++size)
    ASSERT_FALSE(import_bytes(".ply", bytes.substr(0, size)).is_ok()) << size;
}

TEST(ImportMesh, SkipsUnknownElementsAndPropertiesOfPly) {
  const IndexedMesh mesh = import_good(
      ".ply",
      "ply\r\nformat ascii 1.0\r\ncomment a\r\nobj_info b\r\nelement vertex 3\r\n"
      "property uchar red\r\nproperty int x\r\nproperty list uchar float w\r\nproperty double y\r\n"
      "property float32 z\r\nelement junk 1\r\nproperty list int short s\r\nelement face 1\r\n"
      "property list uint8 uint32 vertex_index\r\nproperty char c\r\nend_header\r\n"
      "255 0 2 7 7 0 0\r\n255 1 0 0 0\r\n255 0 0 1.5 0\r\n3 1 2 3\r\n3 0 1 2 9\r\n");

  EXPECT_EQ(mesh.positions_m, (std::vector<Point>{{0, 0, 0}, {1, 0, 0}, {0, 1.5, 0}}));
  EXPECT_EQ(mesh.faces, (std::vector<Triple>{{0, 1, 2}}));
}

TEST(ImportMesh, ReadsPlyWithFacesBeforeVertices) {
  const IndexedMesh mesh = import_good(
      ".ply",
      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\n"
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
      "3 2 1 0\n0 0 0\n1 0 0\n0 1 0\n");

  EXPECT_EQ(mesh.faces, (std::vector<Triple>{{2, 1, 0}}));
}

TEST(ImportMesh, RefusesLyingPlyHeaders) {
  const std::string body = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  ASSERT_TRUE(import_bytes(".ply", ascii_ply("3", "1", body)).is_ok());
  expect_refused(".ply", ascii_ply("-3", "1", body), StatusCode::kCorrupt, "count of element");
  expect_refused(".ply", ascii_ply("99999999999999999999", "1", body), StatusCode::kCorrupt,
                 "count of element");
  expect_refused(".ply", ascii_ply("4000000000", "1", body), StatusCode::kCorrupt, "announces");
  expect_refused(".ply", ascii_ply("3", "2", body), StatusCode::kCorrupt, "face 1 of 2");
}

TEST(ImportMesh, RefusesPlyIndexOutOfRange) {
  const std::string vertices = "0 0 0\n1 0 0\n0 1 0\n";
  expect_refused(".ply", ascii_ply("3", "1", vertices + "3 0 1 3\n"), StatusCode::kCorrupt,
                 "PLY face 0");
  expect_refused(".ply", ascii_ply("3", "1", vertices + "3 0 1 -1\n"), StatusCode::kCorrupt,
                 "PLY face 0");
}

TEST(ImportMesh, RefusesPlyOfTriangleStrips) {
  expect_refused(".ply",
                 "ply\nformat ascii 1.0\nelement vertex 0\nelement tristrips 1\n"
                 "property list int int vertex_indices\nend_header\n0 \n",
                 StatusCode::kUnsupported, "strips");
}

// --- STL ---

TEST(ImportMesh, ReadsAsciiStlOfTwoSolids) {
  const std::string facet =
      "FACET normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
      "endloop\nendfacet\n";
  const IndexedMesh mesh = import_good(
      ".STL", "solid facet of my own\n" + facet + "endsolid a b\nsolid\n" + facet + "endsolid\n");

  EXPECT_EQ(mesh.faces, (std::vector<Triple>{{0, 1, 2}, {3, 4, 5}}));
  EXPECT_EQ(mesh.positions_m.at(4), (Point{1, 0, 0}));
}

TEST(ImportMesh, RefusesAsciiStlWithoutItsEnd) {
  const std::string text =
      "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
      "endloop\nendfacet\n";
  expect_refused(".stl", text, StatusCode::kCorrupt, "endsolid");
  ASSERT_TRUE(import_bytes(".stl", text + "endsolid a\n").is_ok());
}

TEST(ImportMesh, RefusesBinaryStlOfAnotherSize) {
  std::string bytes(84 + 2 * 50, '\0');
  bytes[80] = 2;
  ASSERT_TRUE(import_bytes(".stl", bytes).is_ok());
  bytes[80] = 3;
  expect_refused(".stl", bytes, StatusCode::kCorrupt, "3 facets announced make 234 bytes");
}

TEST(ImportMesh, RefusesBinaryStlWithNan) {
  std::string bytes(84 + 50, '\0');
  bytes[80] = 1;
  bytes.replace(84 + 12, 4, "\xff\xff\xff\x7f");
  expect_refused(".stl", bytes, StatusCode::kInvalidArgument, "vertex 0");
}

// --- OFF ---

TEST(ImportMesh, ReadsOffWithCommentsBetweenLinesAndColours) {
  const IndexedMesh mesh = import_good(
      ".off",
      "# first\nOFF 4 2 0 # counts\n\n# vertices\n0 0 0\n1 0 0 # one\n1 1 0\n# in between\n0 1 0\n"
      "# faces\n\n3 0 1 2 255 0 0\n#\n3 0 2 3");

  EXPECT_EQ(mesh.positions_m.at(3), (Point{0, 1, 0}));
  EXPECT_EQ(mesh.faces, (std::vector<Triple>{{0, 1, 2}, {0, 2, 3}}));
}

TEST(ImportMesh, ReadsOffFacesOfManyCorners) {
  std::string text = "OFF\n12 1 0\n", face = "12";
  for (int i = 0; i < 12; ++i) {
    text += std::to_string(i) + " " + std::to_string(i * (11 - i)) + " 0\n";
    face.append(" ").append(std::to_string(i));
  }

  EXPECT_EQ(import_good(".off", text + face + "\n").faces.size(), 10U);
}

TEST(ImportMesh, RefusesOffThatEndsEarly) {
  expect_refused(".off", "OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n", StatusCode::kCorrupt,
                 "expected 4 vertices");
  expect_refused(".off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", StatusCode::kCorrupt,
                 "expected 2 faces");
  expect_refused(".off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", StatusCode::kCorrupt,
                 "line 6");
}

TEST(ImportMesh, RefusesOffIndexOutOfRange) {
  const std::string start = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
  expect_refused(".off", start + "3 0 1 3\n", StatusCode::kCorrupt, "OFF line 6");
  expect_refused(".off", start + "3 0 1 -1\n", StatusCode::kCorrupt, "OFF line 6");
}

TEST(ImportMesh, RefusesOffOfOtherCoordinates) {
  expect_refused(".off", "4OFF\n1 0 0\n0 0 0 0\n", StatusCode::kUnsupported, "4OFF");
  expect_refused(".off", "OFF BINARY\n1 0 0\n", StatusCode::kUnsupported, "binary");
}

// --- OBJ ---

TEST(ImportMesh, ReadsObjFacesInFileOrderAcrossMaterials) {
  const IndexedMesh mesh = import_good(
      ".obj",
      "mtllib none.mtl\nv 0 0 0\nv 1 0 0 # x\nv 0 1 0\nv 0 0 1\nvt 0 0\nvn 0 0 1\nusemtl a\n"
      "f 1/1/1 2//1 3/1\nusemtl b\no other\nf 1 2 \\\n4\nusemtl a\nf -4 -2 -1 # back\nl 1 2\np "
      "1\n");

  EXPECT_EQ(mesh.positions_m.size(), 4U);
  EXPECT_EQ(mesh.faces, (std::vector<Triple>{{0, 1, 2}, {0, 1, 3}, {0, 2, 3}}));
}

TEST(ImportMesh, ReadsObjFaceBeforeItsVertices) {
  EXPECT_EQ(import_good(".obj", "f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").faces,
            (std::vector<Triple>{{0, 1, 2}}));
}

TEST(ImportMesh, RefusesObjIndicesThatDoNotExist) {
  const std::string vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (const std::string index : {"0", "4", "-4", "99999999999999999999", "5000000000", "x", "/1"})
    expect_refused(".obj", vertices + "f 1 2 " + index + "\n", StatusCode::kCorrupt, "OBJ line 4");
}

TEST(ImportMesh, RefusesObjIndexZeroThatCouldMeanTheNextVertex) {
  expect_refused(".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\nv 0 0 1\n", StatusCode::kCorrupt,
                 "OBJ line 4");
}

TEST(ImportMesh, RefusesCoordinatesThatAreNoFiniteNumbers) {
  const std::string rest = "v 1 0 0\nv 0 1 0\nf 1 2 3\n";
  for (const std::string word : {"nan", "-inf", "1e400"})
    expect_refused(".obj", "v 0 " + word + " 0\n" + rest, StatusCode::kInvalidArgument, word);
  for (const std::string word : {"1.2.3", "abc", ""})
    expect_refused(".obj", "v 0 0 " + word + "\n" + rest, StatusCode::kCorrupt, "OBJ line 1");
}

TEST(ImportMesh, ReadsUnusualNumbers) {
  const IndexedMesh mesh =
      import_good(".obj", "v +1. .5 1E2\nv -1e-400 0 1e-310\nv 2 0 0\nf 1 2 3\n");

  EXPECT_EQ(mesh.positions_m.at(0), (Point{1, 0.5, 100}));
  EXPECT_EQ(mesh.positions_m.at(1), (Point{0, 0, 1e-310}));
}

/// While it lives the C library's decimal point is a comma, as in a host that speaks German; where
/// the machine has such a locale.
class DecimalComma {
 public:
  DecimalComma() {
    for (const char* name : {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "de_DE"})
      if (!is_set) is_set = std::setlocale(LC_NUMERIC, name) != nullptr;
  }
  ~DecimalComma() { std::setlocale(LC_NUMERIC, "C"); }
  DecimalComma(const DecimalComma&) = delete;
  DecimalComma& operator=(const DecimalComma&) = delete;
  bool is_set = false;
};

TEST(ImportMesh, ReadsNumbersAlikeInAnyLocaleOfTheHost) {
  const DecimalComma comma;
  if (!comma.is_set) GTEST_SKIP() << "no locale with a decimal comma";
  const IndexedMesh mesh =
      import_good(".obj", "v 1.5 0 0\nv 2.5e-400 -2.5e-400 1\nv 2.5 0 0\nf 1 2 3\n");
  EXPECT_EQ(mesh.positions_m.at(0), (Point{1.5, 0, 0}));
  EXPECT_EQ(mesh.positions_m.at(1), (Point{0, 0, 1}));
  expect_refused(".obj", "v 0 1.5e400 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", StatusCode::kInvalidArgument,
                 "1.5e400");
}

TEST(ImportMesh, RefusesUtf16) {
  expect_refused(".obj",
                 std::string("\xff\xfe"
                             "v\0",
                             4),
                 StatusCode::kUnsupported, "UTF-16");
}

// --- any ---

TEST(ImportMesh, RefusesMeshWithoutFaces) {
  expect_refused(".obj", "v 0 0 0\n", StatusCode::kInvalidArgument, "at least one face");
}

TEST(ImportMesh, RefusesWhatIsNoFile) {
  EXPECT_EQ(import_mesh("/nonexistent.ply").status().code(), StatusCode::kIo);
  EXPECT_EQ(import_mesh(testing::TempDir()).status().code(), StatusCode::kIo);
  EXPECT_EQ(import_mesh("/dev/zero").status().code(), StatusCode::kIo);
}

TEST(ImportMesh, RefusesFormatWithoutReader) {
  expect_refused(".nearmesh", "what is this", StatusCode::kUnsupported, "assimp");
}

TEST(ImportMesh, RefusesZipUnderAnotherName) {
  expect_refused(".obj", "PK\x03\x04 and so on", StatusCode::kCorrupt, "zip");
}

constexpr const char* kColladaHead =
    R"(<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1" name="meter"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4</vcount><p>0 1 2 3</p>
</polylist></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">)";
constexpr const char* kColladaTail =
    R"(</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>)";

TEST(ImportMesh, AppliesTransformsOfNodes) {
  const IndexedMesh mesh =
      import_good(".dae", std::string(kColladaHead) +
                              "<node><translate>10 0 0</translate><node><scale>2 3 4</scale>"
                              "<instance_geometry url=\"#g\"/></node></node>" +
                              kColladaTail);

  ASSERT_EQ(mesh.faces.size(), 2U);
  bool found = false;
  for (const Point& p : mesh.positions_m) found = found || p == Point{12, 3, 0};
  EXPECT_TRUE(found);
}

TEST(ImportMesh, TurnsFacesOfMirroredNodes) {
  const auto upward = [](const IndexedMesh& mesh) {
    int count = 0;
    for (const Triple& f : mesh.faces) {
      const Point &a = mesh.positions_m[f[0]], &b = mesh.positions_m[f[1]],
                  &c = mesh.positions_m[f[2]];
      if ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0) ++count;
    }
    return count;
  };
  const std::string node = "<instance_geometry url=\"#g\"/></node>";
  const std::string head = kColladaHead, tail = kColladaTail;

  EXPECT_EQ(upward(import_good(".dae", head + "<node>" + node + tail)), 2);
  EXPECT_EQ(upward(import_good(".dae", head + "<node><scale>-1 1 1</scale>" + node + tail)), 2);
}

}  // namespace
}  // namespace nearmesh
