// SPDX-License-Identifier: Apache-2.0
#include "subscriber/dds/recorder_books.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber {
namespace {

wire::Handle writer(int number) {
  wire::Handle handle;
  handle.value[0] = static_cast<std::uint8_t>(number);
  handle.value[1] = static_cast<std::uint8_t>(number >> 8);
  return handle;
}

// Weeks bring more writers than shall be kept. One that comes back soon goes on where it was.
TEST(WriterBook, ForgetsThoseThatAreGoneForLongest) {
  constexpr std::size_t kMostGone = 8;
  WriterBook<int> book(kMostGone);
  book.of(writer(0)) = 7;
  book.of(writer(1)) = 1;
  for (int i = 1; i <= 1000; ++i) {
    book.of(writer(i)) = i;
    book.leave(writer(i));
  }
  EXPECT_EQ(book.size(), 1 + kMostGone);
  EXPECT_EQ(*book.find(writer(0)), 7);
  EXPECT_EQ(book.find(writer(992)), nullptr);
  EXPECT_EQ(*book.find(writer(993)), 993);
  book.come(writer(993));
  book.leave(writer(1001));
  book.leave(writer(1002));
  EXPECT_EQ(book.find(writer(994)), nullptr);
  EXPECT_EQ(*book.find(writer(993)), 993);
  // A sample may be taken after its writer went.
  book.of(writer(1002)) = 1002;
  for (int i = 0; i < 20; ++i) book.leave(writer(2000 + i));
  EXPECT_EQ(book.find(writer(1002)), nullptr);
  EXPECT_EQ(book.size(), 2 + kMostGone);
  book.all_leave();
  EXPECT_EQ(*book.find(writer(0)), 7);
  for (int i = 0; i < 20; ++i) book.leave(writer(3000 + i));
  EXPECT_EQ(book.size(), kMostGone);
  for (const int gone : {0, 993}) EXPECT_EQ(book.find(writer(gone)), nullptr);
}

TEST(Recorder, TellsNamesAfterMoreSessionsThanAreKept) {
  LruMap<wire::SessionId, std::string> told(4);
  EXPECT_TRUE(tells_name(told, 1, "stays"));
  EXPECT_FALSE(tells_name(told, 1, "stays"));
  EXPECT_TRUE(tells_name(told, 1, "renamed"));
  for (wire::SessionId session = 2; session <= 100; ++session) {
    EXPECT_TRUE(tells_name(told, session, "comes and goes")) << session;
    EXPECT_FALSE(tells_name(told, session, "comes and goes"));
    EXPECT_FALSE(tells_name(told, 1, "renamed"));
  }
  EXPECT_TRUE(tells_name(told, 2, "comes and goes")) << "again, since it was forgotten";
}

}  // namespace
}  // namespace nearmesh::subscriber
