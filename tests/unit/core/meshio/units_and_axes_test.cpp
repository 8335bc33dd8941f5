// SPDX-License-Identifier: Apache-2.0
// Coordinates are the file's, in metres, whatever the format: one tetrahedron, written by hand in
// each.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <sstream>

#include "mesh_file_bytes.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh {
namespace {

using test::FormatFile;
using Point = std::array<double, 3>;

/// A file of this test's own, gone afterwards.
class WrittenFile {
 public:
  WrittenFile(const std::string& ending, const std::string& bytes)
      : path_(testing::TempDir() + "nearmesh_units_" +
              testing::UnitTest::GetInstance()->current_test_info()->name()) {
    std::replace(path_.begin() + static_cast<std::ptrdiff_t>(testing::TempDir().size()),
                 path_.end(), '/', '_');
    path_ += ending;
    std::ofstream(path_, std::ios::binary) << bytes;
  }
  ~WrittenFile() { std::remove(path_.c_str()); }
  WrittenFile(const WrittenFile&) = delete;
  WrittenFile& operator=(const WrittenFile&) = delete;
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
  const WrittenFile on_disk(file.ending, file.bytes);

  const auto mesh = import_mesh(on_disk.path());

  ASSERT_TRUE(mesh.is_ok()) << mesh.status().message();
  expect_points(mesh.value(), file.unit_m, file.left_handed);
}

TEST_P(EveryFormat, SaysWhoStatesItsUnitAndItsUpAxis) {
  const FormatFile& file = GetParam();
  const WrittenFile on_disk(file.ending, file.bytes);

  const auto imported = import_mesh(on_disk.path(), ImportOptions{});

  ASSERT_TRUE(imported.is_ok()) << imported.status().message();
  const MeshOrigin& origin = imported.value().origin;
  EXPECT_DOUBLE_EQ(origin.unit_m, file.unit_m);
  EXPECT_EQ(origin.unit_source == OriginSource::kFile || file.name.starts_with("Gltf"),
            file.stated);
  constexpr const char* kLetters = "-xyz";
  EXPECT_EQ(kLetters[static_cast<int>(origin.up)], file.up);
  EXPECT_EQ(origin.up_source == OriginSource::kNobody, file.up == '-');
  EXPECT_FALSE(origin.z_up);
  EXPECT_EQ(imported.value().stated_up, origin.up);
  const auto turned = import_mesh(on_disk.path(), {.up = UpAxis::kY});
  EXPECT_EQ(turned.value().stated_up, origin.up) << "whatever the options say";
}

TEST_P(EveryFormat, TakesAUnitOnlyWhereItStatesNone) {
  const FormatFile& file = GetParam();
  const WrittenFile on_disk(file.ending, file.bytes);

  const auto imported = import_mesh(on_disk.path(), {.unit_m = 0.3048});

  EXPECT_EQ(imported.is_ok(), !file.stated);
  if (!imported.is_ok()) {
    EXPECT_EQ(imported.status().code(), StatusCode::kInvalidArgument);
    return;
  }
  EXPECT_EQ(imported.value().origin.unit_source, OriginSource::kOption);
  expect_points(imported.value().mesh, 0.3048, file.left_handed);
}

TEST_P(EveryFormat, IsTurnedAsTheOptionSaysAndScaled) {
  const FormatFile& file = GetParam();
  const WrittenFile on_disk(file.ending, file.bytes);

  const auto as_z = import_mesh(on_disk.path(), {.up = UpAxis::kZ, .scale = 2});
  const auto as_y = import_mesh(on_disk.path(), {.up = UpAxis::kY, .scale = 2});

  ASSERT_TRUE(as_z.is_ok() && as_y.is_ok()) << as_z.status().message();
  expect_points(as_z.value().mesh, 2 * file.unit_m, file.left_handed);
  EXPECT_TRUE(as_z.value().origin.z_up && as_y.value().origin.z_up);
  IndexedMesh back = as_y.value().mesh;  // what was y is z now; z went to -y
  for (Point& p : back.positions_m) p = {p[0], p[2], -p[1]};
  expect_points(back, 2 * file.unit_m, file.left_handed);
}

TEST(ImportOptions, RefusesWhatIsNoLengthAndNoAxis) {
  const WrittenFile file(".obj", test::obj());
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::infinity(), std::nan("")}) {
    EXPECT_FALSE(import_mesh(file.path(), {.scale = bad}).is_ok()) << bad;
    EXPECT_FALSE(import_mesh(file.path(), {.unit_m = bad}).is_ok()) << bad;
  }
  EXPECT_FALSE(import_mesh(file.path(), {.up = UpAxis::kX}).is_ok());
  EXPECT_FALSE(import_mesh(file.path(), {.scale = 1e308}).is_ok());  // 13e308 is no double
}

