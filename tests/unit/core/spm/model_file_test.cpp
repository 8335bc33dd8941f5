// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/model_file.hpp"

#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "brute_force.hpp"
#include "core/demand/collect.hpp"
#include "core/spm/file_layout.hpp"
#include "reseal.hpp"

namespace nearmesh {
namespace {

using file_layout::DirectoryEntry;
using file_layout::OriginEntry;
using file_layout::Preamble;
using test::TempFile;

/// A file of a few kilobytes with blocks of two levels, as bytes.
BakedModel small_model() { return test::bake_mesh(generate_sphere(14, 0), 8); }
std::vector<std::uint8_t> small_file() { return test::write_model(small_model())->read(); }

/// Everything that a file says of its mesh, for comparing.
struct Content {
  std::vector<std::uint8_t> header;
  std::vector<GridPoint> positions;
  std::vector<test::KeyedFace> faces;
};
Content content_of(const ModelFile& file) {
  Content content;
  content.header.assign(file.header_bytes().begin(), file.header_bytes().end());
  for (std::uint32_t v = 0; v < file.header().vertex_count; ++v)
    content.positions.push_back(file.store().position({v}));
  content.faces = test::all_faces(file.store());
  return content;
}
bool equal(const Content& a, const Content& b) {
  return a.header == b.header && a.positions == b.positions &&
         std::equal(
             a.faces.begin(), a.faces.end(), b.faces.begin(), b.faces.end(),
             [](const auto& x, const auto& y) { return x.key == y.key && x.face == y.face; });
}

class ModelFileOf : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, ModelFileOf, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

TEST_P(ModelFileOf, HoldsTheBakedModel) {
  const BakedModel model = test::bake_named(GetParam());
  const auto path = test::write_model(model);
  Result<ModelFile> file = ModelFile::open(path->path());
  ASSERT_TRUE(file.is_ok()) << file.status().message();
  const Status status = file.value().require_all();
  ASSERT_TRUE(status.is_ok()) << status.message();
  const SplitStore &found = file.value().store(), &baked = model.store;
  EXPECT_EQ(found.known_splits(), baked.known_splits());
  for (std::uint32_t i = 0; i < model.header.vertex_count; ++i) {
    const VertexId v{i};
    EXPECT_EQ(found.position(v), baked.position(v));
    EXPECT_EQ(found.initial_node(v), baked.initial_node(v));
    EXPECT_EQ(found.box_code(found.initial_node(v)), baked.box_code(found.initial_node(v)));
    if (baked.is_root(v)) continue;
    EXPECT_EQ(found.node_of(v), baked.node_of(v));
    const NodeSpan node = found.node_of(v), left{node.first, i - node.begin()};
    EXPECT_EQ(found.box_code(left), baked.box_code(left));
  }
}

// Through the file and back: every input face at its number, with the corner that the input names
// first, first.
TEST_P(ModelFileOf, RestoresTheInputExactly) {
  Result<CleanResult> cleaned = clean_mesh(test::make_mesh(GetParam()));
  ASSERT_TRUE(cleaned.is_ok()) << cleaned.status().message();
  const GridMesh& input = cleaned.value().mesh;
  Result<BakedModel> baked = bake(input, 0, {.base_faces = 16});
  ASSERT_TRUE(baked.is_ok()) << baked.status().message();
  const auto path = test::write_model(baked.value());
  Result<ModelFile> file = ModelFile::open(path->path());
  ASSERT_TRUE(file.is_ok()) << file.status().message();
  const Result<FaceNumbering> numbering = file.value().face_numbering();
  ASSERT_TRUE(numbering.is_ok()) << numbering.status().message();
  ActiveMesh mesh(file.value().store());
  RefineDelta delta;
  for (const VertexId u : test::all_splits(file.value().store())) ASSERT_TRUE(mesh.split(u, delta));

  std::vector<std::uint32_t> place(input.face_ids.back().value + 1, 0xffffffffU);
  for (std::uint32_t i = 0; i < input.faces.size(); ++i) place[input.face_ids[i].value] = i;
  std::vector<bool> seen(input.faces.size());
  const std::vector<ActiveFace> faces = extract_faces(mesh);
  ASSERT_EQ(faces.size(), input.faces.size());
  for (const ActiveFace& face : faces) {
    const FaceNumber number = numbering.value()[face.key];
    ASSERT_LT(number.face.value, place.size());
    const std::uint32_t i = place[number.face.value];
    ASSERT_LT(i, input.faces.size());
    EXPECT_FALSE(seen[i]) << i;
    seen[i] = true;
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(mesh.store().position(face.corners[(number.first_corner + k) % 3]),
                input.positions[input.faces[i][k]]);
  }
}

TEST(ModelFile, KeepsTheHeaderAsItGoesOnTheWire) {
  const BakedModel model = small_model();
  const auto path = test::write_model(model);
  const Result<ModelFile> file = ModelFile::open(path->path());
  ASSERT_TRUE(file.is_ok());
  SpmHeader header = model.header;
  header.blocks_root = file.value().header().blocks_root;
  const auto bytes = encode_header(header);
  EXPECT_TRUE(std::equal(bytes.begin(), bytes.end(), file.value().header_bytes().begin(),
                         file.value().header_bytes().end()));
}

TEST(ModelFile, OpensWithoutDecodingABlock) {
  const auto path = test::write_model(test::bake_named("terrain"));
  const Result<ModelFile> file = ModelFile::open(path->path());
  ASSERT_TRUE(file.is_ok());
  EXPECT_EQ(file.value().store().known_splits(), 0U);
}

TEST(ModelFile, RequireDecodesOneBlock) {
  const auto path = test::write_model(test::bake_named("terrain"));
  Result<ModelFile> file = ModelFile::open(path->path());
  ASSERT_TRUE(file.is_ok());
  for (const BaseRoot& root : file.value().header().roots) {
    if (root.node.size < 2) continue;
    ASSERT_TRUE(file.value().require(root.node).is_ok());
    EXPECT_TRUE(file.value().store().split_of(root.node).is_valid());
    break;
  }
  EXPECT_LT(file.value().store().known_splits(), file.value().header().split_count());
}

TEST(ModelFile, EqualModelsHaveEqualHashes) {
  const auto one = test::write_model(small_model()), two = test::write_model(small_model());
  EXPECT_EQ(ModelFile::open(one->path()).value().content_hash(),
            ModelFile::open(two->path()).value().content_hash());
}

TEST(ModelFile, OtherModelsHaveOtherHashes) {
  const auto one = test::write_model(test::bake_mesh(generate_terrain(8, 1)));
  const auto two = test::write_model(test::bake_mesh(generate_terrain(8, 2)));
  EXPECT_NE(ModelFile::open(one->path()).value().content_hash(),
            ModelFile::open(two->path()).value().content_hash());
}

// ---- what is no model ---------------------------------------------------------------------------

void expect_refused(const std::string& path, StatusCode code) {
  const Result<ModelFile> file = ModelFile::open(path);
  ASSERT_FALSE(file.is_ok());
  EXPECT_EQ(file.status().code(), code) << file.status().message();
  EXPECT_NE(file.status().message().find(path), std::string::npos) << file.status().message();
}

TEST(ModelFile, RefusesAMissingFile) { expect_refused("/nonexistent/model.spm", StatusCode::kIo); }

TEST(ModelFile, RefusesADirectory) { expect_refused("/tmp", StatusCode::kIo); }

TEST(ModelFile, RefusesADevice) { expect_refused("/dev/zero", StatusCode::kIo); }

/// Where nobody writes to it: an open that waits would wait for ever.
TEST(ModelFile, RefusesAFifoAtOnce) {
  const std::string path =
      ::testing::TempDir() + "nearmesh_fifo_" + std::to_string(::getpid()) + ".spm";
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  ::alarm(10);
  expect_refused(path, StatusCode::kIo);
  ::alarm(0);
  ::unlink(path.c_str());
}

TEST(ModelFile, RefusesAnEmptyFile) {
  const TempFile file;
  file.write({});
  expect_refused(file.path(), StatusCode::kCorrupt);
}

TEST(ModelFile, RefusesAnotherKindOfFile) {
  const TempFile file;
  file.write(std::vector<std::uint8_t>(1000, 'x'));
  expect_refused(file.path(), StatusCode::kCorrupt);
}

template <class T>
void patch(std::vector<std::uint8_t>& bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof value);
}

TEST(ModelFile, RefusesAnotherVersionByItsNumber) {
  auto bytes = small_file();
  patch(bytes, offsetof(Preamble, version), std::uint32_t{9});
  test::reseal(bytes);
  const TempFile file;
  file.write(bytes);
  expect_refused(file.path(), StatusCode::kUnsupported);
  EXPECT_NE(ModelFile::open(file.path()).status().message().find("version 9"), std::string::npos);
}

TEST(ModelFile, RefusesEveryTruncation) {
  const auto bytes = small_file();
  const TempFile file;
  for (std::size_t n = 0; n < bytes.size(); ++n) {
    file.write({bytes.data(), n});
    expect_refused(file.path(), StatusCode::kCorrupt);
  }
}

TEST(ModelFile, KeepsItsOriginOutsideItsContent) {
  const BakedModel& model = small_model();
  const MeshOrigin inches{.unit_m = 0.0254,
                          .scale = 3,
                          .unit_source = OriginSource::kFile,
                          .up = UpAxis::kY,
                          .up_source = OriginSource::kOption,
                          .z_up = true};
  const TempFile plain, with_origin;
  const auto written = write_model_file(model.header, model.store, model.numbers, plain.path());
  const auto again =
      write_model_file(model.header, model.store, model.numbers, with_origin.path(), 1, inches);
  ASSERT_TRUE(written.is_ok() && again.is_ok());
  EXPECT_EQ(written.value().content_hash, again.value().content_hash);
  EXPECT_EQ(ModelFile::open(plain.path()).value().origin(), MeshOrigin{});
  EXPECT_EQ(ModelFile::open(with_origin.path()).value().origin(), inches);
}

TEST(ModelFile, RefusesAnOriginThatCannotBe) {
  Preamble preamble;
  const auto good = small_file();
  std::memcpy(&preamble, good.data(), sizeof preamble);
  const std::size_t at = preamble.directory_offset - sizeof(OriginEntry);
  const TempFile file;
  const auto with = [&](std::size_t offset, auto value, bool sealed = true) {
    auto bytes = good;
    patch(bytes, at + offset, value);
    if (sealed) test::reseal(bytes);
    file.write(bytes);
    return file.path();
  };
  EXPECT_TRUE(ModelFile::open(with(offsetof(OriginEntry, unit_m), 0.01)).is_ok());
  expect_refused(with(offsetof(OriginEntry, unit_m), 0.01, false), StatusCode::kCorrupt);
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::infinity()}) {
    expect_refused(with(offsetof(OriginEntry, unit_m), bad), StatusCode::kCorrupt);
    expect_refused(with(offsetof(OriginEntry, scale), bad), StatusCode::kCorrupt);
  }
  for (const std::size_t field : {offsetof(OriginEntry, unit_source), offsetof(OriginEntry, up),
                                  offsetof(OriginEntry, up_source), offsetof(OriginEntry, z_up)})
    expect_refused(with(field, std::uint8_t{4}), StatusCode::kCorrupt);
}

