// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/body_book.hpp"

#include <gtest/gtest.h>

namespace nearmesh::wire {
namespace {

using BodyClaim = BodyBook::Claim;

// Of an identity (the first six bytes), in its participant.
BodyBook::Handle writer_of(std::uint8_t identity, std::uint8_t participant) {
  BodyBook::Handle handle;
  handle.value[5] = identity;
  handle.value[6] = participant;
  return handle;
}

TEST(BodyBook, FirstWriterKeepsABodyUntilItIsGone) {
  BodyBook book(false);
  EXPECT_EQ(book.claim("arm", writer_of(1, 1)), BodyClaim::kOwn);
  EXPECT_EQ(book.claim("arm", writer_of(1, 1)), BodyClaim::kOwn);
  EXPECT_EQ(book.claim("arm", writer_of(1, 2)), BodyClaim::kOthers);
  EXPECT_EQ(book.claim("leg", writer_of(1, 2)), BodyClaim::kOwn);
  book.forget(writer_of(1, 1));
  EXPECT_EQ(book.claim("leg", writer_of(1, 1)), BodyClaim::kOthers);
  EXPECT_EQ(book.claim("arm", writer_of(1, 2)), BodyClaim::kOwn);
}

TEST(BodyBook, AuthenticatedIdentityKeepsItForGood) {
  BodyBook book(true);
  EXPECT_EQ(book.claim("arm", writer_of(1, 1)), BodyClaim::kOwn);
  book.forget(writer_of(1, 1));
  book.clear();
  EXPECT_EQ(book.claim("arm", writer_of(2, 1)), BodyClaim::kOthers);
  EXPECT_EQ(book.claim("arm", writer_of(1, 2)), BodyClaim::kOwn);
}

TEST(BodyBook, NobodyFillsIt) {
  for (const bool authenticated : {false, true}) {
    BodyBook book(authenticated);
    for (std::size_t i = 0; i < BodyBook::kMaxOfOne; ++i)
      ASSERT_EQ(book.claim("b" + std::to_string(i), writer_of(1, 1)), BodyClaim::kOwn);
    EXPECT_EQ(book.claim("more", writer_of(1, 1)), BodyClaim::kFull);
    EXPECT_EQ(book.claim("b0", writer_of(1, 1)), BodyClaim::kOwn);
    EXPECT_EQ(book.claim("more", writer_of(2, 1)), BodyClaim::kOwn);
    if (authenticated) continue;
    book.forget(writer_of(1, 1));
    EXPECT_EQ(book.claim("new", writer_of(1, 1)), BodyClaim::kOwn);
  }
}

// In weeks an identity has many more bodies than at a time. Names of those that are gone stay its
// own, until it needs their room.
TEST(BodyBook, BodiesThatAreGoneMakeRoomForThoseOfTheirOwner) {
  const BodyBook::Handle one = writer_of(1, 1), other = writer_of(2, 1);
  BodyBook book(true);
  const auto name_of = [](std::size_t i) { return "b" + std::to_string(i); };
  for (std::size_t i = 0; i < BodyBook::kMaxOfOne; ++i)
    ASSERT_EQ(book.claim(name_of(i), one), BodyClaim::kOwn);
  for (const std::size_t gone : {7U, 3U, 5U}) book.release(name_of(gone), one);
  book.release("b9", other);
  book.release("b7", one);  // once is enough
  EXPECT_EQ(book.claim("b7", other), BodyClaim::kOthers);
  EXPECT_EQ(book.claim("b3", one), BodyClaim::kOwn);  // is moved again
  EXPECT_EQ(book.claim("first", one), BodyClaim::kOwn);
  EXPECT_EQ(book.claim("b5", other), BodyClaim::kOthers);
  EXPECT_EQ(book.claim("b7", other), BodyClaim::kOwn);
  EXPECT_EQ(book.claim("second", one), BodyClaim::kOwn);
  EXPECT_EQ(book.claim("third", one), BodyClaim::kFull);
  for (const std::size_t moved : {3U, 9U})
    EXPECT_EQ(book.claim(name_of(moved), other), BodyClaim::kOthers);
  for (std::size_t i = 0; i < 10 * BodyBook::kMaxOfOne; ++i) {
    ASSERT_EQ(book.claim("of a while " + std::to_string(i), other), BodyClaim::kOwn) << i;
    book.release("of a while " + std::to_string(i), other);
  }
}

TEST(BodyBook, WhereAllIsFullTheLongestGoneMakesRoom) {
  BodyBook book(true);
  for (std::size_t i = 0; i < BodyBook::kMaxOfAll; ++i)
    ASSERT_EQ(book.claim(std::to_string(i),
                         writer_of(static_cast<std::uint8_t>(i / BodyBook::kMaxOfOne), 1)),
              BodyClaim::kOwn);
  const BodyBook::Handle late = writer_of(200, 1);
  EXPECT_EQ(book.claim("late", late), BodyClaim::kFull);
  book.release("4096", writer_of(4, 1));
  book.release("1024", writer_of(1, 1));
  EXPECT_EQ(book.claim("late", late), BodyClaim::kOwn);
  EXPECT_EQ(book.claim("1024", late), BodyClaim::kOthers);
  EXPECT_EQ(book.claim("later", late), BodyClaim::kOwn);
  EXPECT_EQ(book.claim("latest", late), BodyClaim::kFull);
}

TEST(BodyBook, AllTogetherAreBounded) {
  BodyBook book(false);
  for (std::size_t i = 0; i < BodyBook::kMaxOfAll; ++i)
    ASSERT_EQ(book.claim(std::to_string(i),
                         writer_of(1, static_cast<std::uint8_t>(i / BodyBook::kMaxOfOne))),
              BodyClaim::kOwn);
  EXPECT_EQ(book.claim("more", writer_of(2, 1)), BodyClaim::kFull);
}

}  // namespace
}  // namespace nearmesh::wire
