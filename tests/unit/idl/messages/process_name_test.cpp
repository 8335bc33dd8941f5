// SPDX-License-Identifier: Apache-2.0
#include "idl/messages/process_name.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

namespace nearmesh::wire {
namespace {

TEST(ProcessName, TakesWhatPeopleWrite) {
  for (const std::string& name : {std::string("rig-2"), std::string("Cockpit 1, left (spare)"),
                                  std::string(kMaxNameBytes, 'x'), std::string("x")})
    EXPECT_TRUE(check_process_name(name).is_ok()) << check_process_name(name).message();
}

TEST(ProcessName, RefusesTheRestAndSaysWhy) {
  for (const auto& [name, expected] : std::vector<std::pair<std::string, std::string>>{
           {"", "found none"},
           {std::string(kMaxNameBytes + 1, 'x'), "found 64 bytes"},
           {"two\nlines", "found byte 0x0a at place 4"},
           {std::string("a\0b", 3), "found byte 0x00 at place 2"},
           {"\x1b[2J", "found byte 0x1b at place 1"},
           {"m\xc3\xa9tro", "found byte 0xc3 at place 2"},
           {"\xff\xfe", "found byte 0xff at place 1"},
           {" rig", "found a blank at an end"},
           {"rig ", "found a blank at an end"}}) {
    const Status status = check_process_name(name);
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(status.message(), "expected 1 to 63 bytes of printable ASCII, " + expected);
  }
}

TEST(ProcessName, IsHostAndProcessWhereNobodyGaveOne) {
  const std::string name = default_process_name();
  EXPECT_TRUE(check_process_name(name).is_ok()) << name;
  EXPECT_TRUE(name.ends_with("/" + std::to_string(::getpid()))) << name;
  EXPECT_EQ(name_of_process(""), name);
  EXPECT_EQ(name_of_process("rig-2"), "rig-2");
}

TEST(ProcessName, IsAnnouncedWithHostAndProcess) {
  const std::string where = default_process_name();
  EXPECT_EQ(announced_name(""), where);
  EXPECT_EQ(announced_name("rig-2"), "rig-2 on " + where);
  const std::string longest(kMaxNameBytes, 'x');
  EXPECT_EQ(shown_participant(announced_name(longest)), longest + " on " + where);
  EXPECT_EQ(shown_participant(std::string(1000, 'x') + "\n").size(), 2 * kMaxNameBytes + 4);
}

TEST(ProcessName, AStrangersNameCanBeShown) {
  EXPECT_EQ(shown_name("rig-2"), "rig-2");
  EXPECT_EQ(shown_name(""), "");
  EXPECT_EQ(shown_name("   "), "");
  EXPECT_EQ(shown_name(" \x1b[2Jrig\n\xc3\xa9 "), "?[2Jrig???");
  EXPECT_EQ(shown_name(std::string(1000, 'x')), std::string(kMaxNameBytes, 'x'));
  for (int c = 0; c < 256; ++c) {
    const std::string shown = shown_name(std::string(3, static_cast<char>(c)));
    EXPECT_TRUE(shown.empty() || check_process_name(shown).is_ok()) << c;
  }
}

TEST(ProcessName, StandsBesideTheNumber) {
  EXPECT_EQ(called(0xe3a90c5b11d8a7f0, "rig-2"), "e3a90c5b11d8a7f0 (rig-2)");
  EXPECT_EQ(called(0xe3a90c5b11d8a7f0, ""), "e3a90c5b11d8a7f0");
}

}  // namespace
}  // namespace nearmesh::wire
