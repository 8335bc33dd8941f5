// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/header.hpp"

#include "core/spm/bits.hpp"
#include "core/spm/train.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

class Header : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, Header, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

TEST_P(Header, DecodesToWhatWasEncoded) {
  const SpmHeader header = test::bake_named(GetParam()).header;
  const Result<SpmHeader> decoded = decode_header(encode_header(header));
  ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
  const SpmHeader& found = decoded.value();
  EXPECT_EQ(found.grid, header.grid);
  EXPECT_EQ(found.rounding_error_m, header.rounding_error_m);
  EXPECT_EQ(found.lattice_shift, header.lattice_shift);
  EXPECT_EQ(found.vertex_count, header.vertex_count);
  EXPECT_EQ(found.face_count, header.face_count);
  EXPECT_EQ(found.roots, header.roots);
  EXPECT_EQ(found.base_faces, header.base_faces);
  EXPECT_EQ(found.surface, header.surface);
  ASSERT_EQ(found.tables.contexts().size(), header.tables.contexts().size());
  for (std::size_t i = 0; i < found.tables.contexts().size(); ++i)
    EXPECT_EQ(found.tables.contexts()[i].lengths, header.tables.contexts()[i].lengths) << i;
}

TEST_P(Header, EncodesToTheSameBytesAgain) {
  const auto bytes = encode_header(test::bake_named(GetParam()).header);
  const Result<SpmHeader> decoded = decode_header(bytes);
  ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
  EXPECT_EQ(encode_header(decoded.value()), bytes);
}

TEST(DecodeHeader, RefusesAnotherVersion) {
  auto bytes = encode_header(test::bake_named("sphere").header);
  ASSERT_TRUE(decode_header(bytes).is_ok());
  ASSERT_EQ(bytes[3], '5');  // of the magic number, "NMH5"
  bytes[3] = '4';
  const Result<SpmHeader> refused = decode_header(bytes);
  ASSERT_FALSE(refused.is_ok());
  EXPECT_EQ(refused.status().code(), StatusCode::kCorrupt);
  EXPECT_NE(refused.status().message().find("magic number"), std::string::npos);
}

TEST(DecodeHeader, RefusesTablesThatAreNoPrefixCode) {
  // The tables stand last: of escapes alone, 345 times four bits.
  SpmHeader header = test::bake_named("sphere").header;
  header.tables = make_tables(TrainingCounts(static_cast<std::size_t>(coding_context_count())));
  const auto good = encode_header(header);
  ASSERT_TRUE(decode_header(good).is_ok());
  auto too_long = good, too_many = good;
  too_long[good.size() - 100] = 0xff;  // escapes of 15 bits
  too_many[good.size() - 100] = 0x11;  // an escape of one bit, and no symbol of the rest
  for (const auto& bytes : {too_long, too_many}) {
    const Result<SpmHeader> refused = decode_header(bytes);
    ASSERT_FALSE(refused.is_ok());
    EXPECT_NE(refused.status().message().find("coding table"), std::string::npos);
  }
}

/// What was accepted must be fit for use.
void expect_harmless(const std::vector<std::uint8_t>& bytes) {
  const Result<SpmHeader> header = decode_header(bytes);
  if (!header.is_ok()) {
    EXPECT_TRUE(header.status().code() == StatusCode::kCorrupt ||
                header.status().code() == StatusCode::kUnsupported);
    EXPECT_FALSE(header.status().message().empty());
    return;
  }
  const SplitStore store(header.value());
  const ActiveMesh mesh(store);
  const AbTree tree(mesh);
  EXPECT_EQ(mesh.split_count(), 0U);
  for (const BaseRoot& root : header.value().roots) EXPECT_GE(root.node.size, 1U);
}

