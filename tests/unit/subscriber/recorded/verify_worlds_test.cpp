// SPDX-License-Identifier: Apache-2.0
// Sessions with worlds are recorded and proved; so is what follows after tiles and detail were
// given up. What was forged is found out, and what is not in the recording is never called proved.

#include <algorithm>
#include <filesystem>
#include <functional>
#include <set>

#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "subscriber/recorded/verify.hpp"
#include "tests/support/cut_world.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/kept_channel.hpp"

namespace nearmesh {
namespace {

using namespace test;
using subscriber::BodyId;
using subscriber::DetailFolder;
using subscriber::Session;
using subscriber::SessionOptions;
using subscriber::VerifyReport;

class VerifyWorlds : public ::testing::Test {
 protected:
  struct Plan {
    SessionOptions options{};
    int scenes = 30;
    int rounds = 10;       ///< updates of each, at most
    double between_s = 0;  ///< of the exercise's time, from scene to scene
    bool is_world_first = false;
    int recorder_in = -1;  ///< one comes in that scene; -1: it was there, and was not told
    double budget_s = 10;
    double crowd_m = 0;  ///< scenes lie so near to each other
  };
  /// A ball near seams and corners of the world, from one publisher. What a recorder hears.
  KeptSamples record(const Plan& plan) {
    KeptSamples kept;
    auto local = std::make_unique<subscriber::LocalChannel>();
    EXPECT_TRUE(local->add_world("valley", terrain_.folder).is_ok());
    EXPECT_TRUE(local->add_model("ball", ModelFile::open(ball_->path()).value()).is_ok());
    auto made = std::make_unique<KeptChannel>(std::move(local), kept);
    KeptChannel& channel = *made;
    Session session(std::move(made), plan.options);
    const BodyId world = session.add_body({.name = "ground", .model = "valley"}).value();
    const BodyId ball = session.add_body({.name = "ball", .model = "ball", .own = true}).value();
    EXPECT_TRUE(
        (plan.is_world_first ? session.watch(world, ball) : session.watch(ball, world)).is_ok());
    Random random(11);
    std::uint64_t frame = 0;
    double time_s = 0;
    for (int i = 0; i < plan.scenes; ++i, time_s += plan.between_s) {
      if (i == plan.recorder_in) {
        channel.recorder_comes = true;
        came_at_ = kept.size();
      }
      const CutScene scene = random_scene(terrain_, random, i % 3);
      EXPECT_TRUE(session.place_body(world, scene.world).is_ok());
      for (int round = 0; round < plan.rounds; ++round) {
        const auto report = session.update(frame++, time_s, {{ball, scene.ball}}, plan.budget_s);
        EXPECT_TRUE(report.is_ok()) << report.status().message();
        for (const std::string& line : report.value().complaints) ADD_FAILURE() << line;
        if (report.value().all_certified()) break;
      }
    }
    return kept;
  }
  VerifyReport verify(const KeptSamples& samples, DetailFolder* models = nullptr) {
    const std::string path = folder_ + "/" + std::to_string(++files_) + ".db3";
    write_samples(samples, path);
    const auto recording = RecordingReader::open(path);
    EXPECT_TRUE(recording.is_ok());
    Result<VerifyReport> report = subscriber::verify(*recording.value(), {.models = models});
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    const VerifyReport& r = report.value();
    EXPECT_EQ(
        r.verified + r.different + r.not_asked + r.put_off + r.lacking + r.gave_up + r.malformed,
        r.reports);
    return std::move(report).value();
  }
  static std::string first_of(const VerifyReport& report) {
    return report.differences.empty() ? std::string() : report.differences.front().what;
  }
  /// The folder with the world and the ball's file.
  std::unique_ptr<DetailFolder> files(bool with_world = true) {
    const std::string path = folder_ + "/files" + std::to_string(++files_);
    std::filesystem::create_directory(path);
    std::filesystem::copy_file(ball_->path(), path + "/ball.spm");
    if (with_world)
      std::filesystem::copy(terrain_.folder, path + "/valley",
                            std::filesystem::copy_options::recursive);
    auto opened = DetailFolder::open(path);
    EXPECT_TRUE(opened.is_ok()) << opened.status().message();
    EXPECT_TRUE(opened.value()->complaints().empty());
    return std::move(opened).value();
  }
  static std::size_t count(const KeptSamples& samples,
                           const std::function<bool(const wire::ContactReport&)>& which) {
    return static_cast<std::size_t>(
        std::count_if(samples.begin(), samples.end(), [&](const KeptSample& sample) {
          const auto* report = sample.as<wire::ContactReport>();
          return report != nullptr && which(*report);
        }));
  }
  static std::size_t answers(const KeptSamples& samples) {
    return count(samples, [](const auto& report) { return report.asked; });
  }
  /// What verify says when the first such report is changed.
  VerifyReport spoilt(const KeptSamples& samples,
                      const std::function<bool(const wire::ContactReport&)>& which,
                      const std::function<void(wire::ContactReport&)>& spoil) {
    KeptSamples changed = samples;
    for (KeptSample& sample : changed) {
      auto* report = sample.as<wire::ContactReport>();
      if (report == nullptr || !which(*report)) continue;
      spoil(*report);
      return verify(changed);
    }
    ADD_FAILURE() << "no such report";
    return {};
  }

