// SPDX-License-Identifier: Apache-2.0
// What a solver gets of a session: contacts that keep their numbers from update to update, and how
// deep bodies are in each other.

#include <limits>
#include <set>

#include "local_host.hpp"
#include "subscriber/peer/contact_book.hpp"

namespace nearmesh::test {
namespace {

using subscriber::ContactBook;
using subscriber::ContactChange;
using subscriber::ContactEvent;

constexpr double kNever_s = std::numeric_limits<double>::infinity();

// ---- the book alone -----------------------------------------------------------------------------

FacePair faces(std::uint32_t a, std::uint32_t b) { return {{{}, a}, {{}, b}}; }

/// Patches of one point each, world frame.
struct PatchAt {
  std::array<double, 3> at_m;
  std::vector<FacePair> pairs;
};
Contacts contacts_of(const std::vector<PatchAt>& patches) {
  Contacts contacts;
  for (const PatchAt& patch : patches) {
    ContactPatch& made = contacts.patches.emplace_back();
    made.first = static_cast<std::uint32_t>(contacts.segments.size());
    made.count = static_cast<std::uint32_t>(patch.pairs.size());
    made.centroid_m = patch.at_m;
    for (const FacePair& pair : patch.pairs)
      contacts.segments.push_back({patch.at_m, patch.at_m, pair});
  }
  return contacts;
}

class Book {
 public:
  /// What is told: one letter and the number for each event, e.g. "b1 p2".
  std::string follow(const std::vector<PatchAt>& patches, bool is_all, const Pose& pose_b = {}) {
    const Contacts contacts = contacts_of(patches);
    std::vector<ContactEvent> events;
    book_.follow(
        {.contacts = patches.empty() ? nullptr : &contacts, .is_all = is_all, .pose_b = pose_b},
        next_, ids, events);
    std::string told;
    for (const ContactEvent& event : events) {
      told += (told.empty() ? "" : " ") + std::string(to_string(event.change)).substr(0, 1) +
              std::to_string(event.id);
      if (event.change == ContactChange::kBegin || event.change == ContactChange::kPersist) {
        EXPECT_EQ(ids.at(event.patch), event.id);
      }
    }
    return told;
  }
  std::vector<std::uint64_t> ids;

 private:
  ContactBook book_;
  std::uint64_t next_ = 1;
};

TEST(ContactBook, PairsOfFacesTellWhichIsWhich) {
  Book book;
  EXPECT_EQ(
      book.follow({{{0, 0, 0}, {faces(1, 1)}}, {{9, 0, 0}, {faces(2, 2), faces(2, 3)}}}, true),
      "b1 b2");
  // In another order, in each other's places.
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(2, 3)}}, {{9, 0, 0}, {faces(1, 1)}}}, true), "p2 p1");
  EXPECT_EQ(book.ids, (std::vector<std::uint64_t>{2, 1}));
}

TEST(ContactBook, AFaceOfEitherBodyTellsWhereNoPairIsTheSame) {
  Book book;
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(1, 1)}}, {{9, 0, 0}, {faces(2, 2)}}}, true), "b1 b2");
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(5, 2)}}, {{9, 0, 0}, {faces(1, 6)}}}, true), "p2 p1");
}

TEST(ContactBook, PlacesTellWhereNoFaceIsTheSame) {
  Book book;
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(1, 1)}}, {{9, 0, 0}, {faces(2, 2)}}}, true), "b1 b2");
  // B has moved by 0.5; so may a contact. One farther off is another.
  const Pose moved{.translation_m = {0.5, 0, 0}};
  EXPECT_EQ(book.follow({{{9.4, 0, 0}, {faces(3, 3)}}, {{0, 0.9, 0}, {faces(4, 4)}}}, true, moved),
            "p2 b3 e1");
}