TEST(DecodeHeader, SurvivesRandomBytesAfterTheMagic) {
  const auto good = encode_header(test::bake_named("sphere").header);
  Random random(31);
  for (int i = 0; i < 5000; ++i) {
    std::vector<std::uint8_t> bytes(good.begin(), good.begin() + 4 + random.below(120));
    const std::size_t size = random.below(400);
    while (bytes.size() < size) bytes.push_back(static_cast<std::uint8_t>(random.next()));
    expect_harmless(bytes);
  }
}

TEST(DecodeHeader, RefusesEveryTruncation) {
  const auto bytes = encode_header(test::bake_named("sphere").header);
  for (std::size_t n = 0; n < bytes.size(); ++n)
    EXPECT_FALSE(decode_header({bytes.data(), n}).is_ok()) << n << " of " << bytes.size();
}

TEST(DecodeHeader, RefusesAppendedBytes) {
  auto bytes = encode_header(test::bake_named("sphere").header);
  bytes.push_back(0);
  EXPECT_FALSE(decode_header(bytes).is_ok());
}

TEST(DecodeHeader, SurvivesEveryFlippedBit) {
  auto bytes = encode_header(test::bake_named("sphere").header);
  for (std::size_t bit = 0; bit < bytes.size() * 8; ++bit) {
    SCOPED_TRACE(bit);
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    expect_harmless(bytes);
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
  }
}

TEST(DecodeHeader, SurvivesManyFlippedBits) {
  const auto good = encode_header(test::bake_named("terrain").header);
  Random random(32);
  for (int i = 0; i < 3000; ++i) {
    auto bytes = good;
    for (std::uint32_t n = 1 + random.below(4); n > 0; --n)
      bytes[random.below(static_cast<std::uint32_t>(bytes.size()))] ^=
          static_cast<std::uint8_t>(1U << random.below(8));
    expect_harmless(bytes);
  }
}

TEST(DecodeHeader, RefusesCellsThatDoublesCannotReckonWith) {
  SpmHeader header = test::bake_named("one_face").header;
  for (const int exponent : {-kMaxGridExponent - 1, kMaxGridExponent + 1}) {
    header.grid.exponent = exponent;
    const Result<SpmHeader> read = decode_header(encode_header(header));
    ASSERT_FALSE(read.is_ok());
    EXPECT_NE(read.status().message().find("grid exponent"), std::string::npos);
  }
  for (const int exponent : {-kMaxGridExponent, kMaxGridExponent}) {
    header.grid.exponent = exponent;
    EXPECT_TRUE(decode_header(encode_header(header)).is_ok());
  }
}

// The fields before the roots, then `sizes` of roots (kEndlessSize: 64 zero bits where a gamma code
// should be).
constexpr std::uint64_t kEndlessSize = ~std::uint64_t{0};
std::vector<std::uint8_t> header_with_roots(std::uint32_t vertex_count,
                                            const std::vector<std::uint64_t>& sizes,
                                            std::uint64_t open_edges = 0, std::uint64_t parts = 1) {
  BitWriter out;
  out.put(0x4e4d4835, 32);
  for (int i = 0; i < 6; ++i) out.put64(0);
  out.put(4096, 14);
  out.put(21, 6);
  out.put(0, 15);
  out.put(vertex_count, 32);
  out.put(0, 32);
  out.put(sizes.size(), 32);
  out.put(0, 32);
  for (const std::uint64_t size : sizes) {
    if (size == kEndlessSize) {
      out.put64(0);
    } else {
      out.put_gamma(size - 1);
    }
    for (int k = 0; k < 3; ++k) out.put(0, 21);
    for (int k = 0; k < 6; ++k) out.put(0, 7);
  }
  out.put_gamma(open_edges);
  out.put_gamma(0);
  out.put_gamma(parts - 1);
  if (parts <= kMaxComponentSeeds)
    for (std::uint64_t i = 3; i < 3 * parts; ++i) out.put(i, 21);
  for (int i = 0; i < coding_context_count(); ++i) out.put(0, 4);  // the escape alone
  return std::move(out).finish();
}

