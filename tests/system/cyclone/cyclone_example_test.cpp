// SPDX-License-Identifier: Apache-2.0
// examples/cyclone, flown: what a program of another vendor moves, hears, and answers itself. UDP
// on 127.0.0.1.

#include "on_loopback.hpp"
#include "tests/system/integration/process.hpp"

namespace nearmesh {
namespace {

class CycloneExample : public ::testing::Test {
 protected:
  CycloneExample() { test::set_cyclone_on_loopback(test::kDatagramsOfOurs); }

  std::vector<std::string> on_bus(std::vector<std::string> words) const {
    words.insert(words.end(), {"--domain", "95", "--prefix", prefix, "--interface", "127.0.0.1"});
    return words;
  }
  std::vector<std::string> cyclone_words(const std::vector<std::string>& more) const {
    std::vector<std::string> words{"--domain", "95",    "--prefix", prefix,
                                   "--model",  terrain, "--model",  aircraft};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  static bool prints(const test::Process& program, const std::string& text) {
    return test::await([&] { return program.out().find(text) != std::string::npos; });
  }
  struct Counts {
    unsigned long long own = 0, certified = 0, agreeing = 0, heard = 0, told = 0, differing = 0;
  };
  /// Ends it. Out: what its last line says.
  static Counts counts_of(test::Process& cyclone) {
    cyclone.signal(SIGINT);
    EXPECT_EQ(cyclone.wait(), 0) << cyclone.out() << cyclone.err();
    Counts counts;
    EXPECT_EQ(std::sscanf(test::lines_of(cyclone.out()).back().c_str(),
                          "own answers: %llu; certified on both sides: %llu, of which %llu agree; "
                          "poses: %llu as heard, %llu as told, %llu otherwise than heard",
                          &counts.own, &counts.certified, &counts.agreeing, &counts.heard,
                          &counts.told, &counts.differing),
              6)
        << cyclone.out();
    return counts;
  }

  test::Folder folder;
  // Without '-', which Cyclone DDS does not take in a topic's name.
  const std::string prefix = "example_" + std::to_string(::getpid());
  const std::string terrain = test::model_file("terrain", 48);
  const std::string aircraft = test::model_file("aircraft", 600);
};

TEST_F(CycloneExample, MovesABodyAndAnswersAboutItAsThePeerDoes) {
  folder.write("scene.yaml",
               "bodies:\n"
               "  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: drone, model: aircraft}\n"
               "pairs: [[ground, drone]]\n"
               "max_pose_age_s: 1\n");
  test::Process publisher(folder, "nearmesh-publisher", on_bus({"serve", terrain, aircraft}));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  test::Process peer(folder, "nearmesh-subscriber", on_bus({"run", folder.file("scene.yaml")}));
  // From high above the ground into it, and there it stays.
  test::Process cyclone(
      folder, "nearmesh-example-cyclone",
      cyclone_words({"--own", "drone", "aircraft", "--pin", aircraft, "--from", "0", "0", "800",
                     "--to", "0", "0", "165", "--flight", "10"}));
  for (const char* text :
       {"\nmodel terrain ", "\nmodel aircraft ", "body drone of model aircraft, moved by ",
        ": ground drone free, ", ": ground drone contact, ", " s: 0.000 0.000 165.000 m\n",
        " m apart at least: agrees\n"})
    ASSERT_TRUE(prints(cyclone, text)) << text << " in " << cyclone.out() << peer.err();
  constexpr std::size_t kEnough = 20;
  ASSERT_TRUE(test::poll(
      [&] {
        std::size_t agree = 0;
        for (const std::string& line : test::lines_of(cyclone.out()))
          agree += line.ends_with(": agrees") ? 1 : 0;
        return agree > kEnough;
      },
      test::kDeadline_s, 0.1))
      << cyclone.out() << peer.err();
  const Counts counts = counts_of(cyclone);
  EXPECT_GT(counts.certified, kEnough);
  EXPECT_EQ(counts.agreeing, counts.certified) << cyclone.out();
  // The ground is in place: of it there is the report's word alone.
  EXPECT_GT(counts.heard, 20U);
  EXPECT_GE(counts.told, counts.own);
  EXPECT_EQ(counts.differing, 0U);
  // Who has left is not taken for one who stays where it was.
  EXPECT_FALSE(peer.is_over()) << peer.err();
  peer.signal(SIGINT);
  EXPECT_EQ(peer.wait(), 0) << peer.err();
}

TEST_F(CycloneExample, HearsPromisesAndThePosesThatItWants) {
  std::string err;
  ASSERT_EQ(
      test::run(folder, "nearmesh-demo-flights",
                {folder.path(), "--size", "48", "--frames", "2000", "--rate", "50"}, nullptr, &err),
      0)
      << err;
  folder.write("scene.yaml",
               "bodies:\n"
               "  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: one, model: aircraft, max_speed_mps: 800}\n"
               "moves:\n  - {body: one, trajectory: flight1.csv}\n"
               "pairs: [[ground, one]]\nframe_rate_hz: 50\n");
  test::Process publisher(folder, "nearmesh-publisher", on_bus({"serve", terrain, aircraft}));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  test::Process peer(folder, "nearmesh-subscriber", on_bus({"run", folder.file("scene.yaml")}));
  {
    test::Process cyclone(folder, "nearmesh-example-cyclone", cyclone_words({}));
    ASSERT_TRUE(prints(cyclone, "promise one from ")) << cyclone.out() << peer.err();
    ASSERT_TRUE(prints(cyclone, ": agrees\n")) << cyclone.out() << peer.err();
    const Counts counts = counts_of(cyclone);
    EXPECT_EQ(cyclone.out().find("pose one at "), std::string::npos) << "nobody wants them";
    EXPECT_EQ(counts.agreeing, counts.certified) << cyclone.out();
    EXPECT_EQ(counts.heard, 0U);
  }
  test::Process cyclone(folder, "nearmesh-example-cyclone", cyclone_words({"--want"}));
  ASSERT_TRUE(prints(cyclone, "pose one at ")) << cyclone.out() << peer.err();
  ASSERT_TRUE(test::await([&] {
    return cyclone.out().find(": agrees\n", cyclone.out().find("pose one at ")) !=
           std::string::npos;
  })) << cyclone.out();
  const Counts counts = counts_of(cyclone);
  EXPECT_EQ(counts.agreeing, counts.certified) << cyclone.out();
  EXPECT_GT(counts.heard, 0U) << cyclone.out();
  EXPECT_EQ(counts.differing, 0U);
  EXPECT_FALSE(peer.is_over()) << peer.err();
}

}  // namespace
}  // namespace nearmesh