TEST(ContactBook, OfTwoPartsTheGreaterGoesOnAndTheOtherIsNew) {
  Book book;
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(1, 1), faces(1, 2), faces(1, 3)}}}, true), "b1");
  EXPECT_EQ(
      book.follow({{{0, 0, 0}, {faces(1, 1)}}, {{1, 0, 0}, {faces(1, 2), faces(1, 3)}}}, true),
      "b2 p1");
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(1, 1), faces(1, 2), faces(1, 3)}}}, true), "p1 e2");
}

TEST(ContactBook, WhatIsNotFoundIsOverOnlyWhenThatIsCertified) {
  Book book;
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(1, 1)}}, {{9, 0, 0}, {faces(2, 2)}}}, true), "b1 b2");
  EXPECT_EQ(book.follow({{{9, 0, 0}, {faces(2, 2)}}}, false), "p2 u1");
  EXPECT_EQ(book.follow({}, false), "u2 u1");
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(1, 1)}}}, false), "p1 u2");
  EXPECT_EQ(book.follow({}, true), "e1 e2");
  EXPECT_EQ(book.follow({}, true), "");
  EXPECT_EQ(book.follow({{{0, 0, 0}, {faces(1, 1)}}}, true), "b3");
}

// ---- in a session -------------------------------------------------------------------------------

/// Events of one update, and what must be so in each.
void check_events(const FrameReport& report) {
  std::set<std::uint64_t> ids;
  std::size_t patches = 0, found = 0;
  for (const PairAnswer& answer : report.answers) {
    EXPECT_EQ(answer.contact_ids.size(), answer.contacts ? answer.contacts->patches.size() : 0U);
    patches += answer.contact_ids.size();
  }
  for (const ContactEvent& event : report.contact_events) {
    EXPECT_TRUE(ids.insert(event.id).second);
    const PairAnswer* answer = report.find(event.a, event.b);
    if (event.change == ContactChange::kEnd) {
      EXPECT_TRUE(answer == nullptr || is_certified(answer->answer.status));
    } else {
      ASSERT_NE(answer, nullptr);
      EXPECT_EQ(answer->a, event.a);
    }
    if (event.change != ContactChange::kBegin && event.change != ContactChange::kPersist) continue;
    EXPECT_EQ(answer->contact_ids.at(event.patch), event.id);
    ++found;
  }
  EXPECT_EQ(found, patches);
}

std::size_t count(const FrameReport& report, ContactChange change) {
  return static_cast<std::size_t>(
      std::count_if(report.contact_events.begin(), report.contact_events.end(),
                    [change](const ContactEvent& event) { return event.change == change; }));
}

TEST(SessionContacts, AContactKeepsItsNumberWhileABodySlidesAndEndsWhenItIsCertifiedFree) {
  LocalHost host({.contacts = true});
  const BodyId one = host.spawn("one");
  Motion motion = above_ground(300, 1);
  ASSERT_GT(host.settle({{one, motion}}), 0);
  std::set<std::uint64_t> first_ids;
  std::size_t begun = 0, persisted = 0;
  for (int i = 0; i < 40; ++i) {
    motion.pose.translation_m[0] += 0.1;
    ASSERT_GT(host.settle({{one, motion}}), 0);
    const FrameReport report = host.update();
    check_events(report);
    begun += count(report, ContactChange::kBegin);
    persisted += count(report, ContactChange::kPersist);
    for (const ContactEvent& event : report.contact_events) first_ids.insert(event.id);
  }
  EXPECT_GT(persisted, 35U);
  EXPECT_EQ(begun, 0U);  // in each second update of a place nothing is new
  // A few patches, over 40 places: without a number that stays there would be some a place.
  EXPECT_LT(first_ids.size(), 20U);
  EXPECT_GT(first_ids.size(), 0U);

  motion.pose.translation_m[2] += 300;
  std::size_t ended = 0;
  for (int i = 0; i < 20 && ended == 0; ++i) {
    const FrameReport report = host.update({{one, motion}});
    check_events(report);
    ended = count(report, ContactChange::kEnd);
    EXPECT_TRUE(ended == 0 || report.find(kGround, one)->answer.status == AnswerStatus::kFree);
  }
  EXPECT_GT(ended, 0U);
  EXPECT_TRUE(host.update().contact_events.empty());

  motion.pose.translation_m[2] -= 300;
  ASSERT_GT(host.settle({{one, motion}}), 0);
  for (const ContactEvent& event : host.update().contact_events)
    EXPECT_FALSE(first_ids.contains(event.id));
}

