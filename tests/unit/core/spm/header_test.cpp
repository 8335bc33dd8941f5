// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/header.hpp"

#include <bit>
#include <cmath>
#include <limits>

#include "core/bake/count_typical.hpp"
#include "core/spm/bits.hpp"
#include "core/spm/coding_sets.hpp"
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

TEST(RoundingBound, IsNoLessThanWhatAnyVertexWasMoved) {
  Random random(41);
  for (int i = 0; i < 400; ++i) {
    IndexedMesh mesh{{{0, 0, 0}, {1, 0, 0}, {0, 1, 1}}, {{0, 1, 2}, {0, 1, 3}}};
    mesh.positions_m.push_back({random.unit(), random.unit(), random.unit()});
    const CleanResult clean = clean_mesh(mesh).value();
    const GridPoint& p = clean.mesh.positions[3];
    long double square = 0;  // eleven bits more than what is held against it
    for (std::size_t k = 0; k < 3; ++k) {
      const double placed =
          clean.mesh.grid.origin_m[k] + std::ldexp(p.v[k], clean.mesh.grid.exponent);
      const long double off = static_cast<long double>(mesh.positions_m[3][k]) - placed;
      square += off * off;
    }
    const SpmHeader header{.rounding_error_m = clean.report.rounding_error_m};
    const long double bound = header.rounding_bound_m();
    EXPECT_GE(bound * bound, square);
    EXPECT_LE(bound, std::sqrt(square) * (1 + 0x1p-48L));
  }
}

TEST(EncodeHeader, WithTablesOfItsOwnDecodesToThem) {
  const BakedModel model = test::bake_named("aircraft");
  SpmHeader header = model.header;
  header.tables = make_tables(count_typical(header, model.store));
  ASSERT_EQ(header.tables.set(), CodingSet{});
  const Result<SpmHeader> decoded = decode_header(encode_header(header));
  ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
  EXPECT_EQ(decoded.value().tables.set(), CodingSet{});
  ASSERT_EQ(decoded.value().tables.contexts().size(), header.tables.contexts().size());
  for (std::size_t i = 0; i < header.tables.contexts().size(); ++i)
    EXPECT_EQ(decoded.value().tables.contexts()[i].lengths, header.tables.contexts()[i].lengths)
        << i;
}

TEST(EncodeHeader, KeepsThePlaceOnACommonLattice) {
  SpmHeader header = test::bake_named("sphere").header;
  const std::size_t alone = encode_header(header).size();
  const Grid own = header.grid;
  for (const std::array<std::int64_t, 3>& cells : {std::array<std::int64_t, 3>{1, -1, 0},
                                                   {kMaxLatticeCells, 0, 5},
                                                   {0, 0, -kMaxLatticeCells}}) {
    header.grid = own;
    header.grid.lattice_cells = cells;
    const auto bytes = encode_header(header);
    EXPECT_LE(bytes.size(), alone + 16);
    const Result<SpmHeader> decoded = decode_header(bytes);
    ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
    EXPECT_EQ(decoded.value().grid, header.grid);
  }
}

TEST(EncodeHeader, ThatNamesASetCarriesNoTables) {
  SpmHeader header = test::bake_named("sphere").header;
  ASSERT_NE(header.tables.set(), CodingSet{});
  const std::size_t named = encode_header(header).size();
  EXPECT_LT(named, 400U);
  const auto contexts = header.tables.contexts();
  header.tables = CodingTables({contexts.begin(), contexts.end()});
  EXPECT_GT(encode_header(header).size(), named + 1000);
}

TEST(EncodeHeader, KeepsOriginsThatAreNoWholeCells) {
  SpmHeader header = test::bake_named("one_face").header;
  header.grid.exponent = -3;
  for (const double origin_m : {0.0, -0.0, 0.125, -0.125, 0.0625, 12345.0, -12345.0, 0x1p49,
                                0x1p50 - 0.125, 0x1p50, -0x1p1000, 0x1p-1074, 1.0 / 3}) {
    header.grid.origin_m = {origin_m, -1, 7};
    const Result<SpmHeader> decoded = decode_header(encode_header(header));
    ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(std::bit_cast<std::uint64_t>(decoded.value().grid.origin_m[k]),
                std::bit_cast<std::uint64_t>(header.grid.origin_m[k]))
          << origin_m;
  }
}

