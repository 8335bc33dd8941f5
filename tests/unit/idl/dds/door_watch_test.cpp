// SPDX-License-Identifier: Apache-2.0
// What the door's watch says to whom.

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "idl/dds/door_watch.hpp"
#include "idl/security/identity_book.hpp"
#include "idl/security/security.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/rtps_message.hpp"

namespace nearmesh::wire {
namespace {

// A participant hears others before its mailbox is there: while it is being made.
TEST(DoorWatch, SaysAlsoWhatItHeardBeforeAnybodyListened) {
  const nearmesh::test::Folder folder;
  SecurityPlan plan;
  plan.prefix = "rig";
  plan.identities = {{"one", Role::kSubscriber}};
  ASSERT_TRUE(make_security(folder.file("set"), plan).is_ok());
  const std::string at = folder.file("set/one/");
  auto book = IdentityBook::open({at + "identity_ca.cert.pem", at + "cert.pem", ""});
  ASSERT_TRUE(book.is_ok()) << book.status().message();
  DoorWatch watch({.is_plain = true, .identity_period_s = 5}, std::move(book).value());

  nearmesh::test::Rtps m(nearmesh::test::key_of(1));
  m.begin_announcement().lease(20).secured("rig/other");
  m.product(0x00020107).finish_announcement();  // of a release that is none of ours
  const auto hear = [&] { EXPECT_FALSE(watch.check(m.bytes, {true, 40'000}).refusal); };

  hear();
  Mailbox mailbox;
  watch.set_mailbox(&mailbox);
  hear();
  hear();
  const std::vector<std::string> said = mailbox.take_complaints();
  ASSERT_EQ(said.size(), 1U) << "once";
  EXPECT_NE(said[0].find("rig/other is secured by a Fast DDS 7"), std::string::npos) << said[0];
  watch.set_mailbox(nullptr);
}

}  // namespace
}  // namespace nearmesh::wire
