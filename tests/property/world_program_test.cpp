// SPDX-License-Identifier: Apache-2.0
// nearmesh-model build-world: grids and meshes in, a world out; plans; what is there is not baked
// again.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string_view>

#include "core/world/world_folder.hpp"
#include "hostile_world.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::TempFile;

constexpr int kColumns = 41, kRows = 31;

/// A hill with a hole, as raw samples and as text.
std::int16_t sample(int row, int column) {
  if (row == 7 && column > 30 && column < 34) return -32768;
  return static_cast<std::int16_t>(100 + 3 * row - (column - 20) * (column - 20) / 4 +
                                   row * column % 7);
}

class WorldProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(program())) GTEST_SKIP() << program() << " is not built";
    fs::create_directories(folder_);
    std::ofstream raw(path("hill.raw"), std::ios::binary);
    std::ofstream asc(path("hill.asc"));
    asc << "ncols " << kColumns << "\nnrows " << kRows
        << "\nxllcenter 10\nyllcenter -20\ncellsize 2.5\nNODATA_value -32768\n";
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kColumns; ++c) {
        const std::int16_t x = sample(r, c);
        raw.put(static_cast<char>(x & 0xff)).put(static_cast<char>(x >> 8));
        asc << x << (c + 1 == kColumns ? '\n' : ' ');
      }
  }
  void TearDown() override { fs::remove_all(folder_); }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }
  [[nodiscard]] std::string path(const std::string& name) const {
    return (fs::path(folder_) / name).string();
  }
  struct Ended {
    int code = -1;
    std::string out, err;
  };
  static Ended run_command(const std::string& command) {
    const TempFile out(".txt"), err(".txt");
    const int code = std::system((command + " > " + out.path() + " 2> " + err.path()).c_str());
    const auto text = [](const TempFile& file) {
      const auto bytes = file.read();
      return std::string(bytes.begin(), bytes.end());
    };
    return {code, text(out), text(err)};
  }
  [[nodiscard]] static Ended model(const std::string& words) {
    return run_command(program() + " " + words);
  }
  [[nodiscard]] std::string raw_flags() const {
    return path("hill.raw") +
           " --raw 41x31,i16le --spacing 2.5,2.5 --corner 10,-20 --nodata -32768 --crs file";
  }
  static json parse(const Ended& ended) {
    EXPECT_EQ(ended.code, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }

  const std::string folder_ = ::testing::TempDir() + "nearmesh_world_" + std::to_string(::getpid());
};

/// By place on the lattice, how often tiles have a vertex there, and all faces.
struct Surface {
  std::map<std::array<std::int64_t, 3>, int> vertices;
  std::multiset<std::array<std::array<std::int64_t, 3>, 3>> faces;
};

void add_model(const std::string& file_path, const std::array<std::int64_t, 3>& place,
               Surface& surface) {
  Result<ModelFile> file = ModelFile::open(file_path);
  ASSERT_TRUE(file.is_ok()) << file.status().message();
  ASSERT_TRUE(file.value().require_all().is_ok());
  const SplitStore& store = file.value().store();
  const auto at = [&](VertexId v) {
    std::array<std::int64_t, 3> x;
    for (std::size_t k = 0; k < 3; ++k) x[k] = place[k] + store.position(v).v[k];
    return x;
  };
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v) ++surface.vertices[at({v})];
  const auto add = [&](const SplitFace& face) {
    auto corners = face.corners();
    std::array<std::array<std::int64_t, 3>, 3> places{at(corners[0]), at(corners[1]),
                                                      at(corners[2])};
    std::ranges::sort(places);
    surface.faces.insert(places);
  };
  for (const SplitFace& face : store.base_faces()) add(face);
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
    if (!store.is_root({v}))
      for (const SplitFace& face : store.faces({v})) add(face);
}

void add_world(const WorldFolder& world, const WorldPage& page, Surface& surface) {
  for (const WorldEntry& entry : page.entries) {
    if (page.level > 0) {
      const auto below = world.page(entry, page.level - 1);
      ASSERT_TRUE(below.is_ok()) << below.status().message();
      add_world(world, below.value(), surface);
    } else {
      add_model(world.tile_path(entry.content), {entry.place[0], entry.place[1], entry.place[2]},
                surface);
    }
  }
}