// ---- what files say of their units --------------------------------------------------------------

void expect_file_refused(const std::string& ending, const std::string& bytes, StatusCode code,
                         const std::vector<std::string>& parts) {
  const WrittenFile file(ending, bytes);
  const auto imported = import_mesh(file.path(), ImportOptions{});
  ASSERT_FALSE(imported.is_ok()) << parts.front();
  EXPECT_EQ(imported.status().code(), code) << imported.status().message();
  for (const std::string& part : parts)
    EXPECT_NE(imported.status().message().find(part), std::string::npos)
        << imported.status().message();
  EXPECT_TRUE(imported.status().message().starts_with(file.path()));
}

std::string dxf_with(const std::string& header) {
  return "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n" + header + "0\nENDSEC\n" + test::dxf();
}

TEST(Dxf, IsInTheUnitOfItsHeader) {
  struct Case {
    const char* number;
    double unit_m;
  };
  for (const Case& tested :
       {Case{"1", 0.0254}, Case{"     2", 0.3048}, Case{"4", 1e-3}, Case{"5\r", 1e-2}, Case{"6", 1},
        Case{"7", 1000}, Case{"21", 1200.0 / 3937.0}}) {
    const WrittenFile file(".dxf",
                           dxf_with("  9\n$INSUNITS\n 70\n" + std::string(tested.number) + "\n"));
    const auto imported = import_mesh(file.path(), ImportOptions{});
    ASSERT_TRUE(imported.is_ok()) << imported.status().message();
    EXPECT_EQ(imported.value().origin.unit_source, OriginSource::kFile) << tested.number;
    expect_points(imported.value().mesh, tested.unit_m);
    EXPECT_EQ(import_mesh(file.path(), {.unit_m = 0.5}).status().code(),
              StatusCode::kInvalidArgument);
  }
}

TEST(Dxf, StatesNoUnitByZeroOrOutsideItsHeader) {
  const std::string inches = "9\n$INSUNITS\n70\n1\n";
  for (const std::string& bytes :
       {dxf_with("9\n$INSUNITS\n70\n0\n"), dxf_with("9\n$MEASUREMENT\n70\n1\n"),
        dxf_with("9\n$INSUNITS\n"), dxf_with("1\n$INSUNITS\n70\n1\n"), test::dxf() + inches}) {
    const WrittenFile file(".dxf", bytes);
    const auto imported = import_mesh(file.path(), {.unit_m = 0.5});
    ASSERT_TRUE(imported.is_ok()) << imported.status().message();
    expect_points(imported.value().mesh, 0.5);
  }
}

TEST(Dxf, RefusesUnitsThatAreNotKnownByNumber) {
  for (const std::string number : {"18", "22", "-1", "99999999999"})
    expect_file_refused(".dxf", dxf_with("9\n$INSUNITS\n70\n" + number + "\n"),
                        StatusCode::kUnsupported, {"$INSUNITS", "\"" + number + "\"", "--unit"});
  expect_file_refused(".dxf", dxf_with("9\n$INSUNITS\n70\nmm\n"), StatusCode::kCorrupt,
                      {"$INSUNITS", "\"mm\""});
}