TEST(SessionContacts, WhoIsPutOffKeepsItsContactsUnconfirmed) {
  LocalHost host({.contacts = true});
  const BodyId one = host.spawn("one"), two = host.spawn("two");
  Motion at_one = above_ground(300, 1), at_two = above_ground(900, 1);
  // Who lies still is not put off.
  at_one.linear_velocity_mps[2] = at_two.linear_velocity_mps[2] = 1e-3;
  ASSERT_GT(host.settle({{one, at_one}, {two, at_two}}), 0);
  const std::size_t all = host.update().contact_events.size();
  ASSERT_GE(all, 2U);
  std::set<std::uint64_t> unconfirmed, persisted;
  for (int i = 0; i < 12; ++i) {
    const Result<FrameReport> report =
        host.session->update(1000 + static_cast<std::uint64_t>(i), 0, {}, 0);
    ASSERT_TRUE(report.is_ok());
    check_events(report.value());
    EXPECT_EQ(report.value().contact_events.size(), all);
    EXPECT_EQ(count(report.value(), ContactChange::kEnd), 0U);
    for (const ContactEvent& event : report.value().contact_events)
      (event.change == ContactChange::kUnconfirmed ? unconfirmed : persisted).insert(event.id);
  }
  EXPECT_EQ(unconfirmed, persisted);  // they take turns
}

TEST(SessionContacts, OfBodiesThatBoundsProveApartTheyEnd) {
  LocalHost host({.lookahead_s = 0.2, .contacts = true});
  host.session->watch_all();
  const BodyId one =
      host.session->add_body({.name = "one", .model = "aircraft", .own = true}).value();
  ASSERT_GT(host.settle({{one, above_ground(300, 1)}}), 0);
  const std::size_t all = host.update().contact_events.size();
  ASSERT_GT(all, 0U);
  const FrameReport away = host.update({{one, above_ground(300, 5000)}});
  EXPECT_EQ(away.find(kGround, one), nullptr);
  EXPECT_EQ(count(away, ContactChange::kEnd), all);
}

TEST(SessionContacts, OfBodiesThatAreWatchedNoMoreNothingIsSaid) {
  LocalHost host({.lookahead_s = 0.2, .contacts = true});
  host.session->watch_all();
  const BodyId one =
      host.session->add_body({.name = "one", .model = "aircraft", .own = true}).value();
  ASSERT_GT(host.settle({{one, above_ground(300, 1)}}), 0);
  ASSERT_FALSE(host.update().contact_events.empty());
  // Where it is, and touching as before: but of scenery no pairs are watched.
  ASSERT_TRUE(host.session->place_body(one, above_ground(300, 1).pose).is_ok());
  for (int i = 0; i < 3; ++i) {
    const FrameReport report = host.update();
    EXPECT_EQ(report.find(kGround, one), nullptr);
    EXPECT_TRUE(report.contact_events.empty());
  }
}

TEST(SessionContacts, OfAPairThatIsWatchedTheOtherWayRoundNoneEnds) {
  LocalHost host({.lookahead_s = 0.2, .contacts = true});
  host.session->watch_all();
  const BodyId one =
      host.session->add_body({.name = "one", .model = "aircraft", .own = true}).value();
  ASSERT_GT(host.settle({{one, above_ground(300, 1)}}), 0);
  ASSERT_FALSE(host.update().contact_events.empty());
  ASSERT_TRUE(host.session->watch(one, kGround).is_ok());
  const FrameReport report = host.update();
  ASSERT_NE(report.find(kGround, one), nullptr);
  EXPECT_EQ(report.find(kGround, one)->a, one);
  EXPECT_GT(count(report, ContactChange::kBegin), 0U);
  EXPECT_EQ(count(report, ContactChange::kEnd), 0U);
}

