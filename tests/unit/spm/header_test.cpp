// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/header.hpp"

#include "../../../core/src/spm/bits.hpp"
#include "nearmesh/core/spm/train.hpp"
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
  ASSERT_EQ(found.tables.contexts.size(), header.tables.contexts.size());
  for (std::size_t i = 0; i < found.tables.contexts.size(); ++i)
    EXPECT_EQ(found.tables.contexts[i].lengths, header.tables.contexts[i].lengths) << i;
}

TEST_P(Header, EncodesToTheSameBytesAgain) {
  const auto bytes = encode_header(test::bake_named(GetParam()).header);
  const Result<SpmHeader> decoded = decode_header(bytes);
  ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
  EXPECT_EQ(encode_header(decoded.value()), bytes);
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

// The fields before the roots, then `sizes` of roots (kEndless: 64 zero bits where a gamma code
// should be).
constexpr std::uint64_t kEndless = ~std::uint64_t{0};
std::vector<std::uint8_t> header_with_roots(std::uint32_t vertex_count,
                                            const std::vector<std::uint64_t>& sizes) {
  BitWriter out;
  out.put(0x4e4d4831, 32);
  for (int i = 0; i < 4; ++i) out.put64(0);
  out.put(4096, 14);
  out.put(21, 6);
  out.put(0, 15);
  out.put(vertex_count, 32);
  out.put(0, 32);
  out.put(sizes.size(), 32);
  out.put(0, 32);
  for (const std::uint64_t size : sizes) {
    if (size == kEndless) {
      out.put64(0);
    } else {
      out.put_gamma(size - 1);
    }
    for (int k = 0; k < 3; ++k) out.put(0, 21);
    for (int k = 0; k < 6; ++k) out.put(0, 7);
  }
  for (int i = 0; i < coding_context_count(); ++i) {
    out.put_gamma(0);
    out.put(0, 4);
  }
  return std::move(out).finish();
}

TEST(DecodeHeader, AcceptsRootsAloneWithoutFaces) {
  const Result<SpmHeader> header = decode_header(header_with_roots(5, {2, 3}));
  ASSERT_TRUE(header.is_ok()) << header.status().message();
  EXPECT_EQ(header.value().roots.size(), 2U);
}

TEST(DecodeHeader, RefusesARootWithoutVertices) {
  EXPECT_FALSE(decode_header(header_with_roots(5, {5, kEndless})).is_ok());
}

TEST(DecodeHeader, RefusesRootsThatDoNotCoverTheVertices) {
  EXPECT_FALSE(decode_header(header_with_roots(6, {2, 3})).is_ok());
}

TEST(DecodeHeader, RefusesRootsBeyondTheVertices) {
  EXPECT_FALSE(decode_header(header_with_roots(4, {2, 3})).is_ok());
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
