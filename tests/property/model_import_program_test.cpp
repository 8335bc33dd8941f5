// SPDX-License-Identifier: Apache-2.0
// The nearmesh-model program on meshes of every format: true sizes, units and axes, nodes, and the
// way back.
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "folder.hpp"
#include "mesh_file_bytes.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::TempFile;

class ModelImportProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(program())) GTEST_SKIP() << program() << " is not built";
  }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }
  struct Ended {
    int code = -1;
    std::string out, err;
  };
  static Ended run(const std::string& arguments) {
    const TempFile out(".txt"), err(".txt");
    const std::string command =
        program() + " " + arguments + " > " + out.path() + " 2> " + err.path();
    const int code = std::system(command.c_str());
    const auto text = [](const TempFile& file) {
      const auto bytes = file.read();
      return std::string(bytes.begin(), bytes.end());
    };
    return {code, text(out), text(err)};
  }
  static json build(const std::string& mesh, const std::string& model,
                    const std::string& flags = {}) {
    const Ended ended = run("build --json " + flags + " " + mesh + " -o " + model);
    EXPECT_EQ(ended.code, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }
  static json info(const std::string& model) {
    const Ended ended = run("info --json " + model);
    EXPECT_EQ(ended.code, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }
  static void write(const TempFile& file, const std::string& bytes) {
    std::ofstream(file.path(), std::ios::binary) << bytes;
  }
};

std::string inches_z_up() {
  return test::collada("<unit meter=\"0.0254\"/><up_axis>Z_UP</up_axis>", test::collada_node());
}

/// Of the tetrahedron, whose sides are 4, 6 and 10 units.
void expect_size(const json& report, double x, double y, double z) {
  const auto size = report.at("size_m").get<std::array<double, 3>>();
  const double cell_m = report.at("cell_m");
  EXPECT_NEAR(size[0], x, cell_m) << report;
  EXPECT_NEAR(size[1], y, cell_m) << report;
  EXPECT_NEAR(size[2], z, cell_m) << report;
}

TEST_F(ModelImportProgram, BuildAndInfoSayTheTrueSizeAndWhoSaidTheUnit) {
  const TempFile mesh(".dae"), model;
  write(mesh, inches_z_up());
  for (const json& report : {build(mesh.path(), model.path()), info(model.path())}) {
    expect_size(report, 4 * 0.0254, 6 * 0.0254, 10 * 0.0254);
    EXPECT_DOUBLE_EQ(report.at("unit_m"), 0.0254);
    EXPECT_EQ(report.at("unit_source"), "file");
    EXPECT_EQ(report.at("up_axis"), "z");
    EXPECT_EQ(report.at("up_source"), "file");
    EXPECT_EQ(report.at("turned_z_up"), false);
    EXPECT_EQ(report.at("warnings").size(), 0U);
  }
  for (const std::string& text :
       {run("build " + mesh.path() + " -o " + model.path()).out, run("info " + model.path()).out}) {
    EXPECT_NE(text.find("size          0.1016 x 0.1524 x 0.254 m"), std::string::npos) << text;
    EXPECT_NE(text.find("0.0254 m, stated by the file"), std::string::npos) << text;
    EXPECT_NE(text.find("z is up, stated by the file"), std::string::npos) << text;
  }
}

// Boxes of nodes are wider than what is in them; the size of a model is not.
TEST_F(ModelImportProgram, InfoSaysTheSizeOfTheMeshAndNotOfItsBoxes) {
  const TempFile mesh(".ply"), model;
  ASSERT_EQ(run("generate sphere --size 32 -o " + mesh.path()).code, 0);
  for (const json& report : {build(mesh.path(), model.path()), info(model.path())})
    expect_size(report, 2, 2, 2);
}

TEST_F(ModelImportProgram, TakesUnitUpAxisScaleAndNode) {
  const TempFile stl(".stl"), dae(".dae"), model;
  write(stl, test::stl());
  write(dae,
        test::collada("<unit meter=\"1\"/>",
                      test::collada_node() + test::collada_node("<scale>3 3 3</scale>", "big")));
  const json by_unit = build(stl.path(), model.path(), "--unit mm --up y --scale 10");
  for (const json& report : {by_unit, info(model.path())}) {
    expect_size(report, 0.04, 0.1, 0.06);
    EXPECT_EQ(report.at("unit_source"), "option");
    EXPECT_EQ(report.at("up_source"), "option");
    EXPECT_EQ(report.at("turned_z_up"), true);
  }
  expect_size(build(dae.path(), model.path(), "--node big"), 12, 18, 30);
  const Ended stated = run("build --unit mm " + dae.path() + " -o " + model.path());
  EXPECT_NE(stated.code, 0);
  EXPECT_NE(stated.err.find("states its unit"), std::string::npos) << stated.err;
  for (const char* flags : {"--unit yard", "--up x", "--scale 0", "--scale -1", "--node none"})
    EXPECT_NE(run("build " + std::string(flags) + " " + dae.path() + " -o " + model.path()).code, 0)
        << flags;
}

TEST_F(ModelImportProgram, WarnsOfSizesThatHintAtAWrongUnit) {
  const TempFile mesh(".stl"), model;
  write(mesh, test::stl());
  const auto warned = [&](const std::string& flags) {
    const Ended built = run("build " + flags + " " + mesh.path() + " -o " + model.path());
    const Ended shown = run("info " + model.path());
    EXPECT_EQ(built.code + shown.code, 0);
    const bool says = built.err.find("warning") != std::string::npos;
    EXPECT_EQ(says, shown.err.find("warning") != std::string::npos) << flags;
    EXPECT_EQ(says, !info(model.path()).at("warnings").empty()) << flags;
    return says;
  };
  EXPECT_FALSE(warned("--scale 0.00101"));  // the longest side is 10
  EXPECT_TRUE(warned("--scale 0.00099"));
  EXPECT_FALSE(warned("--scale 999"));
  EXPECT_TRUE(warned("--scale 1001"));
}

TEST_F(ModelImportProgram, WarnsWhereTheOptionContradictsTheFile) {
  const TempFile z_up(".dae"), stl(".stl"), model;
  write(z_up, inches_z_up());
  write(stl, test::stl());
  const auto warned = [&](const TempFile& mesh, const std::string& flags) {
    const Ended built = run("build " + flags + " " + mesh.path() + " -o " + model.path());
    EXPECT_EQ(built.code, 0) << built.err;
    const bool says =
        built.err.find(
            "warning: --up says that y is up in the file; the file or its format states "
            "z") != std::string::npos;
    EXPECT_EQ(says, !build(mesh.path(), model.path(), flags).at("warnings").empty()) << flags;
    return says;
  };
  EXPECT_TRUE(warned(z_up, "--up y"));
  EXPECT_FALSE(warned(z_up, "--up z"));
  EXPECT_FALSE(warned(z_up, ""));
  EXPECT_FALSE(warned(stl, "--up y"));  // which states nothing
  EXPECT_TRUE(info(model.path()).at("warnings").empty());
}

TEST_F(ModelImportProgram, BuildsAModelForEachNodeAndASceneThatPlacesThem) {
  const TempFile mesh(".dae"), folder("");
  write(mesh,
        test::collada("<unit meter=\"0.01\"/>",
                      test::collada_node("<translate>100 0 0</translate>", "base",
                                         test::collada_node("<rotate>0 0 1 90</rotate>", "arm"))));
  const Ended ended = run("build --per-node " + mesh.path() + " -o " + folder.path());
  ASSERT_EQ(ended.code, 0) << ended.err;
  const json arm = info(folder.path() + "/arm.spm"), base = info(folder.path() + "/base.spm");
  for (const json& report : {arm, base}) {
    expect_size(report, 0.04, 0.06, 0.1);
    EXPECT_NEAR(report.at("box_min_m")[0].get<double>(), 0.01, 1e-6);
  }
  std::ifstream in(folder.path() + "/scene.yaml");
  const std::string scene{std::istreambuf_iterator<char>(in), {}};
  EXPECT_TRUE(scene.starts_with(
      "# Written by nearmesh-model build --per-node.\nbodies:\n  - {name: \"base\", model: "
      "\"base\", pose: {rotation: "
      "[1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0], translation: [1.0,0.0,0.0]}}\n  - {name: \"arm\""))
      << scene;
  fs::remove_all(folder.path());
}

/// Two nodes, of which the second is a hundred times as large.
std::string small_and_large(const std::string& unit) {
  return test::collada(
      "<unit meter=\"" + unit + "\"/>",
      test::collada_node("", "small") + test::collada_node("<scale>100 100 100</scale>", "large"));
}

TEST_F(ModelImportProgram, ChangesNothingInTheFolderWhereANodeIsRefused) {
  const TempFile mesh(".dae"), folder("");
  const auto bytes_of_all = [&] {
    std::map<std::string, std::string> all;
    for (const auto& file : fs::directory_iterator(folder.path())) {
      std::ifstream in(file.path(), std::ios::binary);
      all[file.path().filename()] = {std::istreambuf_iterator<char>(in), {}};
    }
    return all;
  };
  // The small node takes 160 cells an axis, the large one 16,000 of 4,096.
  const std::string command = "build --per-node --json " + mesh.path() + " -o " + folder.path();
  const std::string too_fine = " --cell 0.0625 --grid-bits 12";
  write(mesh, small_and_large("1"));
  const Ended at_first = run(command + "/new/folders" + too_fine);
  EXPECT_EQ(at_first.code, 256);
  EXPECT_NE(at_first.err.find("node large: "), std::string::npos) << at_first.err;
  EXPECT_EQ(at_first.out, "");
  EXPECT_FALSE(fs::exists(folder.path()));

  ASSERT_EQ(run(command).code, 0);
  const auto before = bytes_of_all();
  EXPECT_EQ(before.size(), 3U);
  write(mesh, small_and_large("1.5"));
  EXPECT_EQ(run(command + too_fine).code, 256);
  EXPECT_EQ(bytes_of_all(), before);
  // What is not refused replaces it all.
  fs::permissions(folder.path() + "/small.spm", fs::perms::owner_read | fs::perms::owner_write);
  ASSERT_EQ(run(command).code, 0);
  const auto after = bytes_of_all();
  EXPECT_EQ(after.size(), 3U);
  for (const char* name : {"small.spm", "large.spm"}) EXPECT_NE(after.at(name), before.at(name));
  EXPECT_EQ(fs::status(folder.path() + "/small.spm").permissions(),
            fs::perms::owner_read | fs::perms::owner_write);
  fs::remove_all(folder.path());
}

TEST_F(ModelImportProgram, WritesNodesWhereLinksLeadIfAllCanBeWritten) {
  const TempFile mesh(".dae");
  const test::Folder folder;
  const std::string nodes = folder.file("nodes");
  const std::string command = "build --per-node " + mesh.path() + " -o " + nodes;
  using FileNames = std::set<std::string>;
  const auto names_in = [](const std::string& path) {
    FileNames names;
    for (const auto& file : fs::directory_iterator(path)) names.insert(file.path().filename());
    return names;
  };
  write(mesh, small_and_large("1"));
  fs::create_directory(nodes);
  fs::create_symlink("../later", nodes + "/small.spm");
  // A file may have a name of this length, but none with a further ending: the first model can be
  // written, the second cannot.
  fs::create_symlink("../" + std::string(250, 'x'), nodes + "/large.spm");
  const Ended refused = run(command);
  EXPECT_EQ(refused.code, 256);
  EXPECT_NE(refused.err.find("node large: " + nodes + "/large.spm: cannot create"),
            std::string::npos)
      << refused.err;
  EXPECT_EQ(names_in(nodes), (FileNames{"large.spm", "small.spm"}));
  EXPECT_EQ(names_in(folder.path()), FileNames{"nodes"});

  fs::remove(nodes + "/large.spm");
  ASSERT_EQ(run(command).code, 0);
  EXPECT_EQ(names_in(nodes), (FileNames{"large.spm", "scene.yaml", "small.spm"}));
  EXPECT_EQ(names_in(folder.path()), (FileNames{"later", "nodes"}));
  EXPECT_TRUE(fs::is_symlink(nodes + "/small.spm"));
  expect_size(info(folder.file("later")), 4, 6, 10);
}

TEST_F(ModelImportProgram, ListsTheFormats) {
  const Ended text = run("formats"), listed = run("formats --json");
  ASSERT_EQ(text.code + listed.code, 0);
  const json formats = json::parse(listed.out);
  EXPECT_EQ(formats.size(), mesh_formats().size());
  for (const json& format : formats) {
    EXPECT_NE(text.out.find(format.at("name").get<std::string>()), std::string::npos);
    for (const char* key : {"endings", "reader", "unit", "up", "nodes"})
      EXPECT_FALSE(format.at(key).get<std::string>().empty());
  }
}

// ---- there and back -----------------------------------------------------------------------------

using Corners = std::array<std::array<double, 3>, 3>;

/// Faces by their corners' places, each from its least corner on, sorted.
std::vector<Corners> faces_of(const std::string& path) {
  const Result<IndexedMesh> mesh = import_mesh(path);
  EXPECT_TRUE(mesh.is_ok()) << mesh.status().message();
  std::vector<Corners> faces;
  if (!mesh.is_ok()) return faces;
  for (const auto& face : mesh.value().faces) {
    Corners at{};
    for (std::size_t k = 0; k < 3; ++k) at[k] = mesh.value().positions_m[face[k]];
    std::rotate(at.begin(), std::min_element(at.begin(), at.end()), at.end());
    faces.push_back(at);
  }
  std::ranges::sort(faces);
  return faces;
}

class ModelImportAndExport : public ModelImportProgram {
 protected:
  /// The second model has the faces of the first, bit by bit.
  static void expect_the_same_back(const std::string& mesh) {
    const TempFile first, second, exported(".ply"), again(".ply");
    const json built = build(mesh, first.path());
    ASSERT_EQ(run("export " + first.path() + " -o " + exported.path()).code, 0);
    const json rebuilt = build(exported.path(), second.path());
    ASSERT_EQ(run("export " + second.path() + " -o " + again.path()).code, 0);
    EXPECT_EQ(rebuilt.at("box_min_m"), built.at("box_min_m"));
    EXPECT_EQ(rebuilt.at("box_max_m"), built.at("box_max_m"));
    EXPECT_EQ(rebuilt.at("cell_m"), built.at("cell_m"));
    const auto faces = faces_of(exported.path());
    EXPECT_FALSE(faces.empty());
    EXPECT_TRUE(faces == faces_of(again.path()));
  }
};

TEST_F(ModelImportAndExport, GiveTheSameModelForEachFormat) {
  for (const test::FormatFile& file : test::tetrahedron_files()) {
    SCOPED_TRACE(file.name);
    const TempFile mesh(file.ending);
    write(mesh, file.bytes);
    expect_the_same_back(mesh.path());
  }
}

TEST_F(ModelImportAndExport, GiveTheSameRobot) {
  const fs::path folder = fs::path(NEARMESH_TEST_DATA) / "robot/ur5";
  if (!fs::exists(folder)) GTEST_SKIP() << "no test data at " << folder;
  expect_the_same_back((folder / "visual/wrist3.dae").string());
  expect_the_same_back((folder / "collision/forearm.stl").string());
}

}  // namespace
}  // namespace nearmesh
