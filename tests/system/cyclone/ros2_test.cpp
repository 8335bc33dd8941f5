// SPDX-License-Identifier: Apache-2.0
// A flight that ROS 2 moves and looks at: nearmesh-subscriber run --ros2 --ros2-poses, and watch
// --ros2 beside it, against a program of another vendor that has ROS 2's types and names. UDP on
// 127.0.0.1, processes of their own.

#include <nlohmann/json.hpp>

#include "core/base/stopwatch.hpp"
#include "on_loopback.hpp"
#include "tests/system/integration/process.hpp"

namespace nearmesh {
namespace {

class Ros2Flight : public ::testing::Test {
 protected:
  static constexpr int kRosDomain = 97, kBusDomain = 96, kLookDomain = 95;

  Ros2Flight() {
    test::set_cyclone_on_loopback();  // datagrams as large as Cyclone makes them by itself
    folder.write("scene.yaml",
                 "bodies:\n"
                 "  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
                 "  - {name: drone, model: aircraft}\n"
                 "  - {name: rover, model: aircraft}\n"
                 "pairs: [[ground, drone], [ground, rover]]\n"
                 "max_pose_age_s: 1\n");
  }

  std::vector<std::string> on_bus(std::vector<std::string> words) const {
    words.insert(words.end(), {"--domain", std::to_string(kBusDomain), "--prefix",
                               "ros2-" + std::to_string(::getpid()), "--interface", "127.0.0.1"});
    return words;
  }
  /// What the program of ROS 2 says from now on, twenty times a second.
  void say(const std::string& sayings) const {
    folder.write("new.txt", sayings);
    std::filesystem::rename(folder.file("new.txt"), folder.file("sayings.txt"));
  }
  /// The last answer about the ground and the drone.
  nlohmann::json answer() const {
    nlohmann::json last;
    for (const std::string& line : test::lines_of(test::read_text(folder.file("answers.jsonl"))))
      if (const auto json = nlohmann::json::parse(line, nullptr, false);
          json.is_object() && json.contains("b") && json["b"] == "drone")
        last = json;
    return last;
  }
  bool is_answered(const std::string& status) const {
    return test::await([&] {
      const nlohmann::json last = answer();
      return !last.is_null() && last["status"] == status;
    });
  }

