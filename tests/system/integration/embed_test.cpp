// SPDX-License-Identifier: Apache-2.0
// The embedding example says exactly what its README promises.

#include "process.hpp"

namespace nearmesh {
namespace {

TEST(Embed, PrintsTheExpectedOutput) {
  const std::string domain = "69", interface = "127.0.0.1";
  const test::Folder folder;
  test::Process publisher(
      folder, "nearmesh-publisher",
      {"serve", test::model_file("sphere", 64), "--domain", domain, "--interface", interface});
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  test::Process example(folder, "nearmesh-example-embed", {domain, interface});
  EXPECT_EQ(example.wait(), 0) << example.err();
  EXPECT_EQ(example.out(), test::read_text(NEARMESH_EMBED_DIR "/expected_output.txt"));
  // In its first step nobody has been heard yet.
  EXPECT_NE(
      test::read_text(NEARMESH_EMBED_DIR "/README.md").find(test::lines_of(example.err()).at(0)),
      std::string::npos)
      << example.err();
}

}  // namespace
}  // namespace nearmesh
