// SPDX-License-Identifier: Apache-2.0
// Model files of which a bit was changed and every hash made right again: what a publisher would
// serve who is wrong, or lies. A certified answer about one must be that of its own full mesh.

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>

#include "core/demand/answer.hpp"
#include "core/replica/replica.hpp"
#include "core/spm/file_layout.hpp"
#include "nearmesh/core/query/query.hpp"
#include "random_rotation.hpp"
#include "reseal.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using file_layout::Preamble;
using test::TempFile;

struct Ball {
  Ball() : file(test::write_model(test::bake_mesh(generate_sphere(10, 0), 8))) {}
  std::unique_ptr<TempFile> file;
};

struct Outcome {
  std::size_t refused = 0, answers = 0, wrong = 0;
};

std::vector<Pose> poses() {
  Random random(5);
  std::vector<Pose> all;
  for (int i = 0; i < 12; ++i) {
    Pose pose{.rotation = test::random_rotation(random)};
    for (double& x : pose.translation_m) x = random.between(-1.5, 1.5);
    all.push_back(pose);
  }
  return all;
}

/// What a publisher of the file sends for these nodes; false where it cannot, or the peer does not
/// believe it.
bool fetch(ModelFile& file, const std::vector<NodeSpan>& missing, Replica& replica) {
  if (missing.empty()) return true;
  RegionRequest request{.attach = missing};
  request.attach.resize(std::min(missing.size(), kMaxAttachNodes));
  auto batches = answer_request(file.header(), file.store(), request,
                                [&file](NodeSpan node) { return file.require(node); });
  if (!batches.is_ok()) return false;
  const std::uint64_t before = replica.mesh().state_hash();
  for (auto& bytes : batches.value()) {
    seal_batch(file.content_hash(), bytes);
    if (!replica.take(bytes).status.is_ok()) return false;
  }
  return replica.mesh().state_hash() != before;
}

/// Asks as a peer does, from what it is sent, and compares with the full mesh of the same file.
void ask(const std::string& path, Outcome& outcome) {
  Result<ModelFile> whole = ModelFile::open(path);
  if (!whole.is_ok() || !whole.value().require_all().is_ok()) {
    ++outcome.refused;
    return;
  }
  const std::optional<TriangleTree> full =
      build_full_tree(whole.value().header(), whole.value().store());
  ASSERT_TRUE(full.has_value());
  static const Ball ball;
  Result<ModelFile> other = ModelFile::open(ball.file->path());
  ASSERT_TRUE(other.value().require_all().is_ok());
  const TriangleTree other_full = *build_full_tree(other.value().header(), other.value().store());
  const QueryOptions options{.clearance = Clearance::kNone};
  Result<ModelFile> model = ModelFile::open(path);
  Replica a(model.value().header()), b(other.value().header());
  for (const Pose& pose : poses()) {
    const auto posed = pose_pair(full->grid, Pose{}, "a", other_full.grid, pose, "b");
    if (!posed.is_ok()) {  // grids too far apart
      ++outcome.refused;
      return;
    }
    Answer answer;
    while (!is_certified(answer.status)) {
      answer = query(a.view(), posed.value().a, b.view(), posed.value().b, options);
      if (is_beyond_detail(answer) || !fetch(model.value(), answer.missing_a, a) ||
          !fetch(other.value(), answer.missing_b, b)) {
        ++outcome.refused;
        return;
      }
    }
    ++outcome.answers;
    const Answer expected =
        query(full->view(), posed.value().a, other_full.view(), posed.value().b, options);
    if (answer.status != expected.status || answer.pairs != expected.pairs) {
      ++outcome.wrong;
      return;
    }
  }
}

std::vector<std::uint8_t> true_file() {
  return test::write_model(test::bake_mesh(generate_sphere(14, 0), 8))->read();
}