TEST(ModelFile, RefusesAFileThatGrew) {
  auto bytes = small_file();
  const TempFile file;
  for (const std::size_t more : {1, 4, 72, 4096}) {
    auto grown = bytes;
    grown.insert(grown.end(), more, 0);
    file.write(grown);
    expect_refused(file.path(), StatusCode::kCorrupt);
  }
}

TEST(ModelFile, NoticesEveryFlippedBit) {
  const auto good = small_file();
  const TempFile file;
  for (std::size_t i = 0; i < good.size(); ++i)
    for (const unsigned flip : {0x01U, 0x10U, 0x80U, 0xffU}) {
      SCOPED_TRACE("byte " + std::to_string(i) + " of " + std::to_string(good.size()));
      auto bytes = good;
      bytes[i] ^= static_cast<std::uint8_t>(flip);
      file.write(bytes);
      const Result<ModelFile> opened = ModelFile::open(file.path());
      const Status status = opened.is_ok() ? opened.value().verify() : opened.status();
      ASSERT_FALSE(status.is_ok());
      EXPECT_NE(status.message().find(file.path()), std::string::npos) << status.message();
    }
}

TEST(ModelFile, FlippedBitNeverGivesAnotherMesh) {
  const auto good = small_file();
  const TempFile file;
  file.write(good);
  Result<ModelFile> original = ModelFile::open(file.path());
  ASSERT_TRUE(original.value().require_all().is_ok());
  const Content content = content_of(original.value());
  const TempFile flipped;
  for (std::size_t i = 0; i < good.size(); ++i) {
    SCOPED_TRACE("byte " + std::to_string(i) + " of " + std::to_string(good.size()));
    auto bytes = good;
    bytes[i] ^= 0x20;
    flipped.write(bytes);
    Result<ModelFile> opened = ModelFile::open(flipped.path());
    if (!opened.is_ok()) continue;
    const Status status = opened.value().require_all();
    if (status.is_ok()) {
      EXPECT_TRUE(equal(content_of(opened.value()), content));
    } else {
      EXPECT_NE(status.message().find(flipped.path()), std::string::npos) << status.message();
    }
    EXPECT_FALSE(opened.value().face_numbering().is_ok());
  }
}

