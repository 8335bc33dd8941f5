// SPDX-License-Identifier: Apache-2.0
// What `export` writes: read back by readers that know nothing of ours, and held against the
// recording and the full meshes.
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "golden.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh/core/refine/detail/active_mesh.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "subscriber/recorded/recorded_scene.hpp"
#include "subscriber/report/mesh_colours.hpp"
#include "subscriber/report/mesh_files.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using namespace test;
using nlohmann::json;
using subscriber::RecordedBody;
using subscriber::RecordedScene;
using Vector = std::array<double, 3>;

/// What the tetrahedra around a segment of contact add.
constexpr std::size_t kSplintVertices = 4, kSplintFaces = 4;

/// The report with most contacts, whose scene has everything that there is to write.
class Export : public ::testing::Test {
 protected:
  Export() {
    std::uint32_t most = 0;
    const Status status = recording_->read(
        1, recording_->message_count() + 1, [&](std::int64_t id, const RecordedMessage& message) {
          const auto& writer = recording_->writers()[message.writer];
          if (recording_->topics()[writer.topic].type !=
              "nearmesh::wire_types::ContactReportSample")
            return true;
          const auto report = wire::decode_payload<wire::ContactReport>(message.cdr).value();
          if (report.pair_count <= most || report.body_a != "ground") return true;
          most = report.pair_count;
          scene_id_ = id;
          return true;
        });
    EXPECT_TRUE(status.is_ok());
    const auto scenes = subscriber::rebuild_scenes(*recording_, {scene_id_}).value();
    EXPECT_TRUE(scenes[0].is_ok()) << scenes[0].status().message();
    scene_ = scenes[0].value();
  }
  std::vector<std::string> words(const std::string& out, bool looks_at_b) {
    const std::string &a = scene_.report.body_a, &b = scene_.report.body_b;
    char time[32];
    std::snprintf(time, sizeof time, "%.9f",
                  static_cast<double>(scene_.received_ns - recording_->begin_ns()) * 1e-9);
    char peer[32];
    std::snprintf(peer, sizeof peer, "%016llx",
                  static_cast<unsigned long long>(scene_.report.peer));
    return {"export", session_,         "--time",           time,      "--peer",
            peer,     "--body",         looks_at_b ? b : a, "--other", looks_at_b ? a : b,
            "-o",     folder_.file(out)};
  }
  std::string exported(const std::string& out, bool looks_at_b = false) {
    std::string text, err;
    EXPECT_EQ(run(folder_, "nearmesh-subscriber", words(out, looks_at_b), &text, &err), 0) << err;
    EXPECT_NE(text.find(folder_.file(out)), std::string::npos) << text;
    return read_text(folder_.file(out));
  }

  const Folder folder_;
  const std::string session_ = golden_session(folder_);
  const std::unique_ptr<RecordingReader> recording_ = RecordingReader::open(session_).value();
  std::int64_t scene_id_ = 0;
  RecordedScene scene_;
};

std::size_t total(const RecordedScene& scene, bool faces) {
  std::size_t sum = 0;
  for (const RecordedBody& body : scene.bodies)
    sum += faces ? body.faces.size() : body.positions_world_m.size();
  return sum;
}

// The scene itself: its exact faces are faces of the full mesh, and nothing else is called exact.
TEST_F(Export, ExactFacesAreThoseOfTheFullMesh) {
  const BakedModel ground = bake_mesh(generate_terrain(96, 7), 64);
  const ActiveMesh full = [&] {
    ActiveMesh mesh(ground.store);
    RefineDelta delta;
    for (const VertexId u : global_order(ground.store, 0xffffffffU))
      EXPECT_TRUE(mesh.split(u, delta));
    return mesh;
  }();
  // Which corner comes first follows from the forest, and the recorded model's may be another.
  const auto from_least = [](std::array<Vector, 3> at) {
    std::rotate(at.begin(), std::min_element(at.begin(), at.end()), at.end());
    return at;
  };
  std::set<std::array<Vector, 3>> original;
  for (const ActiveFace& face : extract_faces(full)) {
    std::array<Vector, 3> at;
    for (std::size_t k = 0; k < 3; ++k)
      at[k] = position_m(ground.header, ground.store, face.corners[k]);
    original.insert(from_least(at));
  }
  const RecordedBody& body = scene_.bodies[0];  // the ground, which lies where its model says
  std::size_t exact = 0, coarse = 0;
  for (const auto& face : body.faces) {
    std::array<Vector, 3> at;
    bool is_exact = true;
    for (std::size_t k = 0; k < 3; ++k) {
      at[k] = body.positions_world_m[face[k]];
      is_exact = is_exact && body.eps_m[face[k]] == 0;
    }
    EXPECT_TRUE(!is_exact || original.contains(from_least(at)));
    ++(is_exact ? exact : coarse);
  }
  EXPECT_GT(exact, 20U);
  EXPECT_GT(coarse, 50U);
  for (const double eps_m : body.eps_m) EXPECT_TRUE(eps_m >= 0 && eps_m <= 2 * body.size_m);
}