TEST(Mutants, TheTrueFileIsAnsweredRight) {
  const TempFile file;
  file.write(true_file());
  Outcome outcome;
  ask(file.path(), outcome);
  EXPECT_EQ(outcome.refused, 0U);
  EXPECT_EQ(outcome.wrong, 0U);
  EXPECT_EQ(outcome.answers, poses().size());
  EXPECT_TRUE(ModelFile::open(file.path()).value().check_deep().is_ok());
}

struct Counts {
  std::size_t refused = 0, wrong = 0, wrong_though_checked = 0, harmless = 0;
};

/// One bit changed in [begin, end) of the file, so many times.
Counts try_mutants(std::uint64_t begin, std::uint64_t end, int count, std::uint64_t seed) {
  const auto good = true_file();
  const TempFile file;
  Random random(seed);
  Counts counts;
  for (int i = 0; i < count; ++i) {
    auto bytes = good;
    const std::uint32_t bit = random.below(static_cast<std::uint32_t>((end - begin) * 8));
    bytes[begin + bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    test::reseal(bytes);
    file.write(bytes);
    Outcome outcome;
    ask(file.path(), outcome);
    counts.refused += outcome.refused;
    if (outcome.refused == 0 && outcome.wrong == 0) ++counts.harmless;
    if (outcome.wrong == 0) continue;
    ++counts.wrong;
    Result<ModelFile> served = ModelFile::open(file.path());
    if (served.value().check_deep().is_ok()) ++counts.wrong_though_checked;
  }
  return counts;
}

/// NEARMESH_MUTANTS=N asks for N, of which one in 300 may lie.
int mutant_count() {
  const char* given = std::getenv("NEARMESH_MUTANTS");
  return given == nullptr ? 300 : std::atoi(given);
}

TEST(Mutants, OfThreeHundredAtMostOneLies) {
  Preamble preamble;
  const auto good = true_file();
  std::memcpy(&preamble, good.data(), sizeof preamble);
  const std::uint64_t blocks = sizeof(Preamble) + preamble.header_bytes;
  // Behind magic number and root: both are put right.
  const Counts header = try_mutants(sizeof(Preamble) + 20, blocks, mutant_count() / 2, 1);
  const Counts block = try_mutants(
      blocks, preamble.directory_offset - sizeof(file_layout::OriginEntry), mutant_count() / 2, 2);
  std::printf("%zu headers and %zu blocks lie\n", header.wrong, block.wrong);
  EXPECT_LE(header.wrong + block.wrong, static_cast<std::size_t>(mutant_count()) / 300);
  EXPECT_GT(header.refused + block.refused, 100U);
  EXPECT_GT(header.harmless + block.harmless, 50U) << "changes of what no face depends on";
  EXPECT_EQ(header.wrong_though_checked + block.wrong_though_checked, 0U);
}

/// The boxes of all roots in the header set to nothing, every hash right.
TEST(Mutants, RootBoxesOfZeroAreRefusedAtTheFirstTouch) {
  const test::TempFile file;
  BakedModel model = test::bake_mesh(generate_sphere(14, 0), 8);
  const auto written = test::write_model(model);
  auto bytes = written->read();
  SpmHeader header = ModelFile::open(written->path()).value().header();
  const std::size_t size = encode_header(header).size();
  for (BaseRoot& root : header.roots) root.box = {};
  const auto lie = encode_header(header);
  ASSERT_EQ(lie.size(), size);
  std::copy(lie.begin(), lie.end(), bytes.begin() + sizeof(Preamble));
  test::reseal(bytes);
  file.write(bytes);
  const Result<ModelFile> refused = ModelFile::open(file.path());
  ASSERT_FALSE(refused.is_ok());
  EXPECT_EQ(refused.status().code(), StatusCode::kCorrupt);
  EXPECT_NE(refused.status().message().find("a base face lies outside the boxes of its roots"),
            std::string::npos)
      << refused.status().message();
  EXPECT_FALSE(decode_header(lie).is_ok()) << "nor does a peer take it";
}

}  // namespace
}  // namespace nearmesh
