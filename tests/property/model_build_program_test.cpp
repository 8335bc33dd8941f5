// SPDX-License-Identifier: Apache-2.0
// Models built by the nearmesh-model program: the number of threads.
#include <cstdlib>
#include <filesystem>

#include "nearmesh/core/spm/model_file.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

class ModelBuildProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(program())) GTEST_SKIP() << program() << " is not built";
  }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }
  static int run(const std::string& arguments) {
    return std::system((program() + " " + arguments + " > /dev/null 2>&1").c_str());
  }
};

TEST_F(ModelBuildProgram, WritesTheSameFileOnAnyNumberOfThreads) {
  const test::TempFile mesh(".ply");
  ASSERT_EQ(run("generate terrain --size 240 -o " + mesh.path()), 0);
  const test::TempFile alone, two, all;
  ASSERT_EQ(run("build --threads 1 " + mesh.path() + " -o " + alone.path()), 0);
  ASSERT_EQ(run("build --threads 2 " + mesh.path() + " -o " + two.path()), 0);
  ASSERT_EQ(run("build " + mesh.path() + " -o " + all.path()), 0);
  EXPECT_EQ(two.read(), alone.read());
  EXPECT_EQ(all.read(), alone.read());
}

TEST_F(ModelBuildProgram, StatesARoundingErrorThatIsNoLessThanTheBound) {
  const test::TempFile mesh(".ply"), model, text(".txt");
  double more = 0;
  for (const char* size : {"8", "12", "20", "28"}) {
    ASSERT_EQ(run("generate sphere --size " + std::string(size) + " -o " + mesh.path()), 0);
    ASSERT_EQ(run("build " + mesh.path() + " -o " + model.path()), 0);
    const double bound = ModelFile::open(model.path()).value().header().rounding_bound_m();
    ASSERT_EQ(std::system((program() + " info " + model.path() + " > " + text.path()).c_str()), 0);
    const auto bytes = text.read();
    const std::string said(bytes.begin(), bytes.end()), before = "rounding error ";
    const std::size_t at = said.find(before);
    ASSERT_NE(at, std::string::npos);
    const double stated = std::strtod(said.c_str() + at + before.size(), nullptr);
    EXPECT_GE(stated, bound);
    EXPECT_LE(stated, bound * 1.01);
    more += stated - bound;
  }
  EXPECT_GT(more, 0);  // four that three digits hold would show nothing
}

TEST_F(ModelBuildProgram, RefusesNoThreads) {
  const test::TempFile mesh(".ply"), model;
  ASSERT_EQ(run("generate sphere --size 8 -o " + mesh.path()), 0);
  EXPECT_NE(run("build --threads 0 " + mesh.path() + " -o " + model.path()), 0);
  EXPECT_EQ(run("build --threads 1 " + mesh.path() + " -o " + model.path()), 0);
}

}  // namespace
}  // namespace nearmesh
