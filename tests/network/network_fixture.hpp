// SPDX-License-Identifier: Apache-2.0
#pragma once
// What tests in network namespaces begin with.

#include <gtest/gtest.h>

#include "runs.hpp"

namespace nearmesh::test {

class NetworkFixture : public ::testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = Lan::why_not_permitted(); !why.empty())
      GTEST_SKIP() << "no network can be made here: " << why;
  }
  static Exercise exercise() {
    constexpr int kTerrainCells = 256;
    return {{model_file("terrain", kTerrainCells), model_file("aircraft", 600)}, kTerrainCells};
  }
};

}  // namespace nearmesh::test