TEST(DecodeHeader, AcceptsRootsAloneWithoutFaces) {
  const Result<SpmHeader> header = decode_header(header_with_roots(5, {2, 3}));
  ASSERT_TRUE(header.is_ok()) << header.status().message();
  EXPECT_EQ(header.value().roots.size(), 2U);
}

TEST(DecodeHeader, RefusesARootWithoutVertices) {
  EXPECT_FALSE(decode_header(header_with_roots(5, {5, kEndlessSize})).is_ok());
}

TEST(DecodeHeader, RefusesRootsThatDoNotCoverTheVertices) {
  EXPECT_FALSE(decode_header(header_with_roots(6, {2, 3})).is_ok());
}

TEST(DecodeHeader, RefusesRootsBeyondTheVertices) {
  EXPECT_FALSE(decode_header(header_with_roots(4, {2, 3})).is_ok());
}

TEST(DecodeHeader, ReadsTheSeedsOfAllParts) {
  const Result<SpmHeader> header = decode_header(header_with_roots(5, {2, 3}, 0, 3));
  ASSERT_TRUE(header.is_ok()) << header.status().message();
  EXPECT_EQ(header.value().surface.component_seeds,
            (std::vector<GridPoint>{{{0, 0, 0}}, {{3, 4, 5}}, {{6, 7, 8}}}));
  EXPECT_TRUE(header.value().surface.has_seeds());
}

TEST(DecodeHeader, KnowsThatTooManyPartsHaveNoSeeds) {
  const Result<SpmHeader> most = decode_header(header_with_roots(300, {300}, 0, 256));
  ASSERT_TRUE(most.is_ok()) << most.status().message();
  EXPECT_EQ(most.value().surface.component_seeds.size(), 256U);
  const Result<SpmHeader> more = decode_header(header_with_roots(300, {300}, 0, 257));
  ASSERT_TRUE(more.is_ok()) << more.status().message();
  EXPECT_FALSE(more.value().surface.has_seeds());
  EXPECT_TRUE(more.value().surface.component_seeds.empty());
}

TEST(DecodeHeader, RefusesMorePartsThanVertices) {
  EXPECT_TRUE(decode_header(header_with_roots(5, {2, 3}, 0, 5)).is_ok());
  EXPECT_FALSE(decode_header(header_with_roots(5, {2, 3}, 0, 6)).is_ok());
}

TEST(DecodeHeader, RefusesMoreOpenEdgesThanItsFacesHave) {
  const Result<SpmHeader> header = decode_header(header_with_roots(5, {2, 3}, 1));
  ASSERT_FALSE(header.is_ok());
  EXPECT_NE(header.status().message().find("1 open edges of 0 faces"), std::string::npos)
      << header.status().message();
}

TEST(DecodeHeader, RefusesTheVersionBefore) {
  auto bytes = encode_header(test::bake_named("sphere").header);
  bytes[3] = '1';
  EXPECT_FALSE(decode_header(bytes).is_ok());
}

TEST(EncodeHeader, APartMoreTakesEightBytes) {
  SpmHeader header = test::bake_named("sphere").header;
  ASSERT_TRUE(header.surface.is_closed());
  const std::size_t one = encode_header(header).size();
  header.surface.component_count = 9;
  header.surface.component_seeds.resize(9);
  const std::size_t nine = encode_header(header).size();
  EXPECT_LE(nine - one, 8U * 8 + 1);
}

TEST(DecodeHeader, RefusesMoreThanTheGreatestSize) {
  const std::vector<std::uint8_t> bytes(kMaxHeaderBytes + 1);
  const Result<SpmHeader> header = decode_header(bytes);
  ASSERT_FALSE(header.is_ok());
  EXPECT_NE(header.status().message().find("size: at most"), std::string::npos)
      << header.status().message();
}

}  // namespace
}  // namespace nearmesh
