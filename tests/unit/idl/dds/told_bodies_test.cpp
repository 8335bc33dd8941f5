// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/told_bodies.hpp"

#include <gtest/gtest.h>

namespace nearmesh::wire {
namespace {

ToldBodies told(const BodyNames& bodies) {
  return told_bodies_in(user_data_of(bodies).value()).value();
}

TEST(ToldBodies, ArriveAsTheyWereTold) {
  const ToldBodies both = told({{"terrain", "blue", "blue"}, {"red"}});
  EXPECT_EQ(both.moved, body_hashes({"red"}));
  EXPECT_EQ(both.named, body_hashes({"terrain", "red", "blue"})) << "what is moved is named, too";
  const ToldBodies none = told({});
  EXPECT_TRUE(none.named.empty() && none.moved.empty());
}

TEST(ToldBodies, StrangersAreThoseOfWhomNeitherNamesABodyOfTheOther) {
  const ToldBodies red = told({{"terrain", "blue"}, {"red"}}), blue = told({{"terrain"}, {"blue"}}),
                   green = told({{"terrain", "green"}, {"green"}}),
                   also_green = told({{}, {"green"}}), looks = told({{"terrain", "green"}, {}});
  const auto strange = [](const ToldBodies& one, const ToldBodies& other) {
    EXPECT_EQ(are_strangers(one, other), are_strangers(other, one));
    return are_strangers(one, other);
  };
  EXPECT_FALSE(strange(red, blue)) << "one of them names the other's";
  EXPECT_TRUE(strange(red, green)) << "what both name is moved by neither";
  EXPECT_FALSE(strange(green, also_green)) << "two that move one body shall hear of it";
  EXPECT_FALSE(strange(looks, green));
  EXPECT_TRUE(strange(looks, red));
  EXPECT_TRUE(strange(looks, looks)) << "neither has anything to say";
  EXPECT_TRUE(strange(told({}), red));
}

TEST(ToldBodies, WhatIsNotUnderstoodTellsNothing) {
  const std::vector<std::uint8_t> data = user_data_of({{"terrain"}, {"red", "blue"}}).value();
  ASSERT_TRUE(told_bodies_in(data));
  for (std::size_t size = 0; size < data.size(); ++size)
    EXPECT_EQ(told_bodies_in(std::span(data).first(size)).has_value(), size >= 8 && size % 4 == 0)
        << size;
  std::vector<std::uint8_t> foreign = data, unsorted = data, twice = data, many = data;
  foreign[0] = 'x';
  EXPECT_FALSE(told_bodies_in(foreign)) << "a host's own user data";
  std::swap_ranges(unsorted.begin() + 8, unsorted.begin() + 12, unsorted.begin() + 12);
  EXPECT_FALSE(told_bodies_in(unsorted));
  std::copy_n(twice.begin() + 8, 4, twice.begin() + 12);
  EXPECT_FALSE(told_bodies_in(twice));
  many.resize(8);
  for (std::uint8_t i = 1; i <= kMaxToldBodies + 1; ++i) many.insert(many.end(), {0, 0, 0, i});
  EXPECT_FALSE(told_bodies_in(many));
  many.resize(many.size() - 4);
  EXPECT_TRUE(told_bodies_in(many));
}

TEST(ToldBodies, MoreThanFitAreNotTold) {
  std::vector<std::string> names;
  while (names.size() < kMaxToldBodies) names.push_back(std::to_string(names.size()));
  EXPECT_TRUE(user_data_of({names, names}));
  EXPECT_FALSE(user_data_of({names, {"red"}}));
}

}  // namespace
}  // namespace nearmesh::wire