TEST(ModelFile, SurvivesSealedNonsense) {
  const auto good = small_file();
  Preamble preamble;
  std::memcpy(&preamble, good.data(), sizeof preamble);
  const TempFile file;
  for (std::uint64_t seed = 0; seed < 4000; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    auto bytes = good;
    const std::size_t begin = random.below(3) == 0 ? preamble.directory_offset : 8;
    for (std::uint32_t n = 1 + random.below(3); n > 0; --n) {
      const std::size_t at =
          begin + random.below(static_cast<std::uint32_t>(preamble.face_table_offset - begin));
      bytes[at] ^= static_cast<std::uint8_t>(1U << random.below(8));
    }
    test::reseal(bytes);
    file.write(bytes);
    Result<ModelFile> opened = ModelFile::open(file.path());
    if (!opened.is_ok()) continue;
    ModelFile& model = opened.value();
    RegionRequest request{.region = {GridBox{{0, 0, 0}, {1 << 20, 1 << 21, 1 << 21}}}};
    for (const BaseRoot& root : model.header().roots)
      if (root.node.size > 1) request.attach.push_back(root.node);
    const Result<Demand> demand =
        collect(model.store(), request, [&](NodeSpan node) { return model.require(node); });
    if (demand.is_ok()) {
      EXPECT_TRUE(demand.value().missing.empty());
    }
    const Status all = model.require_all();
    const Result<FaceNumbering> numbers = model.face_numbering();
    if (!all.is_ok()) {
      EXPECT_NE(all.message().find(file.path()), std::string::npos) << all.message();
    }
  }
}