Surface surface_of(const std::string& folder) {
  Surface surface;
  const auto world = WorldFolder::open(folder);
  EXPECT_TRUE(world.is_ok()) << world.status().message();
  const auto root = world.value().root();
  EXPECT_TRUE(root.is_ok()) << root.status().message();
  add_world(world.value(), root.value(), surface);
  return surface;
}

TEST_F(WorldProgram, ItsTilesAreTheGridEachFaceOnce) {
  const std::string lattice = " --cell 0.01 --lattice-origin=-3,7,100";
  const json report = parse(
      model("build-world " + raw_flags() + lattice + " -o " + path("w") + " --faces 100 --json"));
  EXPECT_EQ(report.at("tiles").get<int>(), 6 * 5) << report.dump();
  EXPECT_EQ(report.at("baked"), report.at("tiles"));
  EXPECT_EQ(report.at("cell_m"), 0.0078125);
  const Surface tiles = surface_of(path("w"));
  ASSERT_EQ(model("build " + raw_flags() + lattice + " -o " + path("whole.spm")).code, 0);
  Result<ModelFile> whole = ModelFile::open(path("whole.spm"));
  ASSERT_TRUE(whole.is_ok());
  EXPECT_EQ(whole.value().header().face_count, report.at("faces").get<std::uint32_t>());
  Surface expected;
  add_model(path("whole.spm"), whole.value().header().grid.lattice_cells, expected);
  EXPECT_EQ(tiles.faces, expected.faces);
  // Posts at borders stand in two tiles, at corners in four.
  std::map<int, int> shared;
  for (const auto& [place, times] : tiles.vertices) ++shared[times];
  EXPECT_EQ(tiles.vertices.size(), expected.vertices.size());
  EXPECT_GT(shared[2], 200);
  EXPECT_GE(shared[4], 18);
  EXPECT_EQ(shared[3] + shared[4], 19) << "of 20 corners, one at the hole";
}

TEST_F(WorldProgram, AMeshIsCutSoThatNoFaceIsLostOrDoubled) {
  ASSERT_EQ(model("generate aircraft --size 1500 -o " + path("a.ply")).code, 0);
  const json report = parse(model("build-world " + path("a.ply") + " -o " + path("w") +
                                  " --faces 200 --cell 0.001 --lattice-origin=0,0,0 --json"));
  EXPECT_GE(report.at("tiles").get<int>(), 8);
  ASSERT_EQ(model("build " + path("a.ply") + " --cell 0.001 -o " + path("whole.spm")).code, 0);
  Result<ModelFile> whole = ModelFile::open(path("whole.spm"));
  ASSERT_TRUE(whole.is_ok());
  Surface expected;
  add_model(path("whole.spm"), whole.value().header().grid.lattice_cells, expected);
  EXPECT_EQ(surface_of(path("w")).faces, expected.faces);
}

TEST_F(WorldProgram, GridAndMeshStandInOneWorldOnALatticeThatItChooses) {
  ASSERT_EQ(model("generate sphere --size 16 -o " + path("s.ply")).code, 0);
  const std::string world = " -o " + path("w") + " --faces 300 --json";
  const json report =
      parse(model("build-world " + path("hill.asc") + " " + path("s.ply") + " --crs file" + world));
  EXPECT_GT(report.at("tiles").get<int>(), 8);
  // 21 bits hold the largest tile: some 30 m.
  EXPECT_LE(report.at("cell_m").get<double>(), 0x1p-14);
  const json info = parse(model("info --json " + path("w")));
  EXPECT_EQ(info.at("world"), report.at("world"));
  EXPECT_EQ(info.at("tiles_missing"), 0);
  EXPECT_EQ(model("check " + path("w")).code, 0);
  // Another input joins the lattice that is there.
  ASSERT_EQ(model("generate sphere --size 8 -o " + path("t.ply")).code, 0);
  const json more = parse(model("build-world " + path("hill.asc") + " " + path("s.ply") + " " +
                                path("t.ply") + " --crs file" + world));
  EXPECT_EQ(more.at("cell_m"), report.at("cell_m"));
  EXPECT_EQ(more.at("origin_m"), report.at("origin_m"));
  EXPECT_EQ(more.at("kept"), report.at("tiles"));
  EXPECT_EQ(more.at("baked"), 1);
}

