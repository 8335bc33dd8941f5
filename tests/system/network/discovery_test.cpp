// SPDX-License-Identifier: Apache-2.0
// Hosts between which no multicast passes, whose programs find each other through
// nearmesh-publisher discovery alone.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "network_fixture.hpp"

namespace nearmesh::test {
namespace {

using Words = std::vector<std::string>;

class Discovery : public NetworkFixture {
 protected:
  std::unique_ptr<Process> start(const Lan& lan, std::size_t host, const std::string& program,
                                 Words words) const {
    const Lan::Visit there = lan.visit(host);
    words.insert(words.end(), {"--domain", "46"});
    return std::make_unique<Process>(folder, program, words);
  }
  static Words through(const std::string& server, Words words) {
    words.insert(words.end(), {"--transport", "udp-only", "--discovery-server", server});
    return words;
  }
  std::unique_ptr<Process> fly(const Lan& lan, std::size_t host, const std::string& scene,
                               const std::string& server) const {
    return start(lan, host, "nearmesh-subscriber",
                 through(server, {"run", folder.file(scene + ".yaml"), "--answers",
                                  folder.file(scene + ".jsonl")}));
  }
  void write_scene(const std::string& name, const std::string& moved, int flight,
                   const std::string& more = "") const {
    folder.write(name + ".yaml",
                 "bodies:\n  - {name: one, model: aircraft}\n  - {name: two, model: aircraft}\n"
                 "moves:\n  - {body: " +
                     moved + ", trajectory: flight" + std::to_string(flight) +
                     ".csv}\npairs: [[one, two]]\nframe_rate_hz: 20\nbudget_ms: 5\n" + more);
  }
};

TEST_F(Discovery, ServerAloneBringsProgramsTogetherWithoutMulticast) {
  constexpr int kFrames = 60;
  const std::string server = "10.77.0.1", nobody = "10.77.0.1:11812";
  const Lan lan({{}, {}, {}});
  for (const std::size_t host : {0, 1, 2}) {
    const Lan::Visit there = lan.visit(host);
    ASSERT_EQ(std::system("nft 'add table ip wall; add chain ip wall in { type filter hook input "
                          "priority 0; }; add rule ip wall in ip daddr 224.0.0.0/4 drop'"),
              0);
  }
  write_flights(folder, exercise(), kFrames, 20);
  write_scene("first", "one", 1);
  write_scene("second", "two", 2);
  write_scene("lost", "two", 2, "start_timeout_s: 5\n");
  const auto discovery = start(lan, 0, "nearmesh-publisher", {"discovery", "--listen", server});
  ASSERT_TRUE(discovery->says("ready: a discovery server")) << discovery->err();
  Words serving{"serve"};
  for (const std::string& model : exercise().models) serving.push_back(model);
  const auto publisher = start(lan, 0, "nearmesh-publisher", through(server, serving));
  ASSERT_TRUE(publisher->says("ready on domain")) << publisher->err();

  // Nobody else is there for who names another server.
  const auto lost = fly(lan, 1, "lost", nobody);
  const auto first = fly(lan, 1, "first", server), second = fly(lan, 2, "second", server);
  ASSERT_EQ(first->wait(), 0) << first->err();
  ASSERT_EQ(second->wait(), 0) << second->err();
  EXPECT_EQ(lost->wait(), 1) << lost->err();
  EXPECT_NE(lost->err().find("no publisher found"), std::string::npos) << lost->err();
  for (const char* scene : {"first", "second"}) {
    int certified = 0;
    for (const std::string& line :
         lines_of(read_text(folder.file(std::string(scene) + ".jsonl")))) {
      const auto answer = nlohmann::json::parse(line);
      if (answer.contains("frame")) certified += answer["status"] == "uncertain" ? 0 : 1;
    }
    EXPECT_GT(certified, 0) << scene;
  }
  discovery->signal(SIGINT);
  EXPECT_EQ(discovery->wait(), 0) << discovery->err();
}

}  // namespace
}  // namespace nearmesh::test
