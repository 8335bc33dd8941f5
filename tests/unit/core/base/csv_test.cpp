// SPDX-License-Identifier: Apache-2.0
// What is wrong in a table is told with its place, and with what is there instead.
#include "core/base/csv.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/folder.hpp"

namespace nearmesh {
namespace {

TEST(CsvTable, NamesTheColumnThatIsMissingAndThoseThatAreThere) {
  const test::Folder folder;
  const std::string path = folder.file("poses.csv");
  std::ofstream(path) << "id,T0,T1\na,1,2\n";
  const Result<CsvTable> table = CsvTable::read(path);
  ASSERT_TRUE(table.is_ok()) << table.status().message();
  const auto columns = table.value().columns({"id", "T2"});
  ASSERT_FALSE(columns.is_ok());
  EXPECT_EQ(columns.status().message(), path + ": expected a column named T2, found id, T0, T1");
}

}  // namespace
}  // namespace nearmesh
