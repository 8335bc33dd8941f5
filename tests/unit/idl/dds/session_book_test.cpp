// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "idl/dds/mailbox.hpp"
#include "idl/dds/writer_books.hpp"

namespace nearmesh::wire {
namespace {

using SessionClaim = SessionBook::Claim;

Handle writer(std::uint8_t n) {
  Handle handle;
  handle.value[0] = n;
  handle.value[15] = 1;
  return handle;
}

TEST(SessionBook, FirstWriterKeepsTheSession) {
  SessionBook book;
  EXPECT_EQ(book.claim(5, writer(1), 10), SessionClaim::kNew);
  EXPECT_EQ(book.claim(5, writer(1), 11), SessionClaim::kKnown);
  EXPECT_EQ(book.claim(5, writer(2), 12), SessionClaim::kTaken);
  EXPECT_EQ(book.claim(6, writer(1), 13), SessionClaim::kTaken);
  EXPECT_EQ(book.forget(writer(2), 14), std::nullopt);
  EXPECT_EQ(book.forget(writer(1), 15), std::optional<SessionId>(5));
  EXPECT_EQ(book.size(), 0U);
}

TEST(SessionBook, WhatWasReceivedBeforeTheLossDoesNotBringItBack) {
  SessionBook book;
  EXPECT_EQ(book.claim(5, writer(1), 10), SessionClaim::kNew);
  EXPECT_EQ(book.forget(writer(1), 20), std::optional<SessionId>(5));
  EXPECT_EQ(book.claim(5, writer(1), 19), SessionClaim::kStale);
  EXPECT_EQ(book.claim(5, writer(1), 21), SessionClaim::kNew);
}

TEST(SessionBook, WelcomedWriterCountsWhateverTheClockSays) {
  SessionBook book;
  (void)book.claim(5, writer(1), 10);
  (void)book.forget(writer(1), 20);
  book.welcome(writer(1));
  EXPECT_EQ(book.claim(5, writer(1), 3), SessionClaim::kNew);
}

TEST(SessionBook, ClearTellsWhoWasKnown) {
  SessionBook book;
  (void)book.claim(5, writer(1), 10);
  (void)book.claim(6, writer(2), 10);
  EXPECT_EQ(book.clear(), (std::vector<SessionId>{5, 6}));
  EXPECT_EQ(book.claim(5, writer(3), 1), SessionClaim::kNew);
}

TEST(SessionBook, ReleasedClaimIsFreeAgain) {
  SessionBook book;
  EXPECT_EQ(book.claim(5, writer(1), 10), SessionClaim::kNew);
  book.release(5);
  EXPECT_EQ(book.claim(5, writer(2), 11), SessionClaim::kNew);
}

TEST(SessionBook, TellsThroughWhichWriterASessionSpeaks) {
  SessionBook book;
  EXPECT_EQ(book.writer_of(5), std::nullopt);
  EXPECT_EQ(book.claim(5, writer(1), 10), SessionClaim::kNew);
  EXPECT_EQ(book.claim(5, writer(2), 10), SessionClaim::kTaken);
  EXPECT_EQ(book.writer_of(5), writer(1));
  static_cast<void>(book.forget(writer(1), 20));
  EXPECT_EQ(book.writer_of(5), std::nullopt);
}

TEST(HelloMemory, GivesBackWhatAWriterSaidLastOnceItIsFoundAgain) {
  HelloMemory memory;
  Hello hello;
  hello.publisher = 1;
  memory.heard(hello, writer(1));
  EXPECT_EQ(memory.found(writer(1)), nullptr);  // it was never lost
  memory.lost(writer(1));
  EXPECT_EQ(memory.found(writer(2)), nullptr);
  ASSERT_NE(memory.found(writer(1)), nullptr);
  EXPECT_EQ(memory.found(writer(1)), nullptr);
  memory.lost(writer(1));
  hello.publisher = 2;
  memory.heard(hello, writer(1));  // again, before the match is told
  const Hello* known = memory.found(writer(1));
  ASSERT_NE(known, nullptr);
  EXPECT_EQ(known->publisher, 2U);
}

TEST(Mailbox, CountsComplaintsItDidNotKeep) {
  Mailbox mailbox;
  for (int i = 0; i < 300; ++i) mailbox.complain("line " + std::to_string(i));
  const auto lines = mailbox.take_complaints();
  ASSERT_EQ(lines.size(), 257U);
  EXPECT_EQ(lines.back(), "44 more complaints were not kept");
  EXPECT_TRUE(mailbox.take_complaints().empty());
}

TEST(Mailbox, SaysALineOnceInAWhile) {
  Mailbox mailbox;
  for (int i = 0; i < 300; ++i) mailbox.complain("line");
  EXPECT_EQ(mailbox.take_complaints(), std::vector<std::string>{"line"});
  mailbox.complain("line");
  mailbox.complain("another");
  EXPECT_EQ(mailbox.take_complaints(), std::vector<std::string>{"another"});
}

TEST(Mailbox, SaysALineAgainWhenItGoesOn) {
  Mailbox mailbox(0);
  mailbox.complain("line");
  EXPECT_EQ(mailbox.take_complaints(), std::vector<std::string>{"line"});
  mailbox.complain("line");
  EXPECT_EQ(mailbox.take_complaints(), std::vector<std::string>{"line"});
}

TEST(Mailbox, LinesThatAllDifferFillNoLog) {
  Mailbox mailbox;
  std::size_t taken = 0;
  for (int i = 0; i < 10'000; ++i) {
    mailbox.complain("line " + std::to_string(i));
    taken += mailbox.take_complaints().size();
  }
  EXPECT_LE(taken, 258U);
}

TEST(Mailbox, LinesAreShortAndPrintable) {
  Mailbox mailbox;
  mailbox.complain("type \x1b[2J\n\xff" + std::string(1000, 'x'));
  const auto lines = mailbox.take_complaints();
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0].substr(0, 12), "type ?[2J??x");
  EXPECT_EQ(lines[0].size(), 512U);
}

}  // namespace
}  // namespace nearmesh::wire
