// SPDX-License-Identifier: Apache-2.0
// Two files of one name, live: what peers answer about, and what everybody is told. Processes that
// talk over 127.0.0.1.

#include <nlohmann/json.hpp>

#include "process.hpp"

namespace nearmesh {
namespace {

using nlohmann::json;
using test::Folder;
using test::Process;

class Contents : public ::testing::Test {
 protected:
  Contents() {
    for (const auto& [where, size] : {std::pair{"a", 48}, std::pair{"b", 40}}) {
      std::filesystem::create_directory(folder.file(where));
      std::filesystem::copy_file(test::model_file("terrain", size), terrain(where));
    }
    content_a = content_of(terrain("a"));
    content_b = content_of(terrain("b"));
  }

  Folder folder;
  std::string content_a, content_b;

  [[nodiscard]] std::string terrain(const std::string& where) const {
    return folder.file(where + "/terrain.spm");
  }
  [[nodiscard]] std::string content_of(const std::string& path) const {
    std::string out, err;
    EXPECT_EQ(test::run(folder, "nearmesh-model", {"info", path}, &out, &err), 0) << err;
    const std::size_t at = out.find("content: ");
    return at == std::string::npos ? "" : out.substr(at + 9, out.find('\n', at) - at - 9);
  }
  static std::vector<std::string> with(std::vector<std::string> words) {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    for (const std::string& word :
         {std::string("--domain"), std::string("147"), std::string("--prefix"),
          "content-" + std::to_string(::getpid()) + "/" + test->name(), std::string("--interface"),
          std::string("127.0.0.1")})
      words.push_back(word);
    return words;
  }
  std::unique_ptr<Process> serve(std::vector<std::string> words) const {
    words.insert(words.begin(), "serve");
    auto publisher = std::make_unique<Process>(folder, "nearmesh-publisher", with(words));
    EXPECT_TRUE(publisher->says("ready on domain")) << publisher->err();
    return publisher;
  }
  static void end(Process& process) {
    process.signal(SIGTERM);
    EXPECT_EQ(process.wait(), 0) << process.err();
  }
  /// An aircraft over ground, whose line in the scene may have more in it.
  void write_scene(int frames, const std::string& more, double start_timeout_s = 90) const {
    std::string err;
    ASSERT_EQ(test::run(folder, "nearmesh-demo-flights",
                        {folder.path(), "--size", "40", "--frames", std::to_string(frames),
                         "--rate", "50"},
                        nullptr, &err),
              0)
        << err;
    folder.write("flight.yaml",
                 "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}" +
                     more +
                     "}\n  - {name: one, model: aircraft}\n"
                     "moves:\n  - {body: one, trajectory: flight1.csv}\n"
                     "pairs: [[ground, one]]\nframe_rate_hz: 50\nbudget_ms: 5\n"
                     "start_timeout_s: " +
                     std::to_string(start_timeout_s) + "\n");
  }
  /// Asks status until it tells of so many errors.
  [[nodiscard]] bool status_has_errors(std::size_t count, json& errors) const {
    std::string out;
    return test::run_until(folder, "nearmesh-subscriber",
                           with({"status", "--json", "--seconds", "1.5"}), out, [&] {
                             const json told = json::parse(out);
                             errors = told.at("errors");
                             return errors.size() == count && !told.at("publishers").empty();
                           });
  }
  /// Whether the contradicting answers among these lines are none.
  [[nodiscard]] std::string checked(const std::vector<std::string>& lines,
                                    const std::string& ground) const {
    std::string text, out, err;
    for (const std::string& line : lines) text += line + "\n";
    folder.write("part.jsonl", text);
    EXPECT_EQ(test::run(folder, "nearmesh-model",
                        {"check", ground, test::model_file("aircraft", 600), "--answers",
                         folder.file("part.jsonl")},
                        &out, &err),
              0)
        << err;
    return out;
  }
};

TEST_F(Contents, StayAreReplacedAndComeBackByActsAlone) {
  write_scene(20'000, "");
  const auto first = serve({terrain("a"), test::model_file("aircraft", 600)});
  const std::string answers = folder.file("answers.jsonl");
  Process peer(folder, "nearmesh-subscriber",
               with({"run", folder.file("flight.yaml"), "--answers", answers}));
  const auto count = [&] { return test::lines_of(test::read_text(answers)).size(); };
  const auto flies_on = [&](std::size_t lines) {
    const std::size_t now = count();
    return test::await([&] { return count() > now + lines; });
  };
  ASSERT_TRUE(flies_on(20)) << peer.err();

  // A rival by mistake: everybody says so, nobody takes it.
  {
    const auto rival = serve({terrain("b")});
    EXPECT_TRUE(peer.says("serves content " + content_b + " under this name; content " + content_a +
                          " is held and stays"))
        << peer.err();
    EXPECT_TRUE(first->says("serves other content, " + content_b)) << first->err();
    EXPECT_TRUE(rival->says("serves other content, " + content_a)) << rival->err();
    EXPECT_TRUE(flies_on(50));
    json errors;
    ASSERT_TRUE(status_has_errors(1, errors)) << errors;
    for (const std::string& content : {content_a, content_b})
      EXPECT_NE(errors[0].get<std::string>().find(content), std::string::npos) << errors;
    EXPECT_EQ(peer.err().find("starting again"), std::string::npos) << peer.err();
    end(*rival);
  }
  // An act: the one that says what it replaces.
  {
    const auto second = serve({terrain("b"), "--replaces", "terrain=" + content_a});
    EXPECT_TRUE(peer.says("replaces content " + content_a + " by " + content_b)) << peer.err();
    EXPECT_TRUE(first->says("replaces content " + content_a + ", which is served here"))
        << first->err();
    EXPECT_TRUE(flies_on(50));
    json errors;
    EXPECT_TRUE(status_has_errors(0, errors)) << errors;
    end(*second);
  }
  // Its end: back to what is left.
  EXPECT_TRUE(peer.says("no publisher of content " + content_b + " is there any more"))
      << peer.err();
  EXPECT_TRUE(flies_on(50));
  peer.signal(SIGINT);
  EXPECT_EQ(peer.wait(), 0) << peer.err();

  // Each answer names what it is about, and is true of that.
  std::vector<std::string> of_a, of_b, order;
  for (const std::string& text : test::lines_of(test::read_text(answers))) {
    const json line = json::parse(text);
    if (line.contains("summary") || line.at("content_a").is_null()) continue;
    const auto content = line["content_a"].get<std::string>();
    if (order.empty() || order.back() != content) order.push_back(content);
    (content == content_a ? of_a : of_b).push_back(text);
  }
  EXPECT_EQ(order, (std::vector{content_a, content_b, content_a}));
  EXPECT_NE(checked(of_a, terrain("a")).find("wrong 0"), std::string::npos);
  EXPECT_NE(checked(of_b, terrain("b")).find("wrong 0"), std::string::npos);
}

TEST_F(Contents, PinnedOnesAreTheOnlyOnesTaken) {
  const auto first = serve({terrain("a"), test::model_file("aircraft", 600)});
  std::string err;
  const std::string refusal =
      "serves content " + content_a + " under this name; content " + content_b + " is pinned";
  // Until it has found the publisher it says that there is none: on a busy machine it is given more
  // time.
  for (int seconds = 4; seconds <= 64 && err.find(refusal) == std::string::npos; seconds *= 2) {
    write_scene(10, ", content: " + content_b, seconds);
    EXPECT_EQ(test::run(folder, "nearmesh-subscriber", with({"run", folder.file("flight.yaml")}),
                        nullptr, &err),
              1);
  }
  EXPECT_NE(err.find("no certified answer within"), std::string::npos) << err;
  EXPECT_NE(err.find("body ground: publisher"), std::string::npos) << err;
  EXPECT_NE(err.find(refusal), std::string::npos) << err;
  const auto second = serve({terrain("b")});
  write_scene(10, ", content: " + content_b);
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber",
                      with({"run", folder.file("flight.yaml"), "--answers",
                            folder.file("answers.jsonl")}),
                      nullptr, &err),
            0)
      << err;
  for (const std::string& text : test::lines_of(test::read_text(folder.file("answers.jsonl")))) {
    const json line = json::parse(text);
    if (!line.contains("summary")) {
      EXPECT_EQ(line.at("content_a"), content_b);
    }
  }
}

TEST_F(Contents, MistakesInReplacesAreNamed) {
  struct Case {
    std::string words, expected;
  };
  for (const Case& wrong :
       std::vector<Case>{{"terrain", "replaces: expected MODEL=CONTENT, found 'terrain'"},
                         {"terrain=123", "replaces: terrain=123: content: expected"},
                         {"ground=" + content_b, "replaces: no model ground is served here"},
                         {"terrain=" + content_b + "@1", "an epoch from 1 and seconds"},
                         {"terrain=" + content_b + "@0:10", "an epoch from 1 and seconds"},
                         {"terrain=" + content_b + "@1:10s", "an epoch from 1 and seconds"},
                         {"terrain=" + content_b + "@1:nan", "an epoch from 1 and seconds"},
                         {"terrain=" + content_a, "which it cannot replace"}}) {
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-publisher",
                        with({"serve", terrain("a"), "--replaces", wrong.words}), nullptr, &err),
              1);
    EXPECT_NE(err.find(wrong.expected), std::string::npos) << err;
  }
}

}  // namespace
}  // namespace nearmesh