TEST_F(WorldProgram, WhatIsThereIsNotBakedAgain) {
  const std::string command =
      "build-world " + raw_flags() + " -o " + path("w") + " --faces 200 --json";
  const json first = parse(model(command)), second = parse(model(command));
  EXPECT_EQ(second.at("baked"), 0);
  EXPECT_EQ(second.at("kept"), first.at("tiles"));
  EXPECT_EQ(second.at("world"), first.at("world"));
  // Another plan of the same tiles: they are known by what is in them.
  fs::remove_all(path("w") + "/plans");
  EXPECT_EQ(parse(model(command)).at("baked"), 0);
  // One tile is lost.
  const std::string lost = fs::directory_iterator(path("w") + "/tiles")->path().string();
  fs::remove(lost);
  EXPECT_EQ(model("check " + path("w")).code, 256);
  EXPECT_EQ(parse(model("info --json " + path("w"))).at("tiles_missing"), 1);
  EXPECT_EQ(parse(model(command)).at("baked"), 1);
  EXPECT_TRUE(fs::exists(lost));
  EXPECT_EQ(model("check " + path("w")).code, 0);
}

// Of the same size as before, so that only its bytes tell.
TEST_F(WorldProgram, ADamagedTileIsBakedAnew) {
  const std::string command =
      "build-world " + raw_flags() + " -o " + path("w") + " --faces 200 --json";
  const json first = parse(model(command));
  for (const double share : {0.1, 0.5, 0.99}) {
    const std::string tile = fs::directory_iterator(path("w") + "/tiles")->path().string();
    const auto at = static_cast<std::streamoff>(share * static_cast<double>(fs::file_size(tile)));
    std::fstream file(tile, std::ios::binary | std::ios::in | std::ios::out);
    const char was = static_cast<char>(file.seekg(at).get());
    file.seekp(at).put(static_cast<char>(was ^ 1));
    file.close();
    ASSERT_EQ(model("check " + path("w")).code, 256) << "at " << share;
    const Ended again = model(command);
    EXPECT_EQ(parse(again).at("baked"), 1) << "at " << share;
    EXPECT_EQ(parse(again).at("world"), first.at("world"));
    EXPECT_NE(again.err.find(tile + ": is damaged, and baked anew"), std::string::npos)
        << again.err;
    EXPECT_EQ(model("check " + path("w")).code, 0) << "at " << share;
  }
}

TEST_F(WorldProgram, WarnsOfItsInputsAsBuildDoes) {
  const auto warnings = [](const Ended& ended) {
    std::set<std::string> found;
    std::istringstream lines(ended.err);
    constexpr std::string_view kWarning = ": warning: ";
    for (std::string line; std::getline(lines, line);)
      if (const std::size_t at = line.find(kWarning); at != std::string::npos)
        found.insert(line.substr(at + kWarning.size()));
    return found;
  };
  ASSERT_EQ(model("generate sphere --size 16 -o " + path("s.ply")).code, 0);
  const std::string tiny = path("s.ply") + " --scale 0.0001 -o ";
  const Ended world = model("build-world " + tiny + path("w") + " --faces 100 --json");
  const Ended alone = model("build " + tiny + path("s.spm"));
  ASSERT_EQ(warnings(world).size(), 1U) << world.err;
  ASSERT_EQ(warnings(alone).size(), 1U) << alone.err;
  // But for the length, which build takes from vertices that it has rounded.
  const auto but_length = [&](const Ended& ended) {
    const std::string text = *warnings(ended).begin();
    return text.substr(std::min(text.size(), text.find(", less than a centimetre: is its unit")));
  };
  EXPECT_GT(but_length(world).size(), 100U) << world.err;
  EXPECT_EQ(but_length(world), but_length(alone));
  const json listed = parse(world).at("warnings");
  ASSERT_EQ(listed.size(), 1U);
  EXPECT_EQ(listed[0].at("input"), path("s.ply"));
  EXPECT_EQ(listed[0].at("text"), *warnings(world).begin());
  // The one hole of the hill is in few of its windows.
  const std::string flags = " --faces 100 --json -o ";
  EXPECT_EQ(warnings(model("build-world " + raw_flags() + flags + path("h"))),
            std::set<std::string>{});
  std::string wrong = raw_flags();
  wrong.replace(wrong.find("-32768"), 6, "-32767");
  const Ended unmatched = model("build-world " + wrong + flags + path("n"));
  EXPECT_EQ(warnings(unmatched), warnings(model("build " + wrong + " -o " + path("n.spm"))));
  EXPECT_NE(warnings(unmatched).count("--nodata: no post has the sample -32767: is it right?"), 0U)
      << unmatched.err;
}

