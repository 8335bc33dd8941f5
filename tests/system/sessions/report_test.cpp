// SPDX-License-Identifier: Apache-2.0
// The page that `report` writes: complete, self-contained, and shown by a browser without a
// complaint.
#include "golden.hpp"
#include "subscriber/report/html_parts.hpp"
#include "subscriber/report/player_page.hpp"

namespace nearmesh {
namespace {

using namespace test;

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1))
    ++found;
  return found;
}

class Report : public ::testing::Test {
 protected:
  std::string page(const std::vector<std::string>& more = {}) {
    std::vector<std::string> words{"report", golden_session(folder_), "-o",
                                   folder_.file("deep/report")};
    words.insert(words.end(), more.begin(), more.end());
    std::string err;
    EXPECT_EQ(run(folder_, "nearmesh-subscriber", words, nullptr, &err), 0) << err;
    return read_text(path());
  }
  [[nodiscard]] std::string path() const { return folder_.file("deep/report/index.html"); }
  const Folder folder_;
};

constexpr const char* kSections[] = {"player", "summary", "accuracy", "contacts", "timeline"};

TEST_F(Report, HasEverySectionAndNeedsNothingElse) {
  const std::string html = page();
  if (subscriber::report::player_files().three.empty()) {
    EXPECT_EQ(count(html, subscriber::report::kNoPlayer), 1U);
    EXPECT_EQ(count(html, "<script"), 0U);
    GTEST_SKIP() << "built without three.js (Debian package libjs-three)";
  }
  for (const char* section : kSections)
    EXPECT_EQ(count(html, std::string("<section id=\"") + section + "\""), 1U) << section;
  EXPECT_TRUE(html == page()) << "the same session, the same page";
  // No address of anything outside; data:, keeps the browser from asking for an icon. three.js
  // names its home and XML's.
  std::string ours = html;
  const std::string_view three = subscriber::report::player_files().three;
  for (const std::string_view other : {three, subscriber::report::player_files().three_licence})
    ours.erase(ours.find(other), other.size());
  EXPECT_EQ(count(ours, "://"), 0U);
  EXPECT_EQ(count(ours, "url("), 0U);
  EXPECT_EQ(count(ours, "@import"), 0U);
  for (const char* attribute : {" src=\"", " href=\"", " action=\""})
    EXPECT_EQ(count(ours, attribute), count(ours, attribute + std::string("data:,\"")))
        << attribute;
  // What a browser shows of it: BrowserUsesIt.
  EXPECT_EQ(count(html, "<script type=\"text/plain\" id=\"film-"), 2 + 3 * 2U) << "two peers";
  // Every drawing has a text in its place.
  EXPECT_EQ(count(html, "<svg role=\"img\""), count(html, "</desc>"));
  EXPECT_EQ(count(html, "<svg role=\"img\""), count(html, "<figure"));
  EXPECT_EQ(count(html, "<h1>"), 1U);
}

TEST_F(Report, SaysWhatIsWrong) {
  const std::string session = golden_session(folder_);
  folder_.write("file", "");
  std::string err;
  EXPECT_EQ(run(folder_, "nearmesh-subscriber",
                {"report", session, "-o", folder_.file("file") + "/in"}, nullptr, &err),
            1);
  EXPECT_NE(err.find("cannot create"), std::string::npos) << err;
  EXPECT_EQ(run(folder_, "nearmesh-subscriber",
                {"report", folder_.file("file"), "-o", folder_.file("out")}, nullptr, &err),
            1);
  EXPECT_NE(err.find("not a recorded session"), std::string::npos) << err;
  EXPECT_FALSE(std::filesystem::exists(folder_.file("out")));
}

// Counts, colours at known places, playing, jumping, and no complaint on the console:
// look_at_page.py.
TEST_F(Report, BrowserUsesIt) {
  if (subscriber::report::player_files().three.empty())
    GTEST_SKIP() << "built without three.js (Debian package libjs-three)";
  page();
  const std::string out = folder_.file("looked.txt");
  const int status = std::system((std::string("python3 '") + NEARMESH_SESSION_SOURCE +
                                  "/tests/system/sessions/look_at_page.py' '" + path() + "' '" +
                                  golden_file("info.json") + "' >'" + out + "' 2>&1")
                                     .c_str());
  if (WEXITSTATUS(status) == 77) GTEST_SKIP() << read_text(out);
  EXPECT_EQ(status, 0) << read_text(out);
}

TEST(Escape, LeavesNothingThatIsMarkup) {
  using subscriber::report::escape;
  EXPECT_EQ(escape("<b a=\"1\">&"), "&lt;b a=&quot;1&quot;&gt;&amp;");
  EXPECT_EQ(escape("Kübel"), "Kübel");
  EXPECT_EQ(escape("\xc3"), "?");
  EXPECT_EQ(escape("a\xff\x01z"), "a??z");
  EXPECT_EQ(escape("\xc3<"), "?&lt;");
}

}  // namespace
}  // namespace nearmesh
