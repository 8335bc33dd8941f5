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
  for (const unsigned threads : {1U, 3U}) {
    const auto recording = RecordingReader::open(copy).value();
    const subscriber::VerifyReport plain = subscriber::verify(*recording, threads).value();
    EXPECT_EQ(plain.verified, plain.reports);
    EXPECT_EQ(plain.verified, 57U);
    test::expect_same_under_all_floats([&] {
      const subscriber::VerifyReport found = subscriber::verify(*recording, threads).value();
      return std::array{found.reports, found.verified, found.different, found.digest};
    });
  }
  std::filesystem::remove(copy);
}

}  // namespace
}  // namespace nearmesh
