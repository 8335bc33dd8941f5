// SPDX-License-Identifier: Apache-2.0
#pragma once
// The golden session, and what is expected of it. Both are made by make_golden.py, anew with each
// wire version.

#include <cstdlib>

#include "nearmesh/core/recording/recording.hpp"
#include "tests/system/integration/process.hpp"

namespace nearmesh::test {

inline std::string golden_file(const std::string& name) {
  return std::string(NEARMESH_SESSION_DATA) + "/" + name;
}

/// A copy, since SQLite opens for writing.
inline std::string golden_session(const Folder& folder) {
  const std::string copy = folder.file("session_v1.db3");
  std::filesystem::copy_file(golden_file("session_v1.db3"), copy,
                             std::filesystem::copy_options::overwrite_existing);
  return copy;
}

/// Compares with a file of expected text; what was found is left beside the test when it differs.
inline void expect_golden(const std::string& found, const std::string& name) {
  if (found == read_text(golden_file(name))) return;
  const std::string path = ::testing::TempDir() + name + ".found";
  std::ofstream(path) << found;
  ADD_FAILURE() << "differs from " << golden_file(name) << "; found: " << path << "\n" << found;
}

}  // namespace nearmesh::test
