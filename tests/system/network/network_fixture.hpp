// SPDX-License-Identifier: Apache-2.0
#pragma once
// What tests in network namespaces begin with.

#include <gtest/gtest.h>

#include <memory>
#include <vector>

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

  const Folder folder;
};

/// Of those that begin with a publisher.
class ServedFixture : public NetworkFixture {
 protected:
  /// Makes the hosts, and the publisher on the first.
  void serve_over(const std::vector<Link>& hosts, const std::string& interface = {}) {
    models = exercise();
    models.interface = interface;
    lan = std::make_unique<Lan>(hosts);
    publisher = serve(*lan, folder, models);
  }

  Exercise models;
  std::unique_ptr<Lan> lan;
  std::unique_ptr<Process> publisher;
};

}  // namespace nearmesh::test