TEST(ModelFile, RefusesAModelThatFitsNoAddressSpace) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers need the address space that this test takes away";
#endif
  SpmHeader header = small_model().header;
  header.roots.back().node.size += kMaxVertices / 2;
  header.vertex_count += kMaxVertices / 2;
  header.face_count = static_cast<std::uint32_t>(header.base_faces.size());
  const std::vector<std::uint8_t> encoded = encode_header(header);
  std::vector<std::uint8_t> bytes(sizeof(Preamble));
  bytes.insert(bytes.end(), encoded.begin(), encoded.end());
  bytes.resize((bytes.size() + 7) / 8 * 8);
  const OriginEntry origin;
  const auto* origin_bytes = reinterpret_cast<const std::uint8_t*>(&origin);
  bytes.insert(bytes.end(), origin_bytes, origin_bytes + sizeof origin);
  Preamble preamble;
  preamble.header_bytes = encoded.size();
  preamble.directory_offset = preamble.face_table_offset = bytes.size();
  bytes.resize(bytes.size() + header.face_count * sizeof(std::uint32_t));
  preamble.file_bytes = bytes.size();
  std::memcpy(bytes.data(), &preamble, sizeof preamble);
  test::reseal(bytes);
  const TempFile file;
  file.write(bytes);
  EXPECT_TRUE(ModelFile::open(file.path()).is_ok());  // where there is room
  const auto open_in_4_gib = [&file] {
    const rlimit limit{std::uint64_t{4} << 30, std::uint64_t{4} << 30};
    static_cast<void>(::setrlimit(RLIMIT_AS, &limit));
    expect_refused(file.path(), StatusCode::kIo);
    std::exit(::testing::Test::HasFailure() ? 1 : 0);
  };
  EXPECT_EXIT(open_in_4_gib(), ::testing::ExitedWithCode(0), "");
}