TEST_F(Export, ContactsLieOnBothBodies) {
  ASSERT_GT(scene_.contacts.segments.size(), 3U);
  EXPECT_EQ(scene_.contacts.pair_total, scene_.report.pair_count);
  // Within the box of the smaller body, whose pose it must be for that.
  Vector lo = scene_.bodies[1].positions_world_m[0], hi = lo;
  for (const Vector& at : scene_.bodies[1].positions_world_m)
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], at[k]);
      hi[k] = std::max(hi[k], at[k]);
    }
  for (const ContactSegment& segment : scene_.contacts.segments)
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_GE(segment.p_m[k], lo[k] - 0.01);
      EXPECT_LE(segment.q_m[k], hi[k] + 0.01);
    }
}

TEST_F(Export, PlyIsReadByOthers) {
  const std::string bytes = exported("out.ply");
  EXPECT_TRUE(bytes == subscriber::report::to_ply(scene_, 0));
  // Its size is what its header says.
  const std::size_t header = bytes.find("end_header\n") + 11;
  const std::size_t segments = scene_.contacts.segments.size();
  const std::size_t faces = total(scene_, true) + kSplintFaces * segments;
  const std::size_t ends = total(scene_, false) + kSplintVertices * segments;
  EXPECT_EQ(bytes.size(), header + (ends + 2 * segments) * 31 + faces * 13 + segments * 11);
  const auto own = import_mesh(folder_.file("out.ply"));
  ASSERT_TRUE(own.is_ok()) << own.status().message();
  EXPECT_EQ(own.value().faces.size(), faces);
  ASSERT_EQ(own.value().positions_m.size(), ends + 2 * segments);
  EXPECT_EQ(own.value().positions_m[5], scene_.bodies[0].positions_world_m[5]);
  EXPECT_EQ(own.value().positions_m[ends], scene_.contacts.segments[0].p_m);

  Assimp::Importer importer;
  const aiScene* read = importer.ReadFile(folder_.file("out.ply"), 0);
  ASSERT_NE(read, nullptr) << importer.GetErrorString();
  ASSERT_EQ(read->mNumMeshes, 1U);
  const aiMesh& mesh = *read->mMeshes[0];
  EXPECT_EQ(mesh.mNumFaces, faces);
  ASSERT_TRUE(mesh.HasVertexColors(0));
  const aiColor4D& splint = mesh.mColors[0][total(scene_, false)];
  EXPECT_EQ(std::tuple(splint.r, splint.g, splint.b), std::tuple(1.0F, 0.0F, 1.0F));
  for (unsigned i = 0; i < scene_.bodies[0].eps_m.size(); ++i) {
    const auto colour = subscriber::report::vertex_colour(scene_.bodies[0].eps_m[i],
                                                          scene_.bodies[0].size_m, false);
    EXPECT_NEAR(mesh.mColors[0][i].r * 255, colour[0], 0.5);
    EXPECT_NEAR(mesh.mColors[0][i].b * 255, colour[2], 0.5);
  }
}