TEST(SessionContacts, OfABodyThatIsUnknownTheyAreUnconfirmed) {
  LocalHost host({.max_pose_age_s = 2, .lookahead_s = 0.2, .contacts = true});
  host.session->watch_all();
  const BodyId other = host.session->add_body({.name = "one", .model = "aircraft"}).value();
  const std::vector<Session::HeardPose> heard{{other, 0, above_ground(300, 1)}};
  ASSERT_TRUE(host.session->hear(heard).is_ok());
  ASSERT_GT(host.settle(), 0);
  const std::size_t all = host.update().contact_events.size();
  ASSERT_GT(all, 0U);
  // Nobody says for ten seconds where it is.
  const FrameReport silent = host.session->update(100, 10, {}, kNever_s).value();
  EXPECT_EQ(count(silent, ContactChange::kUnconfirmed), all);
  EXPECT_EQ(silent.contact_events.size(), all);
  ASSERT_NE(silent.find(kGround, other), nullptr);
  EXPECT_NE(silent.find(kGround, other)->reason, "");
}

TEST(SessionContacts, OfAReplacedModelTheyEnd) {
  LocalHost host({.contacts = true});
  const BodyId one = host.spawn("one");
  ASSERT_GT(host.settle({{one, above_ground(300, 1)}}), 0);
  std::set<std::uint64_t> before, ended;
  for (const ContactEvent& event : host.update().contact_events) before.insert(event.id);
  ASSERT_FALSE(before.empty());
  ASSERT_TRUE(host.session->replace_model(one, "terrain").is_ok());
  for (int i = 0; i < 20 && ended.empty(); ++i)
    for (const ContactEvent& event :
         host.session->update(100 + static_cast<std::uint64_t>(i), 0, {}, kNever_s)
             .value()
             .contact_events)
      if (event.change == ContactChange::kEnd) ended.insert(event.id);
  EXPECT_EQ(ended, before);
}

// ---- depth --------------------------------------------------------------------------------------

TEST(SessionDepth, IsBracketedTighterAsDetailComesAndLeadsOut) {
  LocalHost host({.depth = true});
  const BodyId one = host.spawn("one");
  Motion motion = above_ground(300, 0.3);
  ASSERT_GT(host.settle({{one, motion}}), 0);
  const auto depth_of = [&](const FrameReport& report) {
    const PairAnswer* pair = report.find(kGround, one);
    EXPECT_TRUE(pair != nullptr && pair->depth && pair->contacts);
    return *pair->depth;
  };
  FrameReport report = host.update();
  for (int i = 0; i < 30; ++i) report = host.update();
  const Depth depth = depth_of(report);
  ASSERT_LT(depth.at_most_m, kNever_s);
  EXPECT_GT(depth.at_least_m, 0);
  EXPECT_TRUE(depth.missing_a.empty() && depth.missing_b.empty());  // it was asked for
  EXPECT_FALSE(depth.exhausted);
  EXPECT_LT(depth.at_most_m - depth.at_least_m, 0.02 * depth.at_most_m + 0.01);
  for (std::size_t k = 0; k < 3; ++k) motion.pose.translation_m[k] += depth.separation_m[k];
  ASSERT_GT(host.settle({{one, motion}}), 0);
  const FrameReport out = host.update();
  EXPECT_EQ(out.find(kGround, one)->answer.status, AnswerStatus::kFree);
  EXPECT_FALSE(out.find(kGround, one)->depth);
}

}  // namespace
}  // namespace nearmesh::test