// ---- a file that changes while it is open -------------------------------------------------------

/// Other content, of another length.
std::vector<std::uint8_t> other_file() {
  return test::write_model(test::bake_mesh(generate_sphere(20, 0), 8))->read();
}

TEST(ModelFile, ReadsOnWhatWasReplacedByRenaming) {
  const TempFile file, other;
  file.write(small_file());
  other.write(other_file());
  Result<ModelFile> untouched = ModelFile::open(test::write_model(small_model())->path());
  Result<ModelFile> opened = ModelFile::open(file.path());
  ASSERT_EQ(std::rename(other.path().c_str(), file.path().c_str()), 0);
  ASSERT_TRUE(opened.value().require_all().is_ok());
  ASSERT_TRUE(untouched.value().require_all().is_ok());
  EXPECT_TRUE(equal(content_of(opened.value()), content_of(untouched.value())));
  EXPECT_NE(ModelFile::open(file.path()).value().content_hash(), opened.value().content_hash());
}

TEST(ModelFile, RefusesWhatWasCutOffAfterItWasOpened) {
  const auto bytes = small_file();
  for (const std::size_t left : {std::size_t{0}, std::size_t{72}, bytes.size() / 3}) {
    const TempFile file;
    file.write(bytes);
    Result<ModelFile> opened = ModelFile::open(file.path());
    ASSERT_TRUE(opened.is_ok());
    const std::vector<std::uint8_t> header(opened.value().header_bytes().begin(),
                                           opened.value().header_bytes().end());
    file.write({bytes.data(), left});
    const Status status = opened.value().require_all();
    EXPECT_EQ(status.code(), StatusCode::kCorrupt);
    EXPECT_NE(status.message().find("changed after it was opened: " + std::to_string(bytes.size())),
              std::string::npos)
        << status.message();
    EXPECT_NE(status.message().find(file.path()), std::string::npos) << status.message();
    EXPECT_FALSE(opened.value().verify().is_ok());
    EXPECT_FALSE(opened.value().face_numbering().is_ok());
    EXPECT_TRUE(std::equal(header.begin(), header.end(), opened.value().header_bytes().begin()));
  }
}