// Around each segment, whatever its direction and however short: closed, outward, and a little
// thicker than nothing.
TEST_F(Export, SegmentsAreSeenAsSlenderSolids) {
  ContactSegment point, up;
  point.p_m = point.q_m = {1, 2, 3};
  up.p_m = {1, 2, 3};
  up.q_m = {1, 2, 8};
  RecordedScene scene = scene_;
  for (const std::vector<ContactSegment>& segments :
       {std::vector{point}, std::vector{up}, scene_.contacts.segments}) {
    scene.contacts.segments = segments;
    folder_.write("solids.ply", subscriber::report::to_ply(scene, 0));
    const auto mesh = import_mesh(folder_.file("solids.ply")).value();
    Vector lo = segments[0].p_m, hi = lo;
    for (const ContactSegment& segment : segments)
      for (std::size_t k = 0; k < 3; ++k)
        for (const double at : {segment.p_m[k], segment.q_m[k]}) {
          lo[k] = std::min(lo[k], at);
          hi[k] = std::max(hi[k], at);
        }
    double extent = std::max({hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]});
    if (extent == 0) extent = std::min(scene.bodies[0].size_m, scene.bodies[1].size_m);
    for (std::size_t i = 0; i < segments.size(); ++i) {
      double volume = 0;
      std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
      for (std::size_t f = 0; f < kSplintFaces; ++f) {
        const auto& face = mesh.faces[total(scene, true) + kSplintFaces * i + f];
        const Vector &a = mesh.positions_m[face[0]], &b = mesh.positions_m[face[1]],
                     &c = mesh.positions_m[face[2]], &o = segments[i].p_m;
        const auto d = [&](const Vector& at, std::size_t k) { return at[k % 3] - o[k % 3]; };
        for (std::size_t k = 0; k < 3; ++k) {
          volume += d(a, k) * (d(b, k + 1) * d(c, k + 2) - d(b, k + 2) * d(c, k + 1)) / 6;
          edges.emplace(face[k], face[(k + 1) % 3]);
          const double at = mesh.positions_m[face[k]][2];
          EXPECT_GE(at, std::min(o[2], segments[i].q_m[2]) - extent / 100);
          EXPECT_LE(at, std::max(o[2], segments[i].q_m[2]) + extent / 100);
        }
      }
      EXPECT_GT(volume, 0);
      EXPECT_EQ(edges.size(), 12U);
      for (const auto& [from, to] : edges) EXPECT_TRUE(edges.contains({to, from}));
    }
  }
}

/// Face by face, in the order of the file.
std::vector<Vector> corners_of(const IndexedMesh& mesh) {
  std::vector<Vector> corners;
  for (const auto& face : mesh.faces)
    for (const std::uint32_t v : face) corners.push_back(mesh.positions_m[v]);
  return corners;
}

TEST_F(Export, GlbHoldsTogether) {
  const std::string bytes = exported("out.glb");
  EXPECT_TRUE(bytes == subscriber::report::to_glb(scene_, 0).value());
  const auto word = [&](std::size_t at) {
    std::uint32_t value = 0;
    std::memcpy(&value, bytes.data() + at, 4);
    return value;
  };
  ASSERT_GT(bytes.size(), 28U);
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(word(4), 2U);
  EXPECT_EQ(word(8), bytes.size());
  const std::uint32_t text_size = word(12);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  EXPECT_EQ(text_size % 4, 0U);
  const std::size_t second = 20 + text_size;
  const std::uint32_t binary_size = word(second);
  EXPECT_EQ(bytes.substr(second + 4, 4), std::string("BIN\0", 4));
  EXPECT_EQ(second + 8 + binary_size, bytes.size());
  EXPECT_EQ(binary_size % 4, 0U);
  const json gltf = json::parse(bytes.substr(20, text_size));
  EXPECT_EQ(gltf["asset"]["version"], "2.0");
  EXPECT_EQ(gltf["buffers"][0]["byteLength"], binary_size);
  std::size_t end = 0;
  for (const json& view : gltf["bufferViews"]) {
    EXPECT_EQ(view["byteOffset"], end);
    end += view["byteLength"].get<std::size_t>();
  }
  EXPECT_EQ(end, binary_size);
  ASSERT_EQ(gltf["meshes"].size(), 3U);
  const char* data = bytes.data() + second + 8;
  for (std::size_t m = 0; m < 3; ++m) {
    const json& primitive = gltf["meshes"][m]["primitives"][0];
    const json& at = gltf["accessors"][primitive["attributes"]["POSITION"].get<std::size_t>()];
    const json& view = gltf["bufferViews"][at["bufferView"].get<std::size_t>()];
    const auto count = at["count"].get<std::size_t>();
    ASSERT_EQ(view["byteLength"], count * 12);
    std::array<float, 3> lo{}, hi{};
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        float x = 0;
        std::memcpy(&x, data + view["byteOffset"].get<std::size_t>() + 12 * i + 4 * k, 4);
        lo[k] = i == 0 ? x : std::min(lo[k], x);
        hi[k] = i == 0 ? x : std::max(hi[k], x);
      }
    EXPECT_EQ((at["min"].get<std::array<float, 3>>()), lo);
    EXPECT_EQ((at["max"].get<std::array<float, 3>>()), hi);
    EXPECT_EQ(primitive["mode"], m < 2 ? 4 : 1);
    if (m == 2) {
      EXPECT_EQ(count, 2 * scene_.contacts.segments.size());
      EXPECT_EQ(gltf["meshes"][m]["primitives"].size(), 2U);
      continue;
    }
    const json& eps = gltf["accessors"][primitive["attributes"]["_EPS_M"].get<std::size_t>()];
    ASSERT_EQ(eps["count"], count);
    const auto eps_from =
        gltf["bufferViews"][eps["bufferView"].get<std::size_t>()]["byteOffset"].get<std::size_t>();
    for (std::size_t i = 0; i < count; ++i) {
      float eps_m = -1;
      std::memcpy(&eps_m, data + eps_from + 4 * i, 4);
      ASSERT_EQ(eps_m, static_cast<float>(scene_.bodies[m].eps_m[i]));
    }
    const json& indices = gltf["accessors"][primitive["indices"].get<std::size_t>()];
    const auto from = gltf["bufferViews"][indices["bufferView"].get<std::size_t>()]["byteOffset"]
                          .get<std::size_t>();
    EXPECT_EQ(indices["count"], 3 * scene_.bodies[m].faces.size());
    for (std::size_t i = 0; i < indices["count"]; ++i) {
      std::uint32_t index = 0;
      std::memcpy(&index, data + from + 4 * i, 4);
      ASSERT_LT(index, count);
    }
  }
}