TEST_F(WorldProgram, APlanFollowsTheLatticeOfTheWorldThatIsThere) {
  const std::string command =
      "build-world " + raw_flags() + " -o " + path("w") + " --faces 200 --json";
  const json first = parse(model(command));
  const json coarse = parse(model(command + " --cell 0.5 --lattice-origin=0,0,0"));
  ASSERT_NE(coarse.at("cell_m"), first.at("cell_m"));
  for (int round = 0; round < 2; ++round) {
    const json again = parse(model(command));
    EXPECT_EQ(again.at("cell_m"), 0.5);
    EXPECT_EQ(again.at("origin_m"), coarse.at("origin_m"));
    EXPECT_EQ(again.at("world"), coarse.at("world"));
    EXPECT_EQ(again.at("baked"), 0);
  }
}

// Two inputs that fall on the same points of the lattice from other places: their tiles differ in
// what rounding took.
TEST_F(WorldProgram, ItsNameDoesNotFollowFromWhatWasBakedBefore) {
  const auto build = [this](const std::string& east, const std::string& world) {
    return parse(model("build-world " + path("hill.raw") +
                       " --raw 41x31,i16le --spacing 2.5,2.5 --nodata -32768 --crs file --corner " +
                       east + ",-20 --cell 0.0078125 --lattice-origin=0,0,0 --json -o " +
                       path(world)));
  };
  const json exact = build("10", "w"), after = build("10.001", "w"), alone = build("10.001", "v");
  EXPECT_NE(exact.at("world"), alone.at("world"));
  EXPECT_EQ(after.at("world"), alone.at("world"));
  EXPECT_EQ(build("10", "v").at("world"), exact.at("world"));
}

TEST_F(WorldProgram, TheSameTilesMayStandManyTimes) {
  const std::string command =
      "build-world " + raw_flags() + " --cell 0.01 -o " + path("w") + " --faces 300 --json";
  const json once = parse(model(command)), often = parse(model(command + " --repeat 5x3"));
  EXPECT_EQ(often.at("tiles").get<int>(), 15 * once.at("tiles").get<int>());
  EXPECT_EQ(often.at("faces").get<int>(), 15 * once.at("faces").get<int>());
  EXPECT_EQ(often.at("distinct_tiles"), once.at("distinct_tiles"));
  EXPECT_EQ(often.at("baked"), 0);
  EXPECT_EQ(model("check " + path("w")).code, 0);
  const json info = parse(model("info --json " + path("w")));
  EXPECT_NEAR(info.at("box_max_m")[0].get<double>(), 10 + 5 * 100, 30)
      << "boxes are rounded outward";
  EXPECT_NE(model(command + " --repeat 5").code, 0);
}

