// SPDX-License-Identifier: Apache-2.0
// Whose content a peer answers about: when publishers disagree, when it is pinned, and whose
// headers count.

#include <set>

#include "core/base/digest.hpp"
#include "core/base/hash.hpp"
#include "local_host.hpp"
#include "world.hpp"

namespace nearmesh::test {
namespace {

constexpr wire::SessionId kRival = kPublisher + 1, kStranger = 0xdead;

ContentHash content_of(const ServedModel& served) { return served.open().content_hash(); }

/// Flights one after the other, frames waited for; every answer is judged, and must name what it is
/// about.
class Content : public testing::Test {
 protected:
  Content() {
    world.on_report = [this](const FrameReport& report) {
      for (const PairAnswer& answer : report.answers) {
        if (!answer.asked) continue;
        ASSERT_EQ(answer.content_a,
                  content_of(answer.a == kGround ? *world.judge.ground : aircraft()));
        ASSERT_EQ(answer.content_b, content_of(aircraft()));
      }
    };
  }

  World world;

  /// How many frames, of `count` flights of 40, ended with all certified.
  std::size_t fly(Session& session, std::uint64_t first_seed, std::uint64_t count) {
    std::size_t certified = 0;
    for (std::uint64_t seed = first_seed; seed < first_seed + count && !HasFailure(); ++seed)
      certified += world.fly(session, make_flight(seed));
    return certified;
  }
  [[nodiscard]] std::size_t lines_with(const std::string& part) const {
    return static_cast<std::size_t>(
        std::count_if(world.complaints.begin(), world.complaints.end(),
                      [&](const std::string& l) { return l.find(part) != std::string::npos; }));
  }
  /// The status of a process holds a line with that, now and after a second more.
  [[nodiscard]] bool status_says(Session& session, wire::SessionId process,
                                 const std::string& part) {
    world.bus.statuses.clear();
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(100);
    while (!world.bus.statuses.contains(process) && std::chrono::steady_clock::now() < deadline)
      static_cast<void>(world.round(session));
    const auto& lines = world.bus.statuses[process].complaints;
    return std::any_of(lines.begin(), lines.end(), [&](const std::string& line) {
      return line.find(part) != std::string::npos;
    });
  }
};

// ---- rivals -------------------------------------------------------------------------------------

TEST_F(Content, RivalOfTheSameNameIsComplainedOfAndNeverTaken) {
  world.start_publisher();
  const auto session = world.make_peer();
  ASSERT_EQ(fly(*session, 1, 1), 40U);
  world.start_publisher(kRival, other_terrain());
  EXPECT_EQ(fly(*session, 2, 7), 280U);
  EXPECT_GE(world.judge.certified(), 800U);
  // It serves the same aircraft, and may be asked for that.
  for (const wire::RegionSubscription& asked : world.bus.subscriptions)
    EXPECT_NE(asked.content_hash, content_of(other_terrain()));
  // All sides say so, each once.
  const std::string ours = to_hex(content_of(terrain())),
                    theirs = to_hex(content_of(other_terrain()));
  EXPECT_EQ(lines_with("model terrain: publisher " + to_hex(kRival) + " serves content " + theirs +
                       " under this name; content " + ours + " is held and stays"),
            1U);
  EXPECT_EQ(lines_with("publisher " + to_hex(kRival) + " serves other content, " + theirs +
                       ", under this name, here it is " + ours),
            1U);
  EXPECT_EQ(lines_with("publisher " + to_hex(kPublisher) + " serves other content, " + ours +
                       ", under this name, here it is " + theirs),
            1U);
  EXPECT_EQ(world.complaints.size(), 3U);
  for (const wire::SessionId process : {kPeer, kPublisher, kRival})
    EXPECT_TRUE(status_says(*session, process, "model terrain: publisher ")) << process;
}

TEST_F(Content, RivalIsToldOfAgainWhenItComesAgain) {
  world.start_publisher();
  const auto session = world.make_peer();
  world.fly(*session, make_flight(1), 0, 1);
  for (int i = 0; i < 2; ++i) {
    world.start_publisher(kRival, other_terrain());
    world.fly(*session, make_flight(1), 0, 5);
    world.stop_publisher(kRival);
    world.fly(*session, make_flight(1), 5, 10);
  }
  EXPECT_EQ(lines_with("is held and stays"), 2U);
  EXPECT_EQ(lines_with("serves other content"), 4U);
}

TEST_F(Content, ReplacedContentIsGivenUpAtOnceAndLoudly) {
  world.start_publisher();
  const auto session = world.make_peer();
  ASSERT_EQ(fly(*session, 1, 2), 80U);
  world.start_publisher(kRival, other_terrain(), content_of(terrain()));
  world.judge.ground = &other_terrain();  // the next update takes the news in
  EXPECT_EQ(fly(*session, 3, 3), 120U);
  const std::string before = to_hex(content_of(terrain())),
                    after = to_hex(content_of(other_terrain()));
  EXPECT_EQ(lines_with("model terrain: publisher " + to_hex(kRival) + " replaces content " +
                       before + " by " + after + "; starting again with it"),
            1U);
  EXPECT_EQ(lines_with("replaces content " + before + ", which is served here, by " + after), 1U);
  EXPECT_EQ(world.complaints.size(), 2U);
  // Reports name what they are about.
  EXPECT_EQ(world.bus.reports.front().a.content_hash, content_of(terrain()));
  const auto last = std::find_if(world.bus.reports.rbegin(), world.bus.reports.rend(),
                                 [](const auto& report) { return report.body_a == "ground"; });
  EXPECT_EQ(last->a.content_hash, content_of(other_terrain()));
  // A late joiner takes what replaces, whoever it hears first; and the end of the old one is no
  // news.
  const auto late = world.make_peer(quick_options(), kPeer + 1);
  EXPECT_EQ(world.fly(*late, make_flight(9), 0, 10), 10U);
  world.stop_publisher();
  EXPECT_EQ(fly(*session, 6, 1), 40U);
  EXPECT_EQ(lines_with("model terrain"), 2U);
}

// A channel gives a header once.
TEST_F(Content, ReplacedContentComesBackWhenWhatReplacedItEnds) {
  world.start_publisher();
  const auto session = world.make_peer();
  ASSERT_EQ(fly(*session, 1, 1), 40U);
  for (int i = 0; i < 2; ++i) {
    world.start_publisher(kRival, other_terrain(), content_of(terrain()));
    world.judge.ground = &other_terrain();
    ASSERT_EQ(fly(*session, 2, 1), 40U);
    world.stop_publisher(kRival);
    world.judge.ground = &terrain();
    ASSERT_EQ(fly(*session, 3, 1), 40U);
  }
}

TEST_F(Content, EndOfTheLastPublisherOfAContentLeadsToTheOther) {
  world.start_publisher();
  world.start_publisher(kPublisher + 7);  // the same content: its end is not the content's
  const auto session = world.make_peer();
  ASSERT_EQ(fly(*session, 1, 1), 40U);
  world.start_publisher(kRival, other_terrain());
  world.stop_publisher();
  EXPECT_EQ(fly(*session, 2, 1), 40U);
  EXPECT_EQ(lines_with("is there any more"), 0U);
  world.stop_publisher(kPublisher + 7);
  world.judge.ground = &other_terrain();
  EXPECT_EQ(fly(*session, 3, 2), 80U);
  EXPECT_EQ(lines_with("model terrain: no publisher of content " + to_hex(content_of(terrain())) +
                       " is there any more; publisher " + to_hex(kRival) + " serves content " +
                       to_hex(content_of(other_terrain())) + "; starting again with it"),
            1U);
}

// As on a link that was down for longer than the lease.
TEST_F(Content, WhoIsLostAndFoundAtOnceIsNoReasonToChange) {
  world.start_publisher();
  const auto session = world.make_peer();
  ASSERT_EQ(fly(*session, 1, 1), 40U);
  world.bus.lose_publisher(kPublisher);
  world.start_publisher(kRival, other_terrain());
  world.service(kPublisher).announce();
  EXPECT_EQ(fly(*session, 2, 1), 40U);
}

TEST_F(Content, WhoJoinsWhilePublishersDisagreeTakesNeither) {
  world.start_publisher();
  world.start_publisher(kRival, other_terrain());
  const auto session = world.make_peer();
  EXPECT_EQ(world.fly(*session, make_flight(1), 0, 3, 5), 0U);
  const FrameReport report = world.round(*session);
  for (const ServedModel* served : {&terrain(), &other_terrain()})
    EXPECT_NE(report.answers[0].reason.find(to_hex(content_of(*served))), std::string::npos)
        << report.answers[0].reason;
  EXPECT_EQ(report.answers[0].content_a, ContentHash{});
  EXPECT_TRUE(is_certified(report.answers[2].answer.status));  // of the aircraft they do not
  EXPECT_EQ(lines_with("neither is taken"), 1U);
  world.stop_publisher(kRival);
  EXPECT_EQ(fly(*session, 1, 1), 40U);
}

// ---- pins ---------------------------------------------------------------------------------------

TEST_F(Content, PinnedContentIsTheOnlyOneThatIsTaken) {
  world.start_publisher(kRival, other_terrain());
  const auto session = world.make_peer();
  ASSERT_TRUE(
      session
          ->add_body({.name = "more ground", .model = "terrain", .content = content_of(terrain())})
          .is_ok());
  EXPECT_EQ(world.fly(*session, make_flight(1), 0, 3, 5), 0U);
  const std::string refusal = "publisher " + to_hex(kRival) + " serves content " +
                              to_hex(content_of(other_terrain())) + " under this name; content " +
                              to_hex(content_of(terrain())) + " is pinned";
  EXPECT_EQ(world.round(*session).answers[0].reason, "model terrain of body ground: " + refusal);
  EXPECT_EQ(lines_with("model terrain: " + refusal), 1U);
  EXPECT_TRUE(status_says(*session, kPeer, "model terrain: " + refusal.substr(0, 60)));
  // The right one comes; nothing leads away from it.
  world.start_publisher();
  EXPECT_EQ(fly(*session, 1, 1), 40U);
  world.start_publisher(kPublisher + 8, other_terrain(), content_of(terrain()));
  EXPECT_EQ(fly(*session, 2, 1), 40U);
  world.stop_publisher();
  world.fly(*session, make_flight(1), 0, 3, 5);  // judged by what is pinned
  EXPECT_EQ(lines_with("starting again"), 0U);
}

TEST_F(Content, PinSettlesADisagreement) {
  world.start_publisher();
  world.start_publisher(kRival, other_terrain());
  const auto session = world.make_peer();
  EXPECT_EQ(world.fly(*session, make_flight(1), 0, 2, 5), 0U);
  ASSERT_TRUE(
      session->add_body({.name = "pin", .model = "terrain", .content = content_of(terrain())})
          .is_ok());
  EXPECT_EQ(fly(*session, 1, 1), 40U);
}

TEST_F(Content, PinOfOtherContentThanIsHeldDropsThat) {
  world.start_publisher(kPublisher, other_terrain());
  world.judge.ground = &other_terrain();
  const auto session = world.make_peer();
  EXPECT_EQ(fly(*session, 1, 1), 40U);
  ASSERT_TRUE(
      session->add_body({.name = "pin", .model = "terrain", .content = content_of(terrain())})
          .is_ok());
  EXPECT_EQ(world.fly(*session, make_flight(1), 0, 2, 5), 0U);
  EXPECT_EQ(lines_with("content " + to_hex(content_of(terrain())) + " is pinned now; content " +
                       to_hex(content_of(other_terrain())) + " is dropped"),
            1U);
  const auto other = session->add_body(
      {.name = "other pin", .model = "terrain", .content = content_of(other_terrain())});
  EXPECT_EQ(other.status().code(), StatusCode::kConflict);
  EXPECT_NE(other.status().message().find(to_hex(content_of(terrain()))), std::string::npos);
  EXPECT_NE(other.status().message().find(to_hex(content_of(other_terrain()))), std::string::npos);
  EXPECT_EQ(session->add_body({.name = "twin", .model = "twin", .content = content_of(terrain())})
                .status()
                .code(),
            StatusCode::kConflict);
}

TEST_F(Content, PinnedContentThatNobodyServesIsNamed) {
  const auto session = world.make_peer();
  ASSERT_TRUE(
      session->add_body({.name = "pin", .model = "terrain", .content = {0, 0xabc}}).is_ok());
  EXPECT_EQ(world.round(*session).answers[0].reason,
            "model terrain of body ground: no publisher found");
  LocalHost host;
  ASSERT_TRUE(
      host.session->add_body({.name = "ghost", .model = "spectre", .content = {0, 0xabc}}).is_ok());
  const BodyId ghost{1};
  ASSERT_TRUE(host.session->watch(kGround, ghost).is_ok());
  EXPECT_EQ(host.update().answers.back().reason,
            "model spectre of body ghost: no publisher serves content " +
                to_hex(ContentHash{0, 0xabc}) + ", which is pinned");
}

TEST_F(Content, LocalFileOfOtherContentThanPinnedIsRefused) {
  for (const bool right : {true, false}) {
    auto channel = std::make_unique<subscriber::LocalChannel>();
    ASSERT_TRUE(channel->add_model("terrain", terrain().open()).is_ok());
    ASSERT_TRUE(channel->add_model("aircraft", aircraft().open()).is_ok());
    Session session(std::move(channel));
    ASSERT_TRUE(session
                    .add_body({.name = "ground",
                               .model = "terrain",
                               .content = content_of(right ? terrain() : other_terrain())})
                    .is_ok());
    ASSERT_TRUE(session.place_body(kGround, {}).is_ok());
    ASSERT_TRUE(session.add_body({.name = "one", .model = "aircraft", .own = true}).is_ok());
    ASSERT_TRUE(session.watch(kGround, kOne).is_ok());
    const auto report =
        session.update(0, 0, {{kOne, {.pose = {.translation_m = {0, 0, 9000}}}}}, 1);
    ASSERT_TRUE(report.is_ok());
    const PairAnswer& answer = report.value().answers[0];
    EXPECT_EQ(answer.asked, right);
    if (right) continue;
    for (const ServedModel* served : {&terrain(), &other_terrain()}) {
      EXPECT_NE(answer.reason.find(to_hex(content_of(*served))), std::string::npos)
          << answer.reason;
      ASSERT_EQ(report.value().complaints.size(), 1U);
      EXPECT_NE(report.value().complaints[0].find(to_hex(content_of(*served))), std::string::npos);
    }
  }
}

// ---- headers ------------------------------------------------------------------------------------

TEST_F(Content, HeaderOfWhoeverServesNothingDoesNotCount) {
  world.bus.deliver_headers = false;
  world.start_publisher();
  const auto session = world.make_peer();
  static_cast<void>(world.round(*session));
  // All that lies below the ground's roots is said to lie nowhere: what is missing would meet
  // nothing.
  SpmHeader header = terrain().model.header;
  for (BaseRoot& root : header.roots) root.box = {};
  const wire::MeshHeader lie{
      .name = "terrain", .content_hash = content_of(terrain()), .bytes = encode_header(header)};
  for (int i = 0; i < 3; ++i) {
    world.bus.inject(kStranger, lie);
    static_cast<void>(world.round(*session));
  }
  EXPECT_EQ(session->header_of(kGround), nullptr);
  EXPECT_EQ(session->stats().refused_headers, 3U);
  EXPECT_EQ(lines_with("header of content " + to_hex(content_of(terrain())) + " from " +
                       to_hex(kStranger) + " does not count"),
            1U);
  world.bus.release_headers();
  EXPECT_EQ(fly(*session, 1, 7), 280U);
  EXPECT_GE(world.judge.certified(), 800U);
}

TEST_F(Content, HeaderCountsFromWhoAnnouncesItAlone) {
  world.bus.deliver_headers = false;
  world.start_publisher();
  world.start_publisher(kRival, terrain());
  const auto session = world.make_peer();
  static_cast<void>(world.round(*session));
  const ModelFile file = other_terrain().open();
  wire::MeshHeader header{.name = "terrain", .content_hash = file.content_hash()};
  header.bytes.assign(file.header_bytes().begin(), file.header_bytes().end());
  world.bus.inject(kRival, header);  // which announces another
  static_cast<void>(world.round(*session));
  EXPECT_EQ(session->stats().refused_headers, 1U);
  world.bus.release_headers();
  EXPECT_EQ(fly(*session, 1, 1), 40U);
}

/// Announced by its publisher, and of the content that it says; but its boxes leave out its faces.
TEST_F(Content, HeaderThatContradictsItselfNamesItsPublisherWhichIsAvoided) {
  const auto session = world.make_peer();
  SpmHeader header = terrain().model.header;
  for (BaseRoot& root : header.roots) root.box = {};
  wire::MeshHeader lie{.name = "terrain", .bytes = encode_header(header)};
  lie.content_hash = digest_of(lie.bytes);
  world.bus.inject(
      wire::Hello{.publisher = kRival, .models = {{"terrain", lie.content_hash, 1, {}}}});
  for (int i = 0; i < 3; ++i) {
    world.bus.inject(kRival, lie);
    static_cast<void>(world.round(*session));
  }
  EXPECT_EQ(session->header_of(kGround), nullptr);
  EXPECT_EQ(lines_with("model terrain: publisher " + to_hex(kRival) +
                       " contradicts itself, its content " + to_hex(lie.content_hash) +
                       " is not taken: "),
            1U);
  EXPECT_TRUE(status_says(*session, kPeer, "which contradicts itself and is not taken"));
  // It is no rival of a publisher that tells the truth.
  world.start_publisher();
  EXPECT_EQ(fly(*session, 1, 1), 40U);
  for (const wire::RegionSubscription& asked : world.bus.subscriptions)
    EXPECT_EQ(asked.publisher, kPublisher);
}

}  // namespace
}  // namespace nearmesh::test
