// SPDX-License-Identifier: Apache-2.0
#include "publisher/serve/checked_model.hpp"

#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/spm/file_layout.hpp"
#include "reseal.hpp"
#include "test_models.hpp"

namespace nearmesh::publisher {
namespace {

namespace fs = std::filesystem;

class OpenChecked : public ::testing::Test {
 protected:
  void SetUp() override { file_.write(test::write_model(test::bake_named("terrain"))->read()); }
  void TearDown() override { fs::remove(verdict()); }
  [[nodiscard]] std::string verdict() const { return file_.path() + ".checked"; }
  /// Of the block of the lowest level that has a shrunken box, so that only a look at all of it
  /// tells; every hash right.
  void shrink_a_box() {
    file_layout::Preamble preamble;
    const auto good = file_.read();
    std::memcpy(&preamble, good.data(), sizeof preamble);
    const std::uint64_t blocks = sizeof preamble + preamble.header_bytes;
    Random random(3);
    for (int i = 0; i < 20000; ++i) {
      auto bytes = good;
      bytes[blocks +
            random.below(static_cast<std::uint32_t>(preamble.directory_offset - blocks))] ^=
          static_cast<std::uint8_t>(1U << random.below(8));
      test::reseal(bytes);
      file_.write(bytes);
      Result<ModelFile> opened = ModelFile::open(file_.path());
      if (opened.is_ok() && opened.value().verify().is_ok() &&
          opened.value().require_all().is_ok() && !opened.value().check_deep().is_ok())
        return;
    }
    FAIL() << "no such mutant";
  }
  test::TempFile file_;
};

TEST_F(OpenChecked, LeavesItsVerdictBesideTheFileAndTrustsIt) {
  ASSERT_TRUE(open_checked(file_.path()).is_ok());
  std::ifstream in(verdict());
  std::string found;
  std::getline(in, found);
  EXPECT_EQ(found, to_hex(ModelFile::open(file_.path()).value().content_hash()));
  const auto time = fs::last_write_time(verdict());
  const Result<ModelFile> again = open_checked(file_.path());
  ASSERT_TRUE(again.is_ok());
  EXPECT_EQ(fs::last_write_time(verdict()), time);
  EXPECT_EQ(again.value().store().known_splits(), 0U) << "nothing was decoded";
}

TEST_F(OpenChecked, RefusesAModelWhoseBoxesLeaveOutAFaceThoughAllHashesAreRight) {
  ASSERT_TRUE(open_checked(file_.path()).is_ok());
  shrink_a_box();
  // A verdict is there, of another content.
  const Result<ModelFile> refused = open_checked(file_.path());
  ASSERT_FALSE(refused.is_ok());
  EXPECT_EQ(refused.status().code(), StatusCode::kCorrupt);
  EXPECT_NE(refused.status().message().find(file_.path()), std::string::npos);
  EXPECT_NE(refused.status().message().find("its box leaves out faces"), std::string::npos)
      << refused.status().message();
  EXPECT_FALSE(open_checked(file_.path()).is_ok()) << "no verdict was left";
}

TEST_F(OpenChecked, WhereNothingCanBeWrittenItIsCheckedEachTime) {
  fs::create_directory(verdict());  // which no file can be written over
  EXPECT_TRUE(open_checked(file_.path()).is_ok());
  EXPECT_TRUE(fs::is_directory(verdict()));
}

}  // namespace
}  // namespace nearmesh::publisher
