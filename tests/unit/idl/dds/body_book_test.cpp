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