TEST(DecodeHeader, RefusesOriginsThatAreNoPlace) {
  SpmHeader header = test::bake_named("one_face").header;
  for (const double origin_m :
       {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    header.grid.origin_m[1] = origin_m;
    EXPECT_FALSE(decode_header(encode_header(header)).is_ok());
  }
  // The origin stands after magic number, blocks' root, exponent, bits and shifts: a flag, and how
  // many bits it has.
  header.grid.origin_m = {};
  auto bytes = encode_header(header);
  constexpr std::size_t kOrigin = 32 + 128 + 14 + 6 + 15;
  const auto refused_for = [&bytes](const std::string& reason) {
    const Result<SpmHeader> decoded = decode_header(bytes);
    ASSERT_FALSE(decoded.is_ok());
    EXPECT_NE(decoded.status().message().find(reason), std::string::npos)
        << decoded.status().message();
  };
  for (std::size_t bit = kOrigin + 1; bit < kOrigin + 6; ++bit)
    bytes[bit / 8] |= static_cast<std::uint8_t>(0x80U >> bit % 8);
  refused_for("grid origin is not finite");
  // One more: cells to the origin of a lattice follow, which are 0.
  constexpr std::size_t kLast = kOrigin + 6;
  bytes[kLast / 8] |= static_cast<std::uint8_t>(0x80U >> kLast % 8);
  refused_for("the place on a common lattice");
}

TEST(EncodeHeader, KeepsASetAtAnyScale) {
  SpmHeader header = test::bake_named("sphere").header;
  for (int scale = CodingSet::kMinScale; scale <= CodingSet::kMaxScale; ++scale) {
    const CodingSet set{coding_set_count(), scale};
    header.tables = *coding_set(set, header.lattice_shift);
    const Result<SpmHeader> decoded = decode_header(encode_header(header));
    ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
    EXPECT_EQ(decoded.value().tables.set(), set);
    for (std::size_t i = 0; i < header.tables.contexts().size(); ++i)
      EXPECT_EQ(decoded.value().tables.contexts()[i].lengths, header.tables.contexts()[i].lengths);
  }
}

TEST(DecodeHeader, RefusesASetThatIsNotBuiltIn) {
  SpmHeader header = test::bake_named("sphere").header;
  const std::vector<HuffmanTable> contexts(header.tables.contexts().begin(),
                                           header.tables.contexts().end());
  for (const std::uint32_t set : {coding_set_count(), coding_set_count() + 1}) {
    header.tables = CodingTables({contexts.begin(), contexts.end()}, {set, 0});
    const Result<SpmHeader> decoded = decode_header(encode_header(header));
    ASSERT_EQ(decoded.is_ok(), set == coding_set_count());
    if (decoded.is_ok()) continue;
    EXPECT_EQ(decoded.status().code(), StatusCode::kCorrupt);
    EXPECT_NE(decoded.status().message().find("built-in set " + std::to_string(set) + " of "),
              std::string::npos)
        << decoded.status().message();
  }
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
  ASSERT_EQ(bytes[3], '7');  // of the magic number, "NMH7"
  bytes[3] = '6';
  const Result<SpmHeader> refused = decode_header(bytes);
  ASSERT_FALSE(refused.is_ok());
  EXPECT_EQ(refused.status().code(), StatusCode::kCorrupt);
  EXPECT_NE(refused.status().message().find("magic number"), std::string::npos);
}

TEST(DecodeHeader, RefusesTablesThatAreNoPrefixCode) {
  // The tables stand last: of escapes alone, 369 times four bits.
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

// The fields before the roots, then `sizes` of roots.
std::vector<std::uint8_t> header_with_roots(const std::vector<std::uint32_t>& sizes,
                                            std::uint64_t open_edges = 0, std::uint64_t parts = 1) {
  BitWriter out;
  out.put(0x4e4d4837, 32);
  for (int i = 0; i < 2; ++i) out.put64(0);  // the blocks' root
  out.put(4096, 14);
  out.put(21, 6);
  out.put(0, 15);
  for (int k = 0; k < 3; ++k) out.put(1 << 6, 7);  // the origin: no cells
  out.put(0, 1);                                   // no rounding error
  out.put(0, 5);                                   // no faces
  out.put_gamma(0);
  out.put_gamma(sizes.size() - 1);
  for (const std::uint32_t size : sizes) {
    out.put(static_cast<std::uint64_t>(bit_length(size)), 5);
    out.put(size, std::max(bit_length(size) - 1, 0));
    for (int k = 0; k < 3; ++k) out.put(0, 21);
    for (int k = 0; k < 6; ++k) out.put(0, 7);
  }
  out.put_gamma(open_edges);
  out.put_gamma(0);
  out.put_gamma(parts - 1);
  if (parts <= kMaxComponentSeeds)
    for (std::uint64_t i = 3; i < 3 * parts; ++i) out.put(i, 21);
  out.put_gamma(1);  // the first set of tables,
  out.put(16, 5);    // at home
  return std::move(out).finish();
}

TEST(DecodeHeader, AcceptsRootsAloneWithoutFaces) {
  const Result<SpmHeader> header = decode_header(header_with_roots({2, 3}));
  ASSERT_TRUE(header.is_ok()) << header.status().message();
  EXPECT_EQ(header.value().roots.size(), 2U);
  EXPECT_EQ(header.value().vertex_count, 5U);
}

TEST(DecodeHeader, RefusesARootWithoutVertices) {
  const Result<SpmHeader> header = decode_header(header_with_roots({5, 0}));
  ASSERT_FALSE(header.is_ok());
  EXPECT_NE(header.status().message().find("a root without vertices"), std::string::npos)
      << header.status().message();
}

TEST(DecodeHeader, RefusesMoreVerticesThanAModelHas) {
  constexpr std::uint32_t kHalf = kMaxVertices / 2;
  EXPECT_TRUE(decode_header(header_with_roots({kHalf, kHalf - 1})).is_ok());
  const Result<SpmHeader> header = decode_header(header_with_roots({kHalf, kHalf}));
  ASSERT_FALSE(header.is_ok());
  EXPECT_NE(header.status().message().find("vertex count"), std::string::npos)
      << header.status().message();
}

TEST(DecodeHeader, ReadsTheSeedsOfAllParts) {
  const Result<SpmHeader> header = decode_header(header_with_roots({2, 3}, 0, 3));
  ASSERT_TRUE(header.is_ok()) << header.status().message();
  EXPECT_EQ(header.value().surface.component_seeds,
            (std::vector<GridPoint>{{{0, 0, 0}}, {{3, 4, 5}}, {{6, 7, 8}}}));
  EXPECT_TRUE(header.value().surface.has_seeds());
}

TEST(DecodeHeader, KnowsThatTooManyPartsHaveNoSeeds) {
  const Result<SpmHeader> most = decode_header(header_with_roots({300}, 0, 256));
  ASSERT_TRUE(most.is_ok()) << most.status().message();
  EXPECT_EQ(most.value().surface.component_seeds.size(), 256U);
  const Result<SpmHeader> more = decode_header(header_with_roots({300}, 0, 257));
  ASSERT_TRUE(more.is_ok()) << more.status().message();
  EXPECT_FALSE(more.value().surface.has_seeds());
  EXPECT_TRUE(more.value().surface.component_seeds.empty());
}

TEST(DecodeHeader, RefusesMorePartsThanVertices) {
  EXPECT_TRUE(decode_header(header_with_roots({2, 3}, 0, 5)).is_ok());
  EXPECT_FALSE(decode_header(header_with_roots({2, 3}, 0, 6)).is_ok());
}

TEST(DecodeHeader, RefusesMoreOpenEdgesThanItsFacesHave) {
  const Result<SpmHeader> header = decode_header(header_with_roots({2, 3}, 1));
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
