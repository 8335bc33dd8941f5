// SPDX-License-Identifier: Apache-2.0
// The page that `report` writes: complete, self-contained, and shown by a browser without a complaint.
#include <regex>

#include "golden.hpp"
#include "subscriber/report/html_parts.hpp"

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
  /// What a shell command prints on both streams.
  [[nodiscard]] std::string shell(const std::string& command) const {
    const std::string out = folder_.file("shell.txt");
    EXPECT_EQ(std::system((command + " >'" + out + "' 2>&1").c_str()), 0) << read_text(out);
    return read_text(out);
  }
  const Folder folder_;
};

constexpr const char* kSections[] = {"summary", "pictures", "accuracy", "contacts", "timeline"};

TEST_F(Report, HasEverySectionAndNeedsNothingElse) {
  const std::string html = page();
  for (const char* section : kSections)
    EXPECT_EQ(count(html, std::string("<section id=\"") + section + "\">"), 1U) << section;
  EXPECT_TRUE(html == page()) << "the same session, the same page";
  // No address of anything outside; data:, keeps the browser from asking for an icon.
  EXPECT_FALSE(
      std::regex_search(html, std::regex("(src|href|action)=\"(?!data:,\")|url\\(|@import|://")));
  // First contact, most contacts, largest replicas; at least two different ones, with meshes in them.
  EXPECT_GE(count(html, "class=\"picture\""), 2U);
  EXPECT_GT(count(html, "<path color"), 500U);
  EXPECT_GE(count(html, "class=\"contact\""), 1U);
  // Every drawing has a text in its place.
  EXPECT_EQ(count(html, "<svg role=\"img\""), count(html, "</desc>"));
  EXPECT_EQ(count(html, "<svg role=\"img\""), count(html, "<figure"));
  EXPECT_EQ(count(html, "<h1>"), 1U);
}

TEST_F(Report, PicturesTheMomentsAskedFor) {
  const std::string html = page({"--at", "1", "--at", "2.5"});
  EXPECT_EQ(count(html, "class=\"picture\""), 2U);
  EXPECT_EQ(count(html, "<strong>At 1 s"), 1U);
  EXPECT_EQ(count(html, "<strong>At 2.5 s"), 1U);
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

TEST_F(Report, BrowserShowsItWithoutComplaint) {
  std::string browser;
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
    if (browser.empty() &&
        std::system((std::string("command -v ") + name + " >/dev/null 2>&1").c_str()) == 0)
      browser = name;
  if (browser.empty()) GTEST_SKIP() << "no Chromium here (Debian package chromium)";
  page();
  // A profile of its own for each run, and a second try: a browser that starts on a busy machine may hang.
  const auto show = [&](const std::string& what) {
    std::string command = "for n in 1 2; do HOME='" + folder_.path() + "' timeout 60 " + browser +
                          " --headless --no-sandbox --disable-gpu --enable-logging=stderr "
                          "--disable-background-networking --user-data-dir=\"$(mktemp -d -p '" +
                          folder_.path() + "')\" " + what + " 'file://" + path() +
                          "' && exit 0; done; exit 1";
    return shell("(" + command + ")");
  };
  const std::string dom = show("--dump-dom");
  EXPECT_EQ(dom.find("CONSOLE"), std::string::npos) << dom.substr(0, 2000);
  for (const char* section : kSections)
    EXPECT_EQ(count(dom, std::string("<section id=\"") + section + "\">"), 1U) << section;
  EXPECT_GT(count(dom, "<path color"), 500U);
  show("--window-size=1000,1400 --screenshot='" + folder_.file("page.png") + "'");
  // A blank page of this size takes some 10 KB.
  EXPECT_GT(std::filesystem::file_size(folder_.file("page.png")), 40'000U);
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