TEST(AdditiveFormats, RefuseUnitsThatTheirStandardLacks) {
  for (const std::string unit : {"in", "inches", "kilometer", "millimeters"})
    expect_file_refused(
        ".3mf", test::three_mf("unit=\"" + unit + "\""), StatusCode::kCorrupt,
        {"3MF", "micron, millimeter, centimeter, inch, foot, meter", "\"" + unit + "\""});
  expect_file_refused(".amf", test::amf("unit=\"parsec\""), StatusCode::kCorrupt, {"\"parsec\""});
  const WrittenFile foot(".3mf", test::three_mf("unit=\"foot\""));
  expect_points(import_mesh(foot.path(), ImportOptions{}).value().mesh, 0.3048);
}

TEST(AdditiveFormats, StateNothingInComments) {
  std::string bytes = test::amf("unit=\"inch\"");
  bytes.insert(bytes.find("<amf"), "<!-- <amf unit=\"meter\"> --><!-- > -->");
  const WrittenFile file(".amf", bytes);
  const auto imported = import_mesh(file.path(), ImportOptions{});
  ASSERT_TRUE(imported.is_ok()) << imported.status().message();
  EXPECT_EQ(imported.value().origin.unit_source, OriginSource::kFile);
  expect_points(imported.value().mesh, 0.0254);
}

// ---- what glTF demands --------------------------------------------------------------------------

/// `member`: of the outermost object, with a comma behind.
std::string gltf_with(const std::string& member) {
  return test::gltf(R"({"mesh":0,"name":"n"})").insert(1, member);
}
/// The same in the binary form, without buffers: what is demanded is looked at before they are.
std::string glb_with(const std::string& member) {
  std::string text = gltf_with(member), out = "glTF";
  text.resize((text.size() + 3) / 4 * 4, ' ');
  test::put(out, std::uint32_t{2});
  test::put(out, static_cast<std::uint32_t>(20 + text.size()));
  test::put(out, static_cast<std::uint32_t>(text.size()));
  return out + "JSON" + text;
}

TEST(Gltf, RefusesByNameWhatItDemandsAndAssimpWouldSkip) {
  for (const std::string name :
       {"KHR_mesh_quantization", "EXT_meshopt_compression", "KHR_draco_mesh_compression",
        "EXT_mesh_gpu_instancing", "KHR_lights_punctual_2", "MY_own"}) {
    const std::string demands =
        R"("extensionsRequired" : ["KHR_materials_unlit", ")" + name + "\"],";
    const std::vector<std::string> parts{"extensionsRequired", "\"" + name + "\"", "export"};
    expect_file_refused(".gltf", gltf_with(demands), StatusCode::kUnsupported, parts);
    expect_file_refused(".glb", glb_with(demands), StatusCode::kUnsupported, parts);
    // By its content, where its ending says something else.
    expect_file_refused(".model3d", "\n " + gltf_with(demands), StatusCode::kUnsupported, parts);
  }
  expect_file_refused(".gltf", gltf_with(R"("extensions\u0052equired":["MY_own"],)"),
                      StatusCode::kUnsupported, {"MY_own"});
  expect_file_refused(".gltf", gltf_with("\"name\":\"\xe9\",\"extensionsRequired\":[\"MY_own\"],"),
                      StatusCode::kUnsupported, {"MY_own"});
}

TEST(Gltf, TakesDemandsThatLeaveGeometryAlone) {
  for (const std::string member :
       {R"("extensionsRequired":["KHR_materials_unlit","KHR_texture_transform",)"
        R"("KHR_lights_punctual","KHR_xmp_json_ld","KHR_animation_pointer","EXT_texture_webp",)"
        R"("EXT_lights_image_based"],)",
        R"("extensionsRequired":[],)", R"("extensionsUsed":["MY_own"],)",
        R"("extras":{"extensionsRequired":["MY_own"]},)",
        R"("extras":[{"extensionsRequired":7},"extensionsRequired",["MY_own"]],)"}) {
    const WrittenFile file(".gltf", gltf_with(member));
    const auto imported = import_mesh(file.path());
    ASSERT_TRUE(imported.is_ok()) << imported.status().message();
    expect_points(imported.value(), 1);
  }
}

