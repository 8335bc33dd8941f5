// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "idl/dds/writer_books.hpp"

namespace nearmesh::wire {
namespace {

Handle handle_of(unsigned char n) {
  Handle handle;
  handle.value[0] = n;
  return handle;
}

TEST(SilenceWatch, NamesEachSilentWriterOnce) {
  SilenceWatch watch(2);
  watch.matched(handle_of(1), 0);
  watch.matched(handle_of(2), 1);
  EXPECT_TRUE(watch.take_silent(1.9).empty());
  EXPECT_EQ(watch.take_silent(2), std::vector<Handle>{handle_of(1)});
  EXPECT_EQ(watch.take_silent(9), std::vector<Handle>{handle_of(2)});
  EXPECT_TRUE(watch.take_silent(99).empty());
}

TEST(SilenceWatch, WhoSpokeOrLeftIsNotSilent) {
  SilenceWatch watch(2);
  watch.heard(handle_of(1));  // before its match is told
  watch.matched(handle_of(1), 0);
  watch.matched(handle_of(2), 0);
  watch.heard(handle_of(2));
  watch.matched(handle_of(3), 0);
  watch.gone(handle_of(3));
  EXPECT_TRUE(watch.take_silent(9).empty());
  watch.gone(handle_of(1));
  watch.matched(handle_of(1), 10);
  EXPECT_EQ(watch.take_silent(12), std::vector<Handle>{handle_of(1)});
}

}  // namespace
}  // namespace nearmesh::wire