TEST_F(WorldProgram, ACraterIsATileAndThePagesAboveIt) {
  const std::string command =
      "build-world " + raw_flags() + " -o " + path("w") + " --faces 60 --json";
  const json before = parse(model(command));
  const auto pages = [this] {
    std::set<std::string> names;
    for (const auto& file : fs::directory_iterator(path("w") + "/pages")) names.insert(file.path());
    return names;
  };
  const std::size_t pages_before = pages().size();
  {
    std::fstream raw(path("hill.raw"), std::ios::binary | std::ios::in | std::ios::out);
    raw.seekp(2 * (3 * kColumns + 3));
    raw.put(20).put(0);
  }
  const json after = parse(model(command));
  EXPECT_EQ(after.at("baked"), 1);
  EXPECT_NE(after.at("world"), before.at("world"));
  EXPECT_EQ(pages().size(), pages_before + 2) << "levels 0 and 1; old pages stay";
  EXPECT_EQ(model("check " + path("w")).code, 0);
}

TEST_F(WorldProgram, APlansCommandsMakeTheSameWorld) {
  const std::string flags = "build-world " + raw_flags() + " --faces 300 --threads 2";
  const json direct = parse(model(flags + " -o " + path("w") + " --json"));
  ASSERT_EQ(model(flags + " -o " + path("v") + " --plan " + path("jobs.txt")).code, 0);
  std::ifstream in(path("jobs.txt"));
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  ASSERT_EQ(lines.size(), direct.at("tiles").get<std::size_t>() + 1);
  for (std::size_t i = lines.size() - 1; i-- > 0;)
    EXPECT_EQ(run_command(lines[i]).code, 0) << lines[i];
  const json last = parse(run_command(lines.back() + " --json"));
  EXPECT_EQ(last.at("world"), direct.at("world"));
  EXPECT_EQ(last.at("baked"), 0);
  ASSERT_EQ(model(flags + " -o " + path("v") + " --plan " + path("jobs.ninja")).code, 0);
  std::ifstream ninja(path("jobs.ninja"));
  const std::string text((std::istreambuf_iterator<char>(ninja)), std::istreambuf_iterator<char>());
  EXPECT_NE(text.find(": pages "), std::string::npos);
  EXPECT_NE(text.find("--only $tile"), std::string::npos);
}

// The first tile is reported, then the grid changes; the pipe holds fewer lines than the 1,200
// tiles have, so not all of them were read before.
TEST_F(WorldProgram, AnInputThatChangesWhileItIsReadMakesNoWorld) {
  const Ended ended =
      run_command("{ " + program() + " build-world " + raw_flags() + " --faces 2 -o " + path("w") +
                  " 2>&1 > /dev/null || echo failed; } | { read -r line; printf xy >> " +
                  path("hill.raw") + "; cat; }");
  EXPECT_NE(ended.out.find("hill.raw: has changed while it was read"), std::string::npos);
  EXPECT_NE(ended.out.find("failed"), std::string::npos);
  EXPECT_FALSE(fs::exists(path("w") + "/world.nmw"));
}

// A glTF keeps its places in a file beside it.
TEST_F(WorldProgram, AChangedFileBesideAnInputIsAChangedInput) {
  std::ofstream(path("s.gltf"))
      << R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "buffers": [{"uri": "s.bin", "byteLength": 36}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}]})";
  std::set<std::string> worlds;
  for (const float x : {2.0F, 1.0F}) {
    const float places[9] = {0, 0, 0, x, 0, 0, 0, 1, 0};
    std::ofstream(path("s.bin"), std::ios::binary)
        .write(reinterpret_cast<const char*>(places), sizeof places);
    worlds.insert(parse(model("build-world " + path("s.gltf") + " -o " + path("w") + " --json"))
                      .at("world")
                      .get<std::string>());
  }
  EXPECT_EQ(worlds.size(), 2U);
}

TEST_F(WorldProgram, CellOrOriginAloneLeaveTheRestOfTheLatticeThatIsThere) {
  const std::string command = "build-world " + raw_flags() + " -o " + path("w") + " --json";
  const json first = parse(model(command + " --cell 0.01"));
  {
    std::fstream raw(path("hill.raw"), std::ios::binary | std::ios::in | std::ios::out);
    raw.put(0).put(20);  // far above all that was there, whose middle was the origin
  }
  const json crater = parse(model(command + " --cell 0.01"));
  EXPECT_NE(crater.at("world"), first.at("world"));
  EXPECT_EQ(crater.at("origin_m"), first.at("origin_m"));
  const json moved = parse(model(command + " --lattice-origin=1,2,3"));
  EXPECT_EQ(moved.at("cell_m"), first.at("cell_m"));
  EXPECT_EQ(moved.at("origin_m"), json({1.0, 2.0, 3.0}));
}

