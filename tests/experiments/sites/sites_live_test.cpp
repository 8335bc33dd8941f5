// SPDX-License-Identifier: Apache-2.0
// Two sites, each with a domain, publishers and copies of the models, joined by what crosses alone:
// an answer about a body of the other site is certified, from detail of one's own.
#include <gtest/gtest.h>

#include <set>

#include "core/base/stopwatch.hpp"
#include "forwarder.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "process.hpp"

namespace nearmesh::sites {
namespace {

using subscriber::BodyId;
using subscriber::PairAnswer;
using subscriber::Session;
using test::Folder;
using test::Process;

constexpr std::uint32_t kHere = 171, kThere = 172;
constexpr double kMaxPoseAge_s = 2;

wire::TransportOptions at(std::uint32_t domain) {
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  wire::TransportOptions options;
  options.domain = domain;
  options.prefix = "sites-" + std::to_string(::getpid()) + "/" + test->name();
  options.interface = "127.0.0.1";
  return options;
}

/// Passes everything on, and remembers who was asked and which publishers were heard.
class Overheard final : public subscriber::Channel {
 public:
  struct Notes {
    std::set<wire::SessionId> asked, heard;
  };
  Overheard(std::unique_ptr<subscriber::DdsChannel> below, Notes& notes)
      : below_(std::move(below)), notes_(notes) {}
  [[nodiscard]] wire::SessionId own_id() const override { return below_->own_id(); }
  void send(const wire::RegionSubscription& request) override {
    if (request.request != 0) notes_.asked.insert(request.publisher);
    below_->send(request);
  }
  void send(const wire::BodyPoses& poses) override { below_->send(poses); }
  void send(const wire::BodyDirectory& bodies) override { below_->send(bodies); }
  void send(const wire::ContactReport& report) override { below_->send(report); }
  void tell(wire::ProcessStatus& status) override { below_->tell(status); }
  [[nodiscard]] Inbox take() override {
    Inbox inbox = below_->take();
    for (const wire::Hello& hello : inbox.hellos) notes_.heard.insert(hello.publisher);
    return inbox;
  }

 private:
  const std::unique_ptr<subscriber::DdsChannel> below_;
  Notes& notes_;
};

Motion at_height(double x_m, double z_m) {
  Motion motion;
  motion.pose.translation_m = {x_m, 0, z_m};
  return motion;
}

/// A session of one site.
struct Peer {
  explicit Peer(std::uint32_t domain) {
    auto channel = subscriber::DdsChannel::create({.transport = at(domain)});
    EXPECT_TRUE(channel.is_ok()) << channel.status().message();
    session =
        std::make_unique<Session>(std::make_unique<Overheard>(std::move(channel).value(), notes),
                                  subscriber::SessionOptions{.max_pose_age_s = kMaxPoseAge_s});
  }
  BodyId add(const std::string& name, const std::string& model, bool own, ContentHash content) {
    return session->add_body({.name = name, .model = model, .own = own, .content = content})
        .value();
  }
  subscriber::FrameReport update(double now_s) {
    auto report = session->update(++frame, now_s, motions, 0.01);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    return std::move(report).value();
  }
  Overheard::Notes notes;
  std::unique_ptr<Session> session;
  std::vector<Session::OwnMotion> motions;
  std::uint64_t frame = 0;
};

/// Whose hellos are on a domain.
std::set<wire::SessionId> publishers_on(std::uint32_t domain) {
  wire::Mailbox mailbox;
  wire::Reader<wire::Hello> reader(mailbox);
  const auto bus = wire::Bus::open({.transport = at(domain)}, mailbox).value();
  EXPECT_TRUE(reader.open(*bus).is_ok());
  std::set<wire::SessionId> heard;
  const auto listen = [&] {
    static_cast<void>(
        reader.drain(100, [&](wire::Hello&& hello, const wire::Handle&, wire::Microseconds) {
          heard.insert(hello.publisher);
        }));
    mailbox.wait(0.05);
    return !heard.empty();
  };
  EXPECT_TRUE(test::await(listen, 20));
  for (const Stopwatch watch; watch.seconds() < 1.5;) static_cast<void>(listen());  // and who else
  return heard;
}

class SitesLive : public testing::Test {
 protected:
  SitesLive() {
    for (const std::string site : {"here", "there"}) {
      std::filesystem::create_directory(folder.file(site));
      for (const auto& [kind, size] : {std::pair{"terrain", 48}, std::pair{"aircraft", 600}})
        std::filesystem::copy_file(test::model_file(kind, size), file(site, kind));
    }
    terrain = ModelFile::open(file("here", "terrain")).value().content_hash();
    aircraft = ModelFile::open(file("here", "aircraft")).value().content_hash();
  }
  [[nodiscard]] std::string file(const std::string& site, const std::string& kind) const {
    return folder.file(site + "/" + kind + ".spm");
  }
  std::unique_ptr<Process> serve(const std::string& site, std::uint32_t domain) {
    auto publisher = std::make_unique<Process>(
        folder, "nearmesh-publisher",
        std::vector<std::string>{"serve", file(site, "terrain"), file(site, "aircraft"), "--domain",
                                 std::to_string(domain), "--prefix", at(domain).prefix,
                                 "--interface", "127.0.0.1"});
    EXPECT_TRUE(publisher->says("ready on domain")) << publisher->err();
    return publisher;
  }
  /// The same pair of the full meshes' models, without a network.
  [[nodiscard]] PairAnswer truth(const std::string& model_a, const Motion& a,
                                 const Motion& b) const {
    auto channel = std::make_unique<subscriber::LocalChannel>();
    for (const char* kind : {"terrain", "aircraft"})
      EXPECT_TRUE(channel->add_model(kind, ModelFile::open(file("here", kind)).value()).is_ok());
    Session session(std::move(channel));
    const BodyId one = session.add_body({.name = "a", .model = model_a, .own = true}).value();
    const BodyId two = session.add_body({.name = "b", .model = "aircraft", .own = true}).value();
    EXPECT_TRUE(session.watch(one, two).is_ok());
    for (std::uint64_t frame = 1;; ++frame) {
      auto report = session.update(frame, 0, {{one, a}, {two, b}}, 1).value();
      if (report.all_certified() || frame > 100) return report.answers.at(0);
    }
  }