TEST(Gltf, RefusesDemandsThatAreNoListOfNames) {
  for (const std::string odd : {"null", "true", "7", "-7", "7.5", "\"MY_own\"", "{}", "[7]", "[[]]",
                                "[{}]", "[\"KHR_xmp\",null]"})
    expect_file_refused(".gltf", gltf_with("\"extensionsRequired\":" + odd + ","),
                        StatusCode::kCorrupt, {"extensionsRequired: expected a list of names"});
}

TEST(Gltf, RefusesWhatIsNoJsonWithoutHarm) {
  const std::string whole = gltf_with(""), binary = glb_with("");
  for (std::size_t size = 1; size < whole.size(); size += 97)
    expect_file_refused(".gltf", whole.substr(0, size), StatusCode::kCorrupt, {"glTF: byte "});
  for (std::size_t size = 4; size < binary.size() - 4; size += 97)
    expect_file_refused(".glb", binary.substr(0, size), StatusCode::kCorrupt, {"glTF: byte "});
  // As deep as a file is long.
  expect_file_refused(".gltf", "{\"a\":" + std::string(4'000'000, '['), StatusCode::kCorrupt,
                      {"glTF: byte "});
  const std::string deep = "\"extras\":" + std::string(1'000'000, '[') +
                           std::string(1'000'000, ']') + ",\"extensionsRequired\":[\"MY_own\"],";
  expect_file_refused(".gltf", gltf_with(deep), StatusCode::kUnsupported, {"MY_own"});
}

// ---- nodes --------------------------------------------------------------------------------------

IndexedMesh placed(const ImportedNode& node) {
  IndexedMesh mesh = node.mesh;
  for (Point& p : mesh.positions_m) {
    Point at = node.translation_m;
    for (std::size_t r = 0; r < 3; ++r)
      for (std::size_t c = 0; c < 3; ++c) at[r] += node.rotation[3 * r + c] * p[c];
    p = at;
  }
  return mesh;
}