// Bytes that are no UTF-8, and all that a shell or ninja reads in its own way.
TEST_F(WorldProgram, NamesOfFilesMayHoldAnyBytes) {
  const std::string odd = path("h\xe4 $x: a|b \"c");
  fs::create_directories(odd);
  fs::copy(path("hill.asc"), odd + "/hill.asc");
  const std::string flags = "build-world '" + odd + "/hill.asc' --crs file --faces 800";
  const json direct = parse(model(flags + " --json -o '" + odd + "/w'"));
  EXPECT_EQ(parse(model("info --json '" + odd + "/w'")).at("world"), direct.at("world"));
  parse(model("build '" + odd + "/hill.asc' --crs file --json -o '" + odd + "/one.spm'"));
  parse(model("info --json '" + odd + "/one.spm'"));
  EXPECT_NE(model(flags + " -o '" + path("a\nb") + "' --plan " + path("jobs.txt")).code, 0);
  if (std::system("ninja --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "no ninja";
  ASSERT_EQ(model(flags + " -o '" + odd + "/v' --plan " + path("jobs.ninja")).code, 0);
  EXPECT_EQ(run_command("ninja -C " + folder_ + " -f jobs.ninja").code, 0);
  EXPECT_EQ(run_command("ninja -C " + folder_ + " -f jobs.ninja -n").out.find("tile"),
            std::string::npos)
      << "all is made";
  EXPECT_EQ(parse(model("info --json '" + odd + "/v'")).at("world"), direct.at("world"));
}

/// Of the hill's frame: one pose a line, with the same poses of both bodies turned and moved
/// together.
void write_poses(const std::string& path, int count) {
  Random random(12);
  std::ofstream out(path);
  out << "id";
  for (const char* body : {"A", "B"}) {
    for (int i = 0; i < 9; ++i) out << ',' << body << "_R" << i / 3 << i % 3;
    for (int k = 0; k < 3; ++k) out << ',' << body << "_T" << k;
  }
  out << std::setprecision(17) << '\n';
  for (int n = 0; n < count; ++n) {
    Pose world, body{test::random_rotation(random), {}};
    if (n % 3 > 0) world.rotation = test::random_rotation(random);
    const double far_m = n % 3 == 2 ? 6.4e6 : 500;
    for (double& t : world.translation_m) t = random.between(-far_m, far_m);
    // Near corners of tiles, at the ground's height or above.
    const int column = 8 * static_cast<int>(1 + random.below(4)),
              row = 6 * static_cast<int>(1 + random.below(4));
    const double at[3] = {10 + 2.5 * column, -20 + 2.5 * (kRows - 1 - row),
                          sample(row, column) + random.between(-1, 10)};
    body.translation_m = world.translation_m;
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t i = 0; i < 3; ++i)
        body.translation_m[k] += world.rotation[3 * k + i] * at[i];
    out << n;
    for (const Pose* pose : {&world, &body}) {
      for (const double x : pose->rotation) out << ',' << x;
      for (const double x : pose->translation_m) out << ',' << x;
    }
    out << '\n';
  }
}

// The proof of a world: it is the merged mesh, at its seams and corners, turned and geocentric.
TEST_F(WorldProgram, AnswersAsTheMergedMeshDoes) {
  const std::string lattice = " --cell 0.002 --lattice-origin=50,10,100 ";
  ASSERT_EQ(model("build-world " + raw_flags() + lattice + "-o " + path("w") + " --faces 25").code,
            0);
  ASSERT_EQ(model("build " + raw_flags() + lattice + "-o " + path("whole.spm")).code, 0);
  ASSERT_EQ(model("generate sphere --size 12 -o " + path("s.ply")).code, 0);
  ASSERT_EQ(model("build " + path("s.ply") + " --scale 3 -o " + path("s.spm")).code, 0);
  write_poses(path("poses.csv"), 90);
  const auto lines = [this](const std::string& of) {
    const Ended ended =
        model("query " + of + " " + path("s.spm") + " --json --poses " + path("poses.csv"));
    EXPECT_EQ(ended.code, 0) << ended.err;
    std::vector<json> out;
    std::istringstream in(ended.out);
    for (std::string line; std::getline(in, line);)
      out.push_back(json::parse(line, nullptr, false));
    return out;
  };
  const std::vector<json> tiled = lines(path("w")), merged = lines(path("whole.spm"));
  ASSERT_EQ(tiled.size(), 90U);
  ASSERT_EQ(merged.size(), 90U);
  int contacts = 0, free = 0, tiles = 0;
  for (std::size_t i = 0; i < tiled.size(); ++i) {
    EXPECT_EQ(tiled[i].at("status"), merged[i].at("status")) << i;
    EXPECT_EQ(tiled[i].at("pairs"), merged[i].at("pairs")) << i;
    contacts += tiled[i].at("status") == "contact" ? 1 : 0;
    free += tiled[i].at("status") == "free" ? 1 : 0;
    tiles += tiled[i].at("tiles").get<int>();
  }
  EXPECT_GT(contacts, 20);
  EXPECT_GT(free, 5);
  EXPECT_LT(tiles, 90 * 20) << "of more than 100";
}

// A ball of several tiles inside a solid ball, and next to it.
TEST_F(WorldProgram, CheckLooksForTilesInsideASolidBody) {
  ASSERT_EQ(model("generate sphere --size 12 -o " + path("s.ply")).code, 0);
  const json world = parse(
      model("build-world " + path("s.ply") + " --cell 0.001 --faces 60 --json -o " + path("w")));
  EXPECT_GE(world.at("tiles").get<int>(), 2);
  const json solid =
      parse(model("build " + path("s.ply") + " --scale 3 --json -o " + path("big.spm")));
  const auto check = [&](const char* status, int east_m, bool is_world_a) {
    const std::string w = is_world_a ? "a" : "b", s = is_world_a ? "b" : "a";
    const json line = {{w, "rock"},
                       {s, "lake"},
                       {"model_" + w, "w"},
                       {"model_" + s, "big"},
                       {"content_" + w, world.at("world")},
                       {"content_" + s, solid.at("content_hash")},
                       {"solid_" + s, true},
                       {"status", status},
                       {"contained", w + "_in_" + s},
                       {"pairs", 0},
                       {"pose_" + w, {1, 0, 0, 0, 1, 0, 0, 0, 1, east_m, 0, 0}},
                       {"pose_" + s, {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}}};
    std::ofstream(path("a.jsonl")) << line.dump() << '\n';
    return model("check " + path("w") + " " + path("big.spm") + " --answers " + path("a.jsonl"))
        .code;
  };
  for (const bool is_world_a : {true, false}) {
    EXPECT_EQ(check("contained", 0, is_world_a), 0);
    EXPECT_EQ(check("free", 0, is_world_a), 256);
    EXPECT_EQ(check("contained", 9, is_world_a), 256);
    EXPECT_EQ(check("free", 9, is_world_a), 0);
  }
}

TEST_F(WorldProgram, SaysWhatIsWrong) {
  const auto says = [](const Ended& ended, const std::string& what) {
    EXPECT_EQ(ended.code, 256);
    EXPECT_NE(ended.err.find(what), std::string::npos) << ended.err;
  };
  says(model("build-world " + path("none.ply") + " -o " + path("w")), "none.ply");
  says(model("build-world " + path("hill.asc") + " -o " + path("w")), "--crs");
  says(model("build-world " + raw_flags() +
             " --cell 1e-6 --grid-bits 10 --lattice-origin=0,0,0 -o " + path("w")),
       "tile 0 (" + path("hill.raw"));
  says(model("build-world " + raw_flags() + " --only 99 -o " + path("w")),
       "expected a tile below 1");
  says(model("info " + folder_), "world.nmw");
  const std::string world = path("v");
  ASSERT_EQ(model("build-world " + raw_flags() + " --faces 100 -o " + world).code, 0);
  const std::string page = fs::directory_iterator(world + "/pages")->path().string();
  std::fstream(page, std::ios::binary | std::ios::in | std::ios::out).seekp(20).put(1);
  says(model("info " + world), fs::path(page).filename().string());
}

// Eight such pages would take 36^7 steps; of four whoever follows each entry comes to the end, and
// says something else.
TEST_F(WorldProgram, RefusesAWorldWhosePagesAreListedAgain) {
  const WorldPages hostile = test::world_that_repeats_its_pages(4);
  ASSERT_TRUE(write_world(hostile, path("w")).is_ok());
  for (const char* command : {"info ", "check "}) {
    const Ended ended = model(command + path("w"));
    EXPECT_EQ(ended.code, 256);
    for (const std::string& what : {path("w"), to_hex(hostile.name), std::string("listed again")})
      EXPECT_NE(ended.err.find(what), std::string::npos) << ended.err;
  }
}

TEST_F(WorldProgram, RefusesAWorldThatListsATileTwiceInOnePlace) {
  PlacedTile tile;
  tile.content = {1, 1};
  tile.extent = {9, 9, 9};
  tile.faces = 4;
  PlacedTile wider = tile;
  wider.extent[2] = 12;
  const auto hostile = make_pages({}, 21, {tile, wider});
  ASSERT_TRUE(hostile.is_ok()) << hostile.status().message();
  ASSERT_TRUE(write_world(hostile.value(), path("w")).is_ok());
  for (const char* command : {"info ", "check "}) {
    const Ended ended = model(command + path("w"));
    EXPECT_EQ(ended.code, 256);
    for (const std::string& what : {path("w"), to_hex(tile.content), std::string("twice at")})
      EXPECT_NE(ended.err.find(what), std::string::npos) << ended.err;
  }
}

TEST_F(WorldProgram, ProbeTellsHeightsAboveTilesAsAboveOneModel) {
  ASSERT_EQ(model("build-world " + raw_flags() + " -o " + path("world") + " --faces 300").code, 0);
  ASSERT_EQ(model("build " + raw_flags() + " -o " + path("one.spm")).code, 0);
  std::ofstream rays(path("rays.csv"));
  rays << "x,y,z,dx,dy,dz,range\n";
  for (int i = 0; i < 40; ++i)
    rays << 12 + 2.3 * i << ',' << -18 + 1.7 * i << ",500," << 0.01 * i << ",0,-1,"
         << (i % 7 == 0 ? 1 : 1000) << '\n';
  rays.close();
  const Ended tiles = model("probe " + path("world") + " --rays " + path("rays.csv"));
  const Ended one = model("probe " + path("one.spm") + " --rays " + path("rays.csv"));
  ASSERT_EQ(tiles.code, 0) << tiles.err;
  ASSERT_EQ(one.code, 0) << one.err;
  std::istringstream of_tiles(tiles.out), of_one(one.out);
  std::string a, b;
  int lines = 0, hits = 0;
  while (std::getline(of_tiles, a) && std::getline(of_one, b)) {
    ++lines;
    const json of_world = json::parse(a), of_model = json::parse(b);
    ASSERT_EQ(of_world["status"], of_model["status"]);
    if (of_world["status"] != "hit") continue;
    ++hits;
    EXPECT_NEAR(of_world["distance_m"].get<double>(), of_model["distance_m"].get<double>(), 0.02);
    EXPECT_EQ(of_world["tile"].get<std::string>().size(), 32U);
    EXPECT_TRUE(of_model.contains("face"));
  }
  EXPECT_EQ(lines, 40);
  EXPECT_GT(hits, 8);
  EXPECT_EQ(model("probe " + path("world") + " --rays " + path("none.csv")).code, 256);
  EXPECT_EQ(model("probe " + path("world")).code, 512);  // as the shell has it: 2, wrong usage
}

}  // namespace
}  // namespace nearmesh
