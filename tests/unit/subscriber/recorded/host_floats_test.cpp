// SPDX-License-Identifier: Apache-2.0
// What others have answered is proved whatever is set in the processor of who proves it.
#include "host_floats.hpp"

#include <unistd.h>

#include <filesystem>

#include "subscriber/recorded/verify.hpp"

namespace nearmesh {
namespace {

TEST(HostFloatsOfAProof, ProveTheGoldenSessionAsEver) {
  // A copy, since SQLite opens for writing.
  const std::string copy =
      ::testing::TempDir() + "nearmesh_floats_" + std::to_string(::getpid()) + ".db3";
  std::filesystem::copy_file(NEARMESH_GOLDEN_SESSION, copy);
  const auto recording = RecordingReader::open(copy).value();
  const auto prove = [&] { return subscriber::verify(*recording, {.threads = 2}).value(); };
  const subscriber::VerifyReport plain = prove();
  EXPECT_EQ(plain.different + plain.lacking + plain.gave_up + plain.malformed, 0U);
  EXPECT_EQ(plain.verified, 50U);
  EXPECT_EQ(plain.not_asked, 1U);
  test::expect_same_under_all_floats([&] {
    const subscriber::VerifyReport found = prove();
    return std::array{found.reports, found.verified, found.different, found.digest};
  });
  std::filesystem::remove(copy);
}

}  // namespace
}  // namespace nearmesh