void expect_near(const IndexedMesh& a, const IndexedMesh& b, double tolerance_m) {
  const std::vector<Point> at = corners(a), expected = corners(b);
  ASSERT_EQ(at.size(), expected.size());
  for (std::size_t i = 0; i < at.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(at[i][k], expected[i][k], tolerance_m);
}

/// A base with an arm on it, which is turned by a quarter, moved, and twice as long along x.
std::string robot(const std::string& asset) {
  return test::collada(
      asset, test::collada_node("<translate>10 20 30</translate>", "base",
                                test::collada_node("<translate>0 0 5</translate>"
                                                   "<rotate>0 0 1 90</rotate><scale>2 1 1</scale>",
                                                   "arm")) +
                 test::collada_node("<scale>-1 1 1</scale>", "mirror"));
}

TEST(ImportNodes, GivesEachNodeItsOwnFrameAndItsPlaceInTheFile) {
  const WrittenFile file(".dae", robot("<unit meter=\"0.01\"/><up_axis>Z_UP</up_axis>"));

  const auto nodes = import_nodes(file.path(), {});

  ASSERT_TRUE(nodes.is_ok()) << nodes.status().message();
  ASSERT_EQ(nodes.value().nodes.size(), 3U);
  const ImportedNode &base = nodes.value().nodes[0], &arm = nodes.value().nodes[1],
                     &mirror = nodes.value().nodes[2];
  EXPECT_EQ(base.name + arm.name + mirror.name, "basearmmirror");
  expect_points(base.mesh, 0.01);
  EXPECT_NEAR(base.translation_m[1], 0.2, 1e-12);
  EXPECT_NEAR(arm.translation_m[2], 0.35, 1e-12);
  EXPECT_NEAR(arm.rotation[3], 1, 1e-6);  // x goes to y
  EXPECT_NEAR(corners(arm.mesh).back()[0], 0.1, 1e-8);
  EXPECT_GT(signed_volume(mirror.mesh), 0);
  // Each where the whole file has it.
  for (const ImportedNode& node : nodes.value().nodes) {
    if (node.name == "base") continue;  // as a node that is asked for it brings the arm with it
    const auto alone = import_mesh(file.path(), {.node = node.name});
    ASSERT_TRUE(alone.is_ok()) << alone.status().message();
    expect_near(placed(node), alone.value().mesh, 1e-8);
  }
}

TEST(ImportNodes, PlacesTurnedModelsInATurnedWorld) {
  const WrittenFile file(".dae", robot("<unit meter=\"1\"/><up_axis>Y_UP</up_axis>"));
  const ImportOptions z_up{.up = UpAxis::kY};

  const auto nodes = import_nodes(file.path(), z_up);

  ASSERT_TRUE(nodes.is_ok()) << nodes.status().message();
  for (const ImportedNode& node : nodes.value().nodes) {
    if (node.name == "base") continue;
    ImportOptions options = z_up;
    options.node = node.name;
    expect_near(placed(node), import_mesh(file.path(), options).value().mesh, 1e-5);
  }
}

TEST(ImportNodes, TakesANodeWithWhatHangsOnIt) {
  const WrittenFile file(".dae", robot(""));
  EXPECT_EQ(import_mesh(file.path(), {.node = "base"}).value().mesh.faces.size(), 8U);
  EXPECT_EQ(import_mesh(file.path(), {.node = "arm"}).value().mesh.faces.size(), 4U);
  EXPECT_EQ(import_mesh(file.path()).value().faces.size(), 12U);

  const auto none = import_mesh(file.path(), {.node = "leg"});
  ASSERT_FALSE(none.is_ok());
  EXPECT_EQ(none.status().code(), StatusCode::kNotFound);
  EXPECT_NE(none.status().message().find("base, arm, mirror"), std::string::npos)
      << none.status().message();
}

TEST(ImportNodes, TakesObjectsOfAnObj) {
  const std::string vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
  const WrittenFile file(".obj", vertices +
                                     "f 1 2 3\no a\nf 1 2 4\ng ignored\no b\nf 2 3 4 1\no a\n"
                                     "f 3 1 4\n");

  const auto nodes = import_nodes(file.path(), {});

  ASSERT_TRUE(nodes.is_ok()) << nodes.status().message();
  ASSERT_EQ(nodes.value().nodes.size(), 3U);
  EXPECT_EQ(nodes.value().nodes[0].name, "node");
  EXPECT_EQ(nodes.value().nodes[1].name, "a");
  EXPECT_EQ(nodes.value().nodes[1].mesh.faces.size(), 2U);
  EXPECT_EQ(nodes.value().nodes[1].mesh.positions_m.size(), 4U);
  EXPECT_EQ(import_mesh(file.path(), {.node = "b"}).value().mesh.faces.size(), 2U);
  EXPECT_EQ(import_mesh(file.path(), {.node = "c"}).status().code(), StatusCode::kNotFound);
  EXPECT_EQ(import_mesh(file.path()).value().faces.size(), 5U);
}

TEST(ImportNodes, NamesNodesForFiles) {
  const WrittenFile file(".dae", test::collada("", test::collada_node("", "a/../b") +
                                                       test::collada_node("", "a_.._b")));

  const auto nodes = import_nodes(file.path(), {});

  ASSERT_TRUE(nodes.is_ok()) << nodes.status().message();
  EXPECT_EQ(nodes.value().nodes[0].name, "a_.._b");
  EXPECT_EQ(nodes.value().nodes[1].name, "a_.._b_2");
}

TEST(ImportNodes, GivesTheWholeOfAFileWithoutNodes) {
  const WrittenFile file(".stl", test::stl());
  const auto nodes = import_nodes(file.path(), {});
  ASSERT_TRUE(nodes.is_ok());
  ASSERT_EQ(nodes.value().nodes.size(), 1U);
  expect_points(nodes.value().nodes[0].mesh, 1);
  EXPECT_EQ(import_mesh(file.path(), {.node = "t"}).status().code(), StatusCode::kNotFound);
}

TEST(MeshFormats, NameEveryEndingOnce) {
  std::vector<std::string> endings;
  for (const MeshFormat& format : mesh_formats()) {
    std::istringstream words{std::string(format.endings)};
    for (std::string word; words >> word;) endings.push_back(word);
  }
  for (const FormatFile& file : test::tetrahedron_files())
    EXPECT_EQ(std::ranges::count(endings, file.ending.substr(1)), 1) << file.ending;
}

}  // namespace
}  // namespace nearmesh