  test::Folder folder;
};

TEST_F(Ros2Flight, IsMovedAndSeenByAProgramOfAnotherVendor) {
  test::Process publisher(
      folder, "nearmesh-publisher",
      on_bus({"serve", test::model_file("terrain", 48), test::model_file("aircraft", 600)}));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  test::Process recorder(folder, "nearmesh-subscriber",
                         on_bus({"record", "-o", folder.file("flight.db3")}));
  ASSERT_TRUE(recorder.says("recording")) << recorder.err();
  // Bodies high above the ground, and all that is to be refused: other frames, numbers that are no
  // pose, bytes that are no message.
  const std::string rover = "tf world rover/base 300 0 900 1\n";
  const std::string bad =
      "pose /drone/pose odom 0 0 165 1\n"
      "pose /drone/pose world nan 0 165 1\n"
      "pose /drone/pose world 0 0 165 5\n"
      "bad /drone/pose\n"
      "tf map rover/base 0 0 165 1\n"
      "tf world stranger 0 0 165 1\n";
  say(bad + rover + "pose /drone/pose world 10 20 800 1\n");
  const Stopwatch clock;
  test::Process ros(folder, "nearmesh-cyclone-ros2",
                    {std::to_string(kRosDomain), folder.file("sayings.txt")});
  test::Process peer(
      folder, "nearmesh-subscriber",
      on_bus({"run", folder.file("scene.yaml"), "--answers", folder.file("answers.jsonl"), "--ros2",
              "--ros2-domain", std::to_string(kRosDomain), "--ros2-poses",
              "drone=/drone/pose,rover=rover/base", "--wait-recorder"}));
  const auto sees = [&](const std::string& line) {
    return test::await([&] { return ros.out().find("\n" + line) != std::string::npos; });
  };
  ASSERT_TRUE(is_answered("free")) << peer.err();
  EXPECT_TRUE(sees("tf 'world' 'drone' 10 20 800 0 0 0 1\n")) << peer.err();
  EXPECT_TRUE(sees("tf 'world' 'rover' 300 0 900 0 0 0 1\n"));
  EXPECT_TRUE(sees("static 'world' 'ground' 0 0 0 0 0 0 1\n"));
  EXPECT_TRUE(sees("mesh 'ground' 'ground coarse' 0 11 0 0 "));
  EXPECT_TRUE(sees("mesh 'drone' 'drone coarse' 0 11 0 0 "));
  EXPECT_EQ(ros.out().find("contacts 'world' 'ground drone' "), std::string::npos);

  // Into the ground: lines where they touch, and the faces there as exact ones.
  say(bad + rover + "pose /drone/pose world 0 0 165 1\n");
  ASSERT_TRUE(is_answered("contact")) << peer.err();
  EXPECT_TRUE(sees("contacts 'world' 'ground drone' 1 5 0 2 "));
  EXPECT_TRUE(sees("mesh 'ground' 'ground exact' 0 11 0 0 "));

  // Off it: they are taken away.
  say(bad + rover + "pose /drone/pose world 10 20 800 1\n");
  ASSERT_TRUE(is_answered("free"));
  EXPECT_TRUE(sees("contacts 'world' 'ground drone' 1 5 2 "));

  // Who falls silent is not taken for one who stays where he is.
  say(bad + rover);
  ASSERT_TRUE(is_answered("uncertain"));
  EXPECT_NE(answer()["reason"].get<std::string>().find("the pose of body drone is"),
            std::string::npos)
      << answer();
  EXPECT_TRUE(sees("contacts 'world' 'ground drone uncertain' 1 5 0 2 "));

  EXPECT_FALSE(peer.is_over()) << peer.err();
  peer.signal(SIGINT);
  EXPECT_EQ(peer.wait(), 0) << peer.err();
  // Each kind once in ten seconds, whatever comes twenty times a second.
  const double most = 1 + clock.seconds() / 10;
  for (const char* line : {"ros2: refused: frame of drone: \"odom\", expected \"world\"",
                           "ros2: refused: frame of rover: \"map\", expected \"world\"",
                           "ros2: refused: /drone/pose: 12 bytes that are no PoseStamped",
                           "ros2: refused: pose of drone: "}) {
    const std::string err = peer.err();
    int times = 0;
    for (std::size_t at = err.find(line); at != std::string::npos; at = err.find(line, at + 1))
      ++times;
    EXPECT_GE(times, 1) << line << "\n" << err;
    EXPECT_LE(times, most) << line << "\n" << err;
  }
  EXPECT_EQ(peer.err().find(" 0 refused"), std::string::npos);
  recorder.signal(SIGINT);
  EXPECT_EQ(recorder.wait(), 0) << recorder.err();
  std::string told;
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber", {"verify", folder.file("flight.db3")}, &told),
            0)
      << told;
}

TEST_F(Ros2Flight, ShowsWhoHasFallenSilentAmongAllPairs) {
  test::Process publisher(
      folder, "nearmesh-publisher",
      on_bus({"serve", test::model_file("terrain", 48), test::model_file("aircraft", 600)}));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  folder.write("all.yaml",
               "bodies:\n"
               "  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: drone, model: aircraft}\n"
               "pairs: all\n"
               "max_pose_age_s: 0.5\n");
  say("tf map drone 0 0 900 1\n");
  test::Process ros(folder, "nearmesh-cyclone-ros2",
                    {std::to_string(kBusDomain), folder.file("sayings.txt")});
  test::Process peer(folder, "nearmesh-subscriber",
                     on_bus({"run", folder.file("all.yaml"), "--ros2", "--ros2-frame", "map",
                             "--ros2-poses", "drone"}));
  std::size_t from = 0;  // in what it has seen
  const auto sees = [&](const std::string& line) {
    return test::await([&] { return ros.out().find("\n" + line, from) != std::string::npos; });
  };
  ASSERT_TRUE(sees("static 'map' 'ground' 0 0 0 0 0 0 1\n")) << peer.err();
  ASSERT_TRUE(sees("mesh 'drone' 'drone coarse' ")) << peer.err();
  say("");
  from = ros.out().size() - 1;
  EXPECT_TRUE(sees("contacts 'map' 'drone unknown' 0 5 0 2 6 "));
  from = ros.out().size() - 1;
  say("tf map drone 0 0 900 1\n");
  EXPECT_TRUE(sees("contacts 'map' 'drone unknown' 0 5 2 "));
  peer.signal(SIGINT);
  EXPECT_EQ(peer.wait(), 0) << peer.err();
}

/// A peer that shows nothing itself, and who looks on from the first.
TEST_F(Ros2Flight, IsShownByOneWhoLooksOn) {
  test::Process publisher(
      folder, "nearmesh-publisher",
      on_bus({"serve", test::model_file("terrain", 48), test::model_file("aircraft", 600)}));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  test::Process watch(folder, "nearmesh-subscriber",
                      on_bus({"watch", "--ros2", "--ros2-domain", std::to_string(kLookDomain)}));
  ASSERT_TRUE(test::await([&] {
    return watch.out() == "/tf, /nearmesh/contacts and /nearmesh/mesh on domain " +
                              std::to_string(kLookDomain) + "\n";
  })) << watch.err();
  folder.write("pair.yaml",
               "bodies:\n"
               "  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: drone, model: aircraft}\n"
               "pairs: [[ground, drone]]\n"
               "max_pose_age_s: 1\n");
  say("pose /drone/pose world 10 20 800 1\n");
  test::Process ros(folder, "nearmesh-cyclone-ros2",
                    {std::to_string(kLookDomain), folder.file("sayings.txt")});
  test::Process peer(
      folder, "nearmesh-subscriber",
      on_bus({"run", folder.file("pair.yaml"), "--answers", folder.file("answers.jsonl"),
              "--ros2-domain", std::to_string(kLookDomain), "--ros2-poses", "drone=/drone/pose",
              "--wait-recorder"}));
  std::size_t from = 0;  // in what it has seen
  const auto sees = [&](const std::string& line) {
    return test::await([&] { return ros.out().find("\n" + line, from) != std::string::npos; });
  };
  ASSERT_TRUE(sees("tf 'world' 'drone' 10 20 800 0 0 0 1\n")) << watch.err() << peer.err();
  EXPECT_TRUE(sees("static 'world' 'ground' 0 0 0 0 0 0 1\n"));
  EXPECT_TRUE(sees("mesh 'ground' 'ground coarse' 0 11 0 0 "));
  ASSERT_TRUE(sees("mesh 'drone' 'drone coarse' 0 11 0 0 ")) << watch.err();
  EXPECT_EQ(ros.out().find("static 'world' 'drone'"), std::string::npos);
  EXPECT_EQ(ros.out().find("contacts 'world' 'ground drone' "), std::string::npos);

  // Into the ground: lines where they touch, and the faces there as exact ones.
  say("pose /drone/pose world 0 0 165 1\n");
  ASSERT_TRUE(is_answered("contact")) << peer.err();
  EXPECT_TRUE(sees("contacts 'world' 'ground drone' 1 5 0 2 "));
  EXPECT_EQ(ros.out().find("contacts 'world' 'ground drone' 1 5 0 2 2 0 165\n"), std::string::npos);
  EXPECT_TRUE(sees("mesh 'ground' 'ground exact' 0 11 0 0 "));

  // Who comes now has not heard what the peer holds: that they touch is all that he knows.
  watch.signal(SIGINT);
  EXPECT_EQ(watch.wait(), 0) << watch.err();
  test::Process late(folder, "nearmesh-subscriber",
                     on_bus({"watch", "--ros2", "--ros2-domain", std::to_string(kLookDomain)}));
  EXPECT_TRUE(sees("contacts 'world' 'ground drone' 1 5 0 2 2 0 165\n")) << late.err();

  // Off it: they are taken away.
  say("pose /drone/pose world 10 20 800 1\n");
  ASSERT_TRUE(is_answered("free"));
  EXPECT_TRUE(sees("contacts 'world' 'ground drone' 1 5 2 ")) << late.err();

  // Who falls silent is not taken for one who stays where he is; nor is a peer who leaves taken for
  // one who answers.
  say("");
  ASSERT_TRUE(is_answered("uncertain"));
  EXPECT_TRUE(sees("contacts 'world' 'ground drone uncertain' 1 5 0 2 2 0 800\n"));
  from = ros.out().size() - 1;
  peer.signal(SIGINT);
  EXPECT_EQ(peer.wait(), 0) << peer.err();
  EXPECT_TRUE(sees("contacts 'world' 'ground drone uncertain' 1 5 2 "));
  late.signal(SIGINT);
  EXPECT_EQ(late.wait(), 0) << late.err();
  std::string err;
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber", on_bus({"watch"}), nullptr, &err), 2);
  EXPECT_NE(err.find("--http or --ros2 is required"), std::string::npos) << err;
}

TEST_F(Ros2Flight, OfBodiesThatItCannotMoveIsRefused) {
  folder.write("sayings.txt", "");
  for (const auto& [poses, expected] : std::vector<std::pair<std::string, std::string>>{
           {"nobody", "no body of the scene is named nobody"},
           {"ground", "the scene itself says where ground is"},
           {"drone,drone=/x", "drone is named twice"},
           {"drone=/bad topic", "expected BODY, BODY=FRAME or BODY=/TOPIC"}}) {
    std::string err;
    EXPECT_EQ(
        test::run(folder, "nearmesh-subscriber",
                  on_bus({"run", folder.file("scene.yaml"), "--ros2-poses", poses}), nullptr, &err),
        1);
    EXPECT_NE(err.find(expected), std::string::npos) << err;
  }
}

}  // namespace
}  // namespace nearmesh
