// SPDX-License-Identifier: Apache-2.0
// Bad numbers in the pose file of `nearmesh-model query`: refused with file, line, body and pose
// named.
#include <sys/wait.h>

#include <filesystem>
#include <fstream>

#include "test_models.hpp"

namespace nearmesh {
namespace {

class QueryPoseFile : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(program())) GTEST_SKIP() << program() << " is not built";
  }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }

  /// The row with one cell replaced, between two good ones.
  void write(std::size_t cell, const std::string& text) const {
    std::ofstream out(poses_.path());
    out << "id";
    for (const char* body : {"A", "B"}) {
      for (int i = 0; i < 9; ++i) out << ',' << body << "_R" << i / 3 << i % 3;
      for (int i = 0; i < 3; ++i) out << ',' << body << "_T" << i;
    }
    for (int row = 0; row < 3; ++row) {
      out << "\npose" << row;
      for (std::size_t i = 0; i < 24; ++i) {
        const std::size_t k = i % 12;
        out << ',' << (row == 1 && i == cell ? text : k < 9 && k % 4 == 0 ? "1" : "0");
      }
    }
    out << '\n';
  }
  /// All that the program says; its exit code in `code`.
  [[nodiscard]] std::string run(int& code) const {
    const std::string command = program() + " query " + model_->path() + " " + model_->path() +
                                " --poses " + poses_.path() + " 2>&1";
    std::FILE* pipe = ::popen(command.c_str(), "r");
    std::string said;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) said += static_cast<char>(c);
    code = WEXITSTATUS(::pclose(pipe));
    return said;
  }

  std::unique_ptr<test::TempFile> model_ = test::write_model(test::bake_named("one_face"));
  test::TempFile poses_{".csv"};
};

TEST_F(QueryPoseFile, BadNumberIsRefusedByFileLineAndBody) {
  const std::vector<std::string> bad = {"nan", "inf", "-inf", "1e308", "-1e308"};
  for (std::size_t cell = 0; cell < 24; ++cell) {
    const std::string& text = bad[cell % bad.size()];
    SCOPED_TRACE("cell " + std::to_string(cell) + " = " + text);
    write(cell, text);
    int code = 0;
    const std::string said = run(code);
    EXPECT_EQ(code, 1);
    const std::string expected =
        poses_.path() + ":3: pose of " + (cell < 12 ? "A" : "B") + " of pose pose1: ";
    EXPECT_NE(said.find(expected), std::string::npos) << said;
    EXPECT_NE(said.find("\"id\":\"pose0\""), std::string::npos);  // those before it were answered
    EXPECT_EQ(said.find("\"id\":\"pose2\""), std::string::npos);
  }
}

TEST_F(QueryPoseFile, MatrixThatIsNoRotationIsRefused) {
  // Scaled, skewed, all but zero, mirrored: one entry of the identity each.
  for (const auto& [cell, text] :
       {std::pair(4U, "1.001"), std::pair(13U, "0.001"), std::pair(8U, "4.9e-324"),
        std::pair(16U, "-1"), std::pair(0U, "0")}) {
    SCOPED_TRACE(text);
    write(cell, text);
    int code = 0;
    const std::string said = run(code);
    EXPECT_EQ(code, 1);
    EXPECT_NE(said.find(poses_.path() + ":3: pose of " + (cell < 12 ? "A" : "B")),
              std::string::npos)
        << said;
  }
}

TEST_F(QueryPoseFile, DenormalTranslationIsZero) {
  write(9, "4.9406564584124654e-324");
  int code = 0;
  EXPECT_NE(run(code).find("3 poses by certified: 0 free, 3 contact"), std::string::npos);
  EXPECT_EQ(code, 0);
}

}  // namespace
}  // namespace nearmesh
