// SPDX-License-Identifier: Apache-2.0
#include "subscriber/peer/content_choice.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber {
namespace {

using wire::Offer;

constexpr ContentHash kA{0, 0xa}, kB{0, 0xb}, kC{1, 0}, kNone;

TEST(StandingContents, AreThoseThatNobodyReplaces) {
  using Contents = std::vector<ContentHash>;
  const auto standing = [](std::vector<Offer> offers) { return wire::standing(offers); };
  EXPECT_EQ(standing({}), Contents{});
  EXPECT_EQ(standing({{1, kB}, {2, kA}, {3, kB}}), (Contents{kA, kB}));
  EXPECT_EQ(standing({{1, kA}, {2, kB, kA}}), Contents{kB});
  EXPECT_EQ(standing({{1, kA}, {2, kB, kA}, {3, kC, kB}}), Contents{kC});
  EXPECT_EQ(standing({{1, kA}, {2, kB, kC}}), (Contents{kA, kB}));
  EXPECT_EQ(standing({{1, kA, kB}, {2, kB, kA}}), (Contents{kA, kB}));  // a circle
  EXPECT_EQ(standing({{1, kA, kA}}), Contents{kA});
}

struct Case {
  const char* name;
  KnownContent known;
  std::vector<Offer> offers;
  ContentHash content;
  bool changes, conflicts;
};

class ChooseContent : public testing::TestWithParam<Case> {};

TEST_P(ChooseContent, AsSaid) {
  const Case& given = GetParam();
  const ContentChoice choice = choose_content(given.known, given.offers, 0);
  EXPECT_EQ(choice.content, given.content);
  EXPECT_EQ(choice.change.empty(), !given.changes) << choice.change;
  EXPECT_EQ(choice.conflict.empty(), !given.conflicts) << choice.conflict;
}

const KnownContent kNothing{}, kHoldsA{.held = kA}, kPinsA{.pinned = kA}, kPinsAHoldsB{kA, kB, {}};

INSTANTIATE_TEST_SUITE_P(
    Contents, ChooseContent,
    testing::Values(
        Case{"NobodyServes", kNothing, {}, kNone, false, false},
        Case{"OneServes", kNothing, {{1, kA}}, kA, false, false},
        Case{"TwoServeTheSame", kNothing, {{1, kA}, {2, kA}}, kA, false, false},
        Case{"TwoDisagree", kNothing, {{1, kA}, {2, kB}}, kNone, false, true},
        Case{"OneReplacesTheOther", kNothing, {{1, kA}, {2, kB, kA}}, kB, false, false},
        Case{"EachReplacesTheOther", kNothing, {{1, kA, kB}, {2, kB, kA}}, kNone, false, true},
        Case{"HeldAndServed", kHoldsA, {{1, kA}}, kA, false, false},
        Case{"HeldAndNobodyThere", kHoldsA, {}, kA, false, false},
        Case{"HeldWithRival", kHoldsA, {{1, kB}, {2, kA}}, kA, false, true},
        Case{"HeldWithTwoRivals", kHoldsA, {{1, kB}, {2, kA}, {3, kC}}, kA, false, true},
        Case{"HeldAndReplaced", kHoldsA, {{1, kA}, {2, kB, kA}}, kB, true, false},
        Case{"HeldAndReplacedTwice", kHoldsA, {{2, kB, kA}, {3, kC, kB}}, kC, true, false},
        Case{"HeldAndReplacedByTwo", kHoldsA, {{1, kA}, {2, kB, kA}, {3, kC, kA}}, kA, false, true},
        Case{"HeldInACircle", kHoldsA, {{1, kA, kB}, {2, kB, kA}}, kA, false, true},
        Case{"HeldReplacedBesideARival", kHoldsA, {{1, kC}, {2, kB, kA}}, kB, true, true},
        Case{"HeldAndItsPublisherGone", kHoldsA, {{1, kB}}, kB, true, false},
        Case{"HeldGoneAndTwoDisagree", kHoldsA, {{1, kB}, {2, kC}}, kA, false, true},
        Case{"PinnedAndServed", kPinsA, {{1, kA}}, kA, false, false},
        Case{"PinnedAndAnotherServed", kPinsA, {{1, kB}}, kA, false, true},
        Case{"PinnedAndReplaced", kPinsA, {{1, kA}, {2, kB, kA}}, kA, false, true},
        Case{"PinnedReplacesAnother", kPinsA, {{1, kB}, {2, kA, kB}}, kA, false, false},
        Case{"PinnedThoughAnotherIsHeld", kPinsAHoldsB, {{1, kA}, {2, kB}}, kA, false, true}),
    [](const auto& tested) { return std::string(tested.param.name); });

// ---- epochs -------------------------------------------------------------------------------------

constexpr wire::Epoch kFirstEpoch{1, 10}, kSecondEpoch{2, 20};

Offer offer(wire::SessionId publisher, const ContentHash& content, const wire::Epoch& epoch = {},
            const ContentHash& replaces = {}) {
  Offer made{.publisher = publisher, .content = content, .replaces = replaces};
  made.epoch = epoch;
  return made;
}

// Whoever comes when, and whatever it held: at one time of the exercise all stand by one content.
TEST(Epochs, BeginForAllAtOneTimeWhateverTheyHeld) {
  const std::vector<Offer> offers = {offer(1, kA), offer(2, kB, kFirstEpoch, kA),
                                     offer(3, kC, kSecondEpoch, kB)};
  const auto at = [&](const KnownContent& known, double time_s) {
    const ContentChoice choice = choose_content(known, offers, time_s);
    EXPECT_EQ(choice.conflict, "");
    return choice;
  };
  const struct {
    double time_s;
    ContentHash content, coming;
    std::uint32_t epoch;
  } kTruth[] = {{-5, kA, kB, 0},    {9.99, kA, kB, 0},  {10, kB, kC, 1},
                {19.99, kB, kC, 1}, {20, kC, kNone, 2}, {1e6, kC, kNone, 2}};
  const KnownContent kAll[] = {
      {}, {.held = kA}, {.held = kB, .epoch = kFirstEpoch}, {.held = kC, .epoch = kSecondEpoch}};
  for (const auto& truth : kTruth)
    for (const KnownContent& known : kAll) {
      const ContentChoice choice = at(known, truth.time_s);
      EXPECT_EQ(choice.content, truth.content) << truth.time_s;
      EXPECT_EQ(choice.coming, truth.coming) << truth.time_s;
      EXPECT_EQ(choice.epoch.number, truth.epoch) << truth.time_s;
      EXPECT_EQ(choice.change.empty(), !known.held.is_set() || known.held == truth.content);
    }
}

TEST(Epochs, BeforeItBeginsAComingContentIsNotTaken) {
  const std::vector<Offer> offers = {offer(2, kB, kFirstEpoch, kA)};
  EXPECT_EQ(choose_content({}, offers, 9).content, kNone);
  EXPECT_EQ(choose_content({.held = kA}, offers, 9).content, kA);
  EXPECT_EQ(choose_content({.held = kA}, offers, 10).content, kB);
}

TEST(Epochs, ThoseBeforeDoNotComeBackWhenTheLastPublisherGoes) {
  const std::vector<Offer> offers = {offer(1, kA)};
  const KnownContent holds_b{.held = kB, .epoch = kFirstEpoch};
  const ContentChoice choice = choose_content(holds_b, offers, 15);
  EXPECT_EQ(choice.content, kB);
  EXPECT_EQ(choice.epoch, kFirstEpoch);
  EXPECT_EQ(choose_content(holds_b, offers, 5).content, kA);  // the clock went back
}

TEST(Epochs, OneThatTwoDisagreeAboutIsNotTaken) {
  const std::vector<Offer> offers = {offer(1, kA), offer(2, kB, kFirstEpoch),
                                     offer(3, kC, kFirstEpoch)};
  EXPECT_EQ(choose_content({.held = kA}, offers, 9).coming, kNone);
  const ContentChoice choice = choose_content({.held = kA}, offers, 10);
  EXPECT_EQ(choice.content, kA);
  EXPECT_NE(choice.conflict, "");
}

TEST(Epochs, APinIsStronger) {
  const std::vector<Offer> offers = {offer(1, kA), offer(2, kB, kFirstEpoch, kA)};
  for (const double time_s : {0, 10}) {
    EXPECT_EQ(choose_content({.pinned = kA}, offers, time_s).content, kA);
    EXPECT_EQ(choose_content({.pinned = kA}, offers, time_s).coming, kNone);
  }
}

}  // namespace
}  // namespace nearmesh::subscriber