/// However much of another file was written over it: what is read is the mesh that was opened, or
/// nothing.
TEST(ModelFile, NeverMixesWithWhatWasWrittenOverIt) {
  const auto bytes = small_file(), other = other_file();
  const TempFile original;
  original.write(bytes);
  Result<ModelFile> good = ModelFile::open(original.path());
  ASSERT_TRUE(good.value().require_all().is_ok());
  const Content content = content_of(good.value());
  std::size_t refused = 0;
  for (std::size_t over = 0; over < bytes.size(); over += 97) {
    const TempFile file;
    file.write(bytes);
    Result<ModelFile> opened = ModelFile::open(file.path());
    auto mixed = bytes;
    std::copy_n(other.begin(), std::min(over, other.size()), mixed.begin());
    file.write(mixed);
    if (opened.value().require_all().is_ok())
      EXPECT_TRUE(equal(content_of(opened.value()), content)) << over;
    else
      ++refused;
  }
  EXPECT_GT(refused, 10U);
}

TEST(ModelFile, RefusesAFaceTableThatNamesAFourthCorner) {
  auto bytes = small_file();
  Preamble preamble;
  std::memcpy(&preamble, bytes.data(), sizeof preamble);
  bytes[preamble.face_table_offset] |= 3;
  test::reseal(bytes);
  const TempFile file;
  file.write(bytes);
  Result<ModelFile> opened = ModelFile::open(file.path());
  ASSERT_TRUE(opened.is_ok()) << opened.status().message();
  EXPECT_FALSE(opened.value().face_numbering().is_ok());
}

TEST(ModelFile, RequireRefusesWhatIsNoNode) {
  const auto path = test::write_model(small_model());
  Result<ModelFile> file = ModelFile::open(path->path());
  ASSERT_TRUE(file.is_ok());
  EXPECT_FALSE(file.value().require({{0}, 0xfffffffeU}).is_ok());
  EXPECT_FALSE(file.value().require({{5}, 0xfffffffeU}).is_ok());
  EXPECT_FALSE(file.value().require({{file.value().header().vertex_count}, 2}).is_ok());
}

// Each entry could name the same long block: to read them all would take as long as so many files.
TEST(ModelFile, RefusesBlocksThatDoNotStandOneAfterTheOther) {
  const auto good = small_file();
  Preamble preamble;
  std::memcpy(&preamble, good.data(), sizeof preamble);
  std::vector<DirectoryEntry> entries(preamble.block_count);
  std::memcpy(entries.data(), good.data() + preamble.directory_offset,
              entries.size() * sizeof(DirectoryEntry));
  ASSERT_GE(entries.size(), 3U);
  ASSERT_EQ(entries.front().offset, sizeof(Preamble) + preamble.header_bytes);
  const TempFile file;
  const auto with = [&](const std::vector<DirectoryEntry>& changed) {
    auto bytes = good;
    std::memcpy(bytes.data() + preamble.directory_offset, changed.data(),
                changed.size() * sizeof(DirectoryEntry));
    test::reseal(bytes);
    file.write(bytes);
    return file.path();
  };
  EXPECT_TRUE(ModelFile::open(with(entries)).is_ok());
  const auto refused = [&](const std::vector<DirectoryEntry>& changed, std::size_t entry) {
    const std::string path = with(changed);
    expect_refused(path, StatusCode::kCorrupt);
    const std::string message = ModelFile::open(path).status().message();
    EXPECT_NE(message.find("directory entry " + std::to_string(entry) + ": expected its block at"),
              std::string::npos)
        << message;
  };
  auto changed = entries;  // all name one block
  for (DirectoryEntry& entry : changed) {
    entry.offset = entries[0].offset;
    entry.bytes = entries[0].bytes;
  }
  refused(changed, 1);
  changed = entries;  // two blocks share bytes
  --changed[2].offset;
  ++changed[2].bytes;
  refused(changed, 2);
  changed = entries;  // bytes before the first
  ++changed[0].offset;
  --changed[0].bytes;
  refused(changed, 0);
  changed = entries;  // bytes between two blocks
  --changed[0].bytes;
  refused(changed, 1);
}