  const CutTerrain terrain_;
  const std::unique_ptr<TempFile> ball_ = write_model(cut_ball());
  const test::Folder scratch_;
  const std::string folder_ = scratch_.path();
  std::size_t came_at_ = 0;  ///< the recorder
  int files_ = 0;
};

bool is_of(const wire::ContactReport& report, AnswerStatus status) {
  return report.asked && report.status == static_cast<std::uint8_t>(status);
}

TEST_F(VerifyWorlds, EveryAnswerComesOutAgain) {
  for (const bool is_world_first : {false, true}) {
    const KeptSamples kept = record({.is_world_first = is_world_first});
    const VerifyReport found = verify(kept);
    EXPECT_EQ(found.different, 0U) << first_of(found);
    EXPECT_EQ(found.lacking + found.gave_up + found.malformed, 0U);
    EXPECT_EQ(found.verified, answers(kept));
    EXPECT_GT(found.verified, 60U);
    for (const AnswerStatus status : {AnswerStatus::kFree, AnswerStatus::kContact,
                                      AnswerStatus::kPartial, AnswerStatus::kUncertain})
      EXPECT_GT(count(kept, [&](const auto& report) { return is_of(report, status); }), 0U)
          << to_string(status);
    EXPECT_GT(count(kept, [](const auto& r) { return r.world && r.world->tiles.size() > 2; }), 20U);
    EXPECT_GT(count(kept, [](const auto& r) { return r.world && !r.world->missing_pages.empty(); }),
              0U);
    EXPECT_TRUE(found.complaints.empty());
  }
}

// Detail, tiles and pages have their turn in a frame; what was not asked is told.
TEST_F(VerifyWorlds, WhatTheBudgetLeftOutClaimsNothing) {
  const KeptSamples kept = record({.options = {.lookahead_s = 4}, .rounds = 40, .budget_s = 0});
  const VerifyReport found = verify(kept);
  EXPECT_EQ(found.different, 0U) << first_of(found);
  EXPECT_EQ(found.verified, answers(kept));
  EXPECT_GT(count(kept,
                  [](const auto& r) {
                    return r.world && std::any_of(r.world->tiles.begin(), r.world->tiles.end(),
                                                  [](const auto& tile) { return !tile.asked; });
                  }),
            10U);
}

TEST_F(VerifyWorlds, FindsWhatWasForged) {
  const KeptSamples kept = record({});
  const auto is_free = [](const auto& r) {
    return is_of(r, AnswerStatus::kFree) && r.clearance_m > 0.001 && !r.world->tiles.empty();
  };
  const auto is_contact = [](const auto& r) { return is_of(r, AnswerStatus::kContact); };
  const auto is_uncertain = [](const auto& r) { return is_of(r, AnswerStatus::kUncertain); };
  const auto expect_different = [&](const auto& which, const auto& spoil) {
    const VerifyReport found = spoilt(kept, which, spoil);
    EXPECT_EQ(found.different, 1U);
    return first_of(found);
  };
  expect_different(is_free, [](auto& r) { r.clearance_m = r.clearance_m * 2 + 0.1; });
  expect_different(is_free, [](auto& r) { r.status = 1; });
  expect_different(is_free, [](auto& r) { r.answer_digest ^= 1; });
  expect_different(is_uncertain, [](auto& r) { r.status = 0; });
  expect_different(is_uncertain, [](auto& r) { r.uncertainty_m = 0; });
  expect_different(is_contact, [](auto& r) { r.pair_count += 1; });
  expect_different(is_contact, [](auto& r) { r.pairs.front()[0].index += 1; });
  expect_different(is_contact, [](auto& r) { r.a.pose.translation_m[2] += 1e4; });
  expect_different(is_contact, [](auto& r) { r.b.pose.translation_m[2] += 1e4; });
  // A tile that is left out, though its box is near.
  EXPECT_NE(expect_different(is_contact, [](auto& r) { r.world->tiles.pop_back(); }).find("tiles"),
            std::string::npos);
  expect_different(is_contact, [](auto& r) { r.world->reach_cells = 0xffffffffU; });
  EXPECT_NE(expect_different(is_contact,
                             [](auto& r) {
                               for (auto& tile : r.world->tiles) tile.state_digest ^= 1;
                             })
                .find("state"),
            std::string::npos);
  // That it was not asked leaves nothing certified.
  expect_different(is_contact, [](auto& r) {
    for (auto& tile : r.world->tiles) tile.asked = false;
  });
  // A page that is said to be missing, too.
  expect_different(is_contact, [&](auto& r) {
    for (const auto& [content, bytes] : terrain_.pages.pages)
      if (content != terrain_.pages.world.root) r.world->missing_pages.push_back(content);
    std::sort(r.world->missing_pages.begin(), r.world->missing_pages.end());
    r.world->tiles.clear();
  });
}

// What a report does not hold can be no proof.
TEST_F(VerifyWorlds, WithoutWhatItRestsOnNothingIsProved) {
  const KeptSamples kept = record({});
  const auto is_contact = [](const auto& r) { return is_of(r, AnswerStatus::kContact); };
  const VerifyReport found = spoilt(kept, is_contact, [](auto& r) { r.world.reset(); });
  EXPECT_EQ(found.lacking, 1U);
  EXPECT_EQ(found.different, 0U);
  // Of any content: it is no longer said whose tiles these are.
  const VerifyReport other =
      spoilt(kept, is_contact, [](auto& r) { (r.world->is_a ? r.a : r.b).content_hash.low ^= 1; });
  EXPECT_EQ(other.lacking, 1U);
  EXPECT_EQ(other.different, 0U);
}

TEST_F(VerifyWorlds, PagesAndHeadersThatAreNotRecordedComeOutOfTheWorldsFolder) {
  KeptSamples kept = record({});
  std::size_t seen = 0;
  std::erase_if(kept, [&](const KeptSample& sample) {
    return sample.batch.is_piece && ++seen > 6;  // they carry numbers, so batches are missing, too
  });
  ASSERT_GT(seen, 10U);
  const VerifyReport without = verify(kept);
  EXPECT_EQ(without.different, 0U);
  EXPECT_GT(without.lacking, 20U);
  const VerifyReport found = verify(kept, files().get());
  EXPECT_EQ(found.different, 0U) << first_of(found);
  EXPECT_EQ(found.verified + found.lacking, answers(kept));
}

TEST_F(VerifyWorlds, ALateRecorderProvesWhatFollowsWithTheWorldsFolder) {
  const KeptSamples all = record({.scenes = 40, .recorder_in = 15});
  KeptSamples late;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (i >= came_at_ || all[i].as<wire::MeshHeader>() != nullptr) late.push_back(all[i]);
  ASSERT_GT(answers(late), 30U);
  ASSERT_LT(answers(late), answers(all) - 20);
  // Of the ball more had come before the recorder did; so was it of tiles.
  const VerifyReport found = verify(late, files().get());
  EXPECT_EQ(found.different, 0U) << first_of(found);
  EXPECT_EQ(found.verified, answers(late));
  EXPECT_TRUE(found.wanted.empty());
  EXPECT_TRUE(found.complaints.empty());
  const VerifyReport without = verify(late);
  EXPECT_EQ(without.different, 0U);
  EXPECT_LT(without.verified, answers(late));
  const VerifyReport ball_alone = verify(late, files(false).get());
  EXPECT_EQ(ball_alone.different, 0U);
  EXPECT_LT(ball_alone.verified, answers(late));
  ASSERT_EQ(ball_alone.wanted.size(), 1U);
  EXPECT_EQ(ball_alone.wanted.begin()->first, terrain_.pages.name);
  EXPECT_EQ(ball_alone.wanted.begin()->second.name, "valley");
}

// Tiles that nothing was near for ten seconds are given up, and come again.
TEST_F(VerifyWorlds, WhatFollowsTilesThatWereGivenUpIsProved) {
  const KeptSamples kept = record({.scenes = 60, .between_s = 4, .recorder_in = 0});
  std::set<std::pair<ContentHash, std::uint32_t>> lives;
  for (const KeptSample& sample : kept)
    if (const auto* held = sample.as<wire::HeldDetail>())
      lives.insert({held->content_hash, held->era});
  std::set<ContentHash> contents;
  for (const auto& [content, era] : lives) contents.insert(content);
  ASSERT_GT(lives.size(), contents.size() + 10);
  const VerifyReport found = verify(kept);
  EXPECT_EQ(found.different, 0U) << first_of(found);
  EXPECT_EQ(found.lacking + found.gave_up, 0U);
  EXPECT_EQ(found.verified, answers(kept));
  // Nobody said what was held from then on.
  KeptSamples untold = kept;
  std::erase_if(untold,
                [](const KeptSample& sample) { return sample.as<wire::HeldDetail>() != nullptr; });
  const VerifyReport without = verify(untold);
  EXPECT_EQ(without.different, 0U);
  EXPECT_GT(without.gave_up, 20U);
  EXPECT_GT(without.verified, 10U);
}

// And so is detail, above a limit.
TEST_F(VerifyWorlds, WhatFollowsDetailThatWasGivenUpIsProved) {
  const KeptSamples kept =
      record({.options = {.max_held_splits = 8}, .scenes = 60, .between_s = 3, .recorder_in = 0});
  EXPECT_GT(count(kept, [](const auto& r) { return r.a.era > 0 || r.b.era > 0; }), 40U);
  const VerifyReport found = verify(kept);
  EXPECT_EQ(found.different, 0U) << first_of(found);
  EXPECT_EQ(found.lacking + found.gave_up, 0U);
  EXPECT_EQ(found.verified, answers(kept));
}

TEST_F(VerifyWorlds, WhatTheHostsOptionsCutIsProvedAsFarAsItGoes) {
  for (const int how : {0, 1, 2}) {
    SCOPED_TRACE(how);
    SessionOptions options;
    if (how == 0) options.any = true;
    if (how == 1) options.max_pairs = 2;
    if (how == 2) options.max_tests = 300;
    const KeptSamples kept = record({.options = options});
    const VerifyReport found = verify(kept);
    EXPECT_EQ(found.different, 0U) << first_of(found);
    EXPECT_EQ(found.verified, answers(kept));
    EXPECT_GT(found.cut, 3U);
    const auto is_cut = [](const auto& r) { return r.cut && !r.pairs.empty(); };
    const auto expect_different = [&](const auto& spoil) {
      EXPECT_EQ(spoilt(kept, is_cut, spoil).different, 1U);
    };
    expect_different([](auto& r) { r.pairs.front()[1].index = 1U << 30U; });
    expect_different([](auto& r) { r.a.pose.translation_m[2] += 1e4; });
    expect_different([](auto& r) { r.status = 0; });
    expect_different([](auto& r) { r.clearance_m = 1; });
    if (how == 2) continue;
    const VerifyReport more = spoilt(
        kept, [](const auto& r) { return r.cut && r.status == 1 && !r.pairs.empty(); },
        [](auto& r) { r.pair_count += 777; });
    EXPECT_EQ(more.different, 1U);
  }
}

// What it leaves open is told right: how many pairs of faces were found, and how far off the rest
// may be.
TEST_F(VerifyWorlds, WhatACutAnswerLeavesOpenIsProved) {
  std::size_t partial = 0, uncertain = 0;
  for (const int how : {0, 1, 2}) {
    SCOPED_TRACE(how);
    SessionOptions options;
    if (how == 0) options.any = true;
    if (how == 1) options.max_pairs = 2;
    if (how == 2) options.max_tests = 300;
    const KeptSamples kept = record({.options = options});
    for (const AnswerStatus status : {AnswerStatus::kPartial, AnswerStatus::kUncertain}) {
      const auto is_it = [&](const auto& r) { return r.cut && is_of(r, status); };
      if (count(kept, is_it) == 0) continue;
      ++(status == AnswerStatus::kPartial ? partial : uncertain);
      const auto expect_different = [&](const char* what, const auto& spoil) {
        EXPECT_EQ(spoilt(kept, is_it, spoil).different, 1U) << to_string(status) << ", " << what;
      };
      expect_different("pairs", [](auto& r) { r.pair_count += 1'000'000; });
      expect_different("clearance", [](auto& r) { r.clearance_m = 1; });
      expect_different("bound", [](auto& r) { r.uncertainty_m = 1e-6; });
    }
  }
  EXPECT_GT(partial, 0U);
  EXPECT_GT(uncertain, 0U);
}

}  // namespace
}  // namespace nearmesh