// With the nodes' transforms applied a reader finds the world, its z axis along glTF's y.
TEST_F(Export, GlbIsReadByOthers) {
  exported("out.glb", true);
  Assimp::Importer importer;
  const aiScene* read = importer.ReadFile(folder_.file("out.glb"), aiProcess_PreTransformVertices);
  ASSERT_NE(read, nullptr) << importer.GetErrorString();
  std::size_t triangles = 0, lines = 0;
  aiVector3D lo(1e9F), hi(-1e9F);
  for (unsigned m = 0; m < read->mNumMeshes; ++m) {
    const aiMesh& mesh = *read->mMeshes[m];
    for (unsigned i = 0; i < mesh.mNumFaces; ++i)
      ++(mesh.mFaces[i].mNumIndices == 2 ? lines : triangles);
    EXPECT_TRUE(mesh.HasVertexColors(0));
    for (unsigned i = 0; i < mesh.mNumVertices; ++i)
      for (unsigned k = 0; k < 3; ++k) {
        lo[k] = std::min(lo[k], mesh.mVertices[i][k]);
        hi[k] = std::max(hi[k], mesh.mVertices[i][k]);
      }
  }
  EXPECT_EQ(triangles, total(scene_, true) + kSplintFaces * scene_.contacts.segments.size());
  EXPECT_EQ(lines, scene_.contacts.segments.size());
  Vector least{1e9, 1e9, 1e9}, most{-1e9, -1e9, -1e9};
  for (const RecordedBody& body : scene_.bodies)
    for (const Vector& at : body.positions_world_m)
      for (std::size_t k = 0; k < 3; ++k) {
        least[k] = std::min(least[k], at[k]);
        most[k] = std::max(most[k], at[k]);
      }
  EXPECT_NEAR(lo.x, least[0], 0.01);
  EXPECT_NEAR(hi.x, most[0], 0.01);
  EXPECT_NEAR(lo.y, least[2], 0.01);
  EXPECT_NEAR(hi.y, most[2], 0.01);
  EXPECT_NEAR(lo.z, -most[1], 0.01);
  EXPECT_NEAR(hi.z, -least[1], 0.01);
}

// Built again, both show the same world, in metres and z up, without any flag: glTF demands a turn,
// and import undoes it.
TEST_F(Export, IsImportedAsItWasWhateverTheFormat) {
  exported("out.ply");
  exported("out.glb");
  const auto ply = import_mesh(folder_.file("out.ply"), ImportOptions{});
  const auto glb = import_mesh(folder_.file("out.glb"), ImportOptions{});
  ASSERT_TRUE(ply.is_ok() && glb.is_ok()) << ply.status().message() << glb.status().message();
  EXPECT_EQ(glb.value().origin.up, UpAxis::kZ);
  EXPECT_EQ(glb.value().origin.up_source, OriginSource::kFile);
  EXPECT_FALSE(glb.value().origin.z_up);
  EXPECT_EQ(glb.value().origin.unit_m, 1);
  const std::vector<Vector> expected = corners_of(ply.value().mesh),
                            found = corners_of(glb.value().mesh);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) ASSERT_NEAR(found[i][k], expected[i][k], 1e-3);
}