TEST(ModelFile, RequireRefusesABlockThatHoldsOtherNodes) {
  auto bytes = small_file();
  Preamble preamble;
  std::memcpy(&preamble, bytes.data(), sizeof preamble);
  std::vector<DirectoryEntry> entries(preamble.block_count);
  std::memcpy(entries.data(), bytes.data() + preamble.directory_offset,
              entries.size() * sizeof(DirectoryEntry));
  ASSERT_GE(entries.size(), 2U);
  ASSERT_LE(entries[1].size, kSlotSize);
  const auto first = bytes.begin() + static_cast<std::ptrdiff_t>(entries[0].offset);
  std::rotate(first, first + static_cast<std::ptrdiff_t>(entries[0].bytes),
              first + static_cast<std::ptrdiff_t>(entries[0].bytes + entries[1].bytes));
  std::swap(entries[0].bytes, entries[1].bytes);
  entries[1].offset = entries[0].offset + entries[0].bytes;
  std::memcpy(bytes.data() + preamble.directory_offset, entries.data(),
              entries.size() * sizeof(DirectoryEntry));
  test::reseal(bytes);
  const TempFile path;
  path.write(bytes);
  Result<ModelFile> file = ModelFile::open(path.path());
  ASSERT_TRUE(file.is_ok()) << file.status().message();
  for (const DirectoryEntry& entry : entries)  // all that the two may hang on
    if (entry.size > kSlotSize) {
      ASSERT_TRUE(file.value().require({{entry.first}, entry.size}).is_ok());
    }
  const Status refused = file.value().require({{entries[0].first}, entries[0].size});
  EXPECT_EQ(refused.code(), StatusCode::kCorrupt);
  EXPECT_NE(refused.message().find("does not hold node"), std::string::npos) << refused.message();
  EXPECT_FALSE(file.value().require_all().is_ok());
}

// ---- writing ------------------------------------------------------------------------------------

TEST(WriteModelFile, RefusesAFolderThatIsNotThere) {
  const BakedModel model = small_model();
  const auto written =
      write_model_file(model.header, model.store, model.numbers, "/nonexistent/model.spm");
  ASSERT_FALSE(written.is_ok());
  EXPECT_EQ(written.status().code(), StatusCode::kIo);
  EXPECT_NE(written.status().message().find("/nonexistent/model.spm"), std::string::npos);
}

TEST(WriteModelFile, ReportsWhatItWrote) {
  const BakedModel model = small_model();
  const TempFile path;
  const auto written = write_model_file(model.header, model.store, model.numbers, path.path());
  ASSERT_TRUE(written.is_ok());
  const Result<ModelFile> file = ModelFile::open(path.path());
  ASSERT_TRUE(file.is_ok());
  EXPECT_EQ(written.value().file_bytes, path.read().size());
  EXPECT_EQ(written.value().content_hash, file.value().content_hash());
  EXPECT_EQ(written.value().blocks, file.value().block_count());
  EXPECT_EQ(written.value().header_bytes, file.value().header_bytes().size());
}

TEST(WriteModelFile, ReplacesModelsAndNothingElse) {
  const BakedModel model = small_model();
  const auto path = test::write_model(model);
  const auto write = [&] {
    return write_model_file(model.header, model.store, model.numbers, path->path()).status().code();
  };
  EXPECT_EQ(write(), StatusCode::kOk);
  constexpr std::array<std::uint8_t, 5> kNotes{'n', 'o', 't', 'e', 's'};
  path->write(kNotes);
  EXPECT_EQ(write(), StatusCode::kConflict);
  EXPECT_TRUE(std::ranges::equal(path->read(), kNotes));
}

}  // namespace
}  // namespace nearmesh
