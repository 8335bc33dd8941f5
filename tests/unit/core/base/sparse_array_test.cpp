// SPDX-License-Identifier: Apache-2.0
// An array of which few elements are set reads as one that is there whole, however they come and
// go.
#include "nearmesh/core/base/detail/sparse_array.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

namespace nearmesh {
namespace {

struct Sized {
  std::size_t size;
  std::uint32_t among;  // set are only so many ids, from the first
};

class SparseArrays : public testing::TestWithParam<Sized> {};

TEST_P(SparseArrays, ReadAsAWholeArray) {
  const auto [size, among] = GetParam();
  SparseArray<std::uint64_t> array(size);
  std::vector<std::uint64_t> whole(size);
  std::mt19937 random(7);
  for (int step = 0; step < 20'000; ++step) {
    const std::size_t i = random() % among * (size / among);
    if (random() % 3 == 0) {
      array.unset(i);
      whole[i] = 0;
    } else {
      array.set(i) = whole[i] = random();
    }
    const std::size_t j = random() % size;
    ASSERT_EQ(array[i], whole[i]);
    ASSERT_EQ(array[j], whole[j]);
  }
  for (std::size_t i = 0; i < size; ++i) ASSERT_EQ(array[i], whole[i]) << i;
}

// Small ones, few of many, and so many that they are kept as an array in the end.
INSTANTIATE_TEST_SUITE_P(OfSizes, SparseArrays,
                         testing::Values(Sized{1, 1}, Sized{256, 256}, Sized{257, 257},
                                         Sized{100'000, 30}, Sized{100'000, 5'000},
                                         Sized{100'000, 100'000}));

TEST(SparseArray, ElementsThatComeAndGoTakeNoRoomForGood) {
  SparseArray<std::uint64_t> array(1 << 24);
  for (std::uint32_t i = 0; i < 1 << 22; ++i) {
    array.set(i) = i + 1;
    if (i >= 100) array.unset(i - 100);
  }
  EXPECT_LT(array.bytes(), 16'384U);
  EXPECT_EQ(array[(1 << 22) - 1], 1U << 22);
  EXPECT_EQ(array[0], 0U);
}

}  // namespace
}  // namespace nearmesh