  const Folder folder;
  ContentHash terrain, aircraft;
  const Stopwatch clock;
};

TEST_F(SitesLive, AnswersAcrossAreCertifiedFromDetailOfOnesOwnSite) {
  const auto publisher_here = serve("here", kHere), publisher_there = serve("there", kThere);
  // Two peers there, so that two sessions speak through the forwarder's one writer.
  Peer mover(kThere), here(kHere);
  auto other_mover = std::make_unique<Peer>(kThere);
  const Motion place_one = at_height(0, 500), place_two = at_height(3, 500);
  mover.motions = {{mover.add("one", "aircraft", true, aircraft), place_one}};
  other_mover->motions = {{other_mover->add("two", "aircraft", true, aircraft), place_two}};
  const BodyId ground = here.add("ground", "terrain", false, terrain);
  const BodyId one = here.add("one", "aircraft", false, aircraft),
               two = here.add("two", "aircraft", false, aircraft);
  ASSERT_TRUE(here.session->place_body(ground, {}).is_ok());
  ASSERT_TRUE(here.session->watch(ground, one).is_ok());
  ASSERT_TRUE(here.session->watch(one, two).is_ok());

  subscriber::FrameReport report;
  const auto frame = [&] {
    static_cast<void>(mover.update(clock.seconds()));
    if (other_mover) static_cast<void>(other_mover->update(clock.seconds()));
    report = here.update(clock.seconds());
  };
  const auto fly_until = [&](const auto& done, double seconds) {
    return test::await(
        [&] {
          frame();
          test::pause(0.02);
          return done();
        },
        seconds);
  };

  // Nothing crosses by itself.
  EXPECT_FALSE(fly_until([&] { return here.session->motion_of(one).has_value(); }, 2));
  ASSERT_NE(report.find(ground, one), nullptr);
  EXPECT_FALSE(report.find(ground, one)->asked);
  ASSERT_TRUE(
      fly_until([&] { return !here.notes.heard.empty() && !mover.notes.heard.empty(); }, 20));

  Forwarder forwarder(at(kHere), at(kThere));
  ASSERT_TRUE(fly_until([&] { return report.all_certified(); }, 20))
      << report.find(one, two)->reason << report.find(one, two)->awaited;
  EXPECT_GT(forwarder.handed_on(), 0U);
  const PairAnswer touching = *report.find(one, two), flying = *report.find(ground, one);
  const PairAnswer true_touching = truth("aircraft", place_one, place_two),
                   true_flying = truth("terrain", {}, place_one);
  EXPECT_EQ(touching.answer.status, AnswerStatus::kContact);
  EXPECT_EQ(true_touching.answer.status, AnswerStatus::kContact);
  EXPECT_EQ(touching.answer.pair_total, true_touching.answer.pair_total);
  EXPECT_EQ(flying.answer.status, true_flying.answer.status);

  // One publisher was heard, that of its own site, and that one was asked.
  EXPECT_EQ(here.notes.heard.size(), 1U);
  EXPECT_EQ(mover.notes.heard.size(), 1U);
  EXPECT_NE(here.notes.heard, mover.notes.heard);
  EXPECT_EQ(here.notes.asked, here.notes.heard);
  EXPECT_EQ(publishers_on(kHere), here.notes.heard);

  // Who leaves there is not told of apart here, since another speaks through the same writer: the
  // pose's age tells.
  other_mover.reset();
  ASSERT_TRUE(fly_until([&] { return !report.find(one, two)->asked; }, kMaxPoseAge_s + 5));
  EXPECT_TRUE(fly_until([&] { return report.find(ground, one)->asked; }, 5));
  EXPECT_FALSE(report.find(one, two)->asked);

  // Who comes over into this domain: its body's name still belongs to the forwarder's writer, so it
  // takes another.
  const BodyId again = here.add("two, here", "aircraft", false, aircraft);
  ASSERT_TRUE(here.session->watch(one, again).is_ok());
  Peer newcomer(kHere);
  newcomer.motions = {{newcomer.add("two", "aircraft", true, aircraft), place_two},
                      {newcomer.add("two, here", "aircraft", true, aircraft), place_two}};
  const auto fly_with = [&](const auto& done, double seconds) {
    return fly_until(
        [&] {
          static_cast<void>(newcomer.update(clock.seconds()));
          return done();
        },
        seconds);
  };
  ASSERT_TRUE(fly_with(
      [&] { return report.find(one, again)->answer.status == AnswerStatus::kContact; }, 20));
  EXPECT_FALSE(fly_with([&] { return report.find(one, two)->asked; }, 2));
}

}  // namespace
}  // namespace nearmesh::sites