/// What a command says, both ways.
std::string said_by(const std::string& command) {
  std::string said;
  std::FILE* pipe = ::popen((command + " 2>&1 </dev/null").c_str(), "r");
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) said += static_cast<char>(c);
  ::pclose(pipe);
  return said;
}
bool is_there(const char* program) {
  return std::system(("command -v " + std::string(program) + " >/dev/null").c_str()) == 0;
}

TEST_F(Export, BlenderOpensBoth) {
  if (!is_there("blender")) GTEST_SKIP() << "blender is not installed";
  exported("out.ply");
  exported("out.glb");
  folder_.write("open.py", R"(
import bpy
def look():
    meshes = bpy.data.meshes
    print('found', sum(len(m.polygons) for m in meshes), sum(len(m.color_attributes) for m in meshes))
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_mesh.ply(filepath=')" +
                               folder_.file("out.ply") +
                               R"(')
look()
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=')" +
                               folder_.file("out.glb") +
                               R"(', import_shading='FLAT')
look()
)");
  const std::string said = said_by("blender -b --python '" + folder_.file("open.py") + "'");
  const std::string faces =
      std::to_string(total(scene_, true) + kSplintFaces * scene_.contacts.segments.size());
  EXPECT_NE(said.find("found " + faces + " 1\n"), std::string::npos) << said;
  EXPECT_NE(said.find("found " + faces + " 3\n"), std::string::npos) << said;
}

TEST_F(Export, ParaViewOpensBoth) {
  if (!is_there("pvpython")) GTEST_SKIP() << "pvpython (paraview) is not installed";
  exported("out.ply");
  exported("out.glb");
  folder_.write("open.py", R"(
from paraview.simple import *
from paraview import servermanager
def look(data):
    if hasattr(data, 'GetNumberOfBlocks'):
        return [x for i in range(data.GetNumberOfBlocks()) for x in look(data.GetBlock(i))]
    arrays = data.GetPointData()
    return [(data.GetNumberOfPolys(), data.GetNumberOfLines(),
             [arrays.GetArrayName(i) for i in range(arrays.GetNumberOfArrays())])]
for reader in [PLYReader(FileNames=[')" +
                               folder_.file("out.ply") + R"(']), glTFReader(FileName=')" +
                               folder_.file("out.glb") + R"(')]:
    reader.UpdatePipeline()
    parts = look(servermanager.Fetch(reader))
    print('found', sum(p[0] for p in parts), sum(p[1] for p in parts), parts[0][2])
)");
  const std::string said = said_by("pvpython '" + folder_.file("open.py") + "'");
  const std::size_t segments = scene_.contacts.segments.size();
  const std::string faces = std::to_string(total(scene_, true) + kSplintFaces * segments);
  EXPECT_NE(said.find("found " + faces + " 0 ['RGB']"), std::string::npos) << said;
  EXPECT_NE(said.find("found " + faces + " " + std::to_string(segments) + " ['COLOR_0', '_EPS_M']"),
            std::string::npos)
      << said;
}

TEST_F(Export, SaysWhatItCannotFind) {
  const auto refused = [&](std::size_t word, const std::string& value, int code,
                           const std::string& expected) {
    auto all = words("out.ply", false);
    all[word] = value;
    std::string err;
    EXPECT_EQ(run(folder_, "nearmesh-subscriber", all, nullptr, &err), code) << value;
    EXPECT_NE(err.find(expected), std::string::npos) << err;
    EXPECT_FALSE(std::filesystem::exists(folder_.file("out.ply")));
  };
  refused(5, "77", 1, "00000000000000b1");       // lists the peers
  refused(5, "00", 1, "fits more than one of");  // both begin so
  refused(7, "nobody", 1, "about body nobody");
  refused(9, "nobody", 1, "against nobody");
  refused(3, "-1", 2, "--time");
  refused(11, folder_.file("out.obj"), 2, ".glb");
  refused(11, folder_.file("none/out.ply"), 1, "cannot create");
}

TEST(EpsColours, RunFromYellowToRed) {
  using subscriber::report::eps_colour;
  using subscriber::report::kEpsColours;
  EXPECT_EQ(eps_colour(1.0 / 8192, 1), kEpsColours.front());
  EXPECT_EQ(eps_colour(1e-9, 1), kEpsColours.front());
  EXPECT_EQ(eps_colour(0.125, 1), kEpsColours.back());
  EXPECT_EQ(eps_colour(100, 1), kEpsColours.back());
  EXPECT_EQ(eps_colour(1.0 / 256, 1), kEpsColours[2]);  // half-way, by the logarithm
  EXPECT_EQ(eps_colour(7.0 / 256, 7), kEpsColours[2]);
}

}  // namespace
}  // namespace nearmesh
