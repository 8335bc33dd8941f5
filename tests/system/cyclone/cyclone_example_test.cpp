// SPDX-License-Identifier: Apache-2.0
// examples/cyclone, flown: a body that a program of another vendor moves, and what it prints of the answers. UDP on 127.0.0.1.

#include "tests/system/integration/process.hpp"

namespace nearmesh {
namespace {

TEST(CycloneExample, MovesABodyAndPrintsTheAnswersAboutIt) {
  // Loopback offers no multicast to Cyclone: found by unicast. Datagrams as large as Fast DDS reads them here.
  ::setenv("CYCLONEDDS_URI",
           "<General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
           "<AllowMulticast>false</AllowMulticast>"
           "<MaxMessageSize>1400B</MaxMessageSize><FragmentSize>1200B</FragmentSize></General>"
           "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
           "<Peers><Peer address='127.0.0.1'/></Peers></Discovery>",
           1);
  const test::Folder folder;
  // Without '-', which Cyclone DDS does not take in a topic's name.
  const std::string prefix = "example_" + std::to_string(::getpid());
  const auto on_bus = [&](std::vector<std::string> words) {
    words.insert(words.end(), {"--domain", "95", "--prefix", prefix, "--interface", "127.0.0.1"});
    return words;
  };
  folder.write("scene.yaml",
               "bodies:\n"
               "  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: drone, model: aircraft}\n"
               "pairs: [[ground, drone]]\n"
               "max_pose_age_s: 1\n");
  const std::string aircraft = test::model_file("aircraft", 600);
  test::Process publisher(folder, "nearmesh-publisher",
                          on_bus({"serve", test::model_file("terrain", 48), aircraft}));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  test::Process peer(folder, "nearmesh-subscriber", on_bus({"run", folder.file("scene.yaml")}));
  // From high above the ground into it, and there it stays.
  test::Process cyclone(
      folder, "nearmesh-example-cyclone",
      {"--domain", "95", "--prefix", prefix, "--own", "drone", "aircraft", "--pin", aircraft,
       "--from", "0", "0", "800", "--to", "0", "0", "165", "--flight", "10"});
  const auto prints = [&](const std::string& text) {
    return test::await([&] { return cyclone.out().find(text) != std::string::npos; });
  };
  ASSERT_TRUE(prints("\nmodel terrain ")) << cyclone.out();
  ASSERT_TRUE(prints("\nmodel aircraft ")) << cyclone.out();
  ASSERT_TRUE(prints("body drone of model aircraft, moved by ")) << cyclone.out();
  ASSERT_TRUE(prints(": ground drone free, ")) << cyclone.out() << peer.err();
  ASSERT_TRUE(prints(": ground drone contact, ")) << cyclone.out() << peer.err();
  ASSERT_TRUE(prints(" s: 0.000 0.000 165.000 m\n")) << cyclone.out();
  cyclone.signal(SIGINT);
  EXPECT_EQ(cyclone.wait(), 0) << cyclone.err();
  // Who has left is not taken for one who stays where it was.
  EXPECT_FALSE(peer.is_over()) << peer.err();
  peer.signal(SIGINT);
  EXPECT_EQ(peer.wait(), 0) << peer.err();
}

}  // namespace
}  // namespace nearmesh
