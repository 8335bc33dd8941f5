// SPDX-License-Identifier: Apache-2.0
// A recording that was made once is read, proved, analysed and asked as the documents say; one of
// another version is refused.
#include <sqlite3.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "golden.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "subscriber/recorded/verify.hpp"

namespace nearmesh {
namespace {

using test::Folder;

std::string output_of(const Folder& folder, const std::string& program,
                      const std::vector<std::string>& words) {
  std::string out, err;
  EXPECT_EQ(test::run(folder, program, words, &out, &err), 0) << err;
  return out;
}

TEST(GoldenSession, InfoSaysTheSame) {
  const Folder folder;
  const std::string session = test::golden_session(folder);
  test::expect_golden(output_of(folder, "nearmesh-subscriber", {"info", session}), "info.txt");
  test::expect_golden(output_of(folder, "nearmesh-subscriber", {"info", session, "--json"}),
                      "info.json");
}

TEST(GoldenSession, VerifiesWithAnyNumberOfThreads) {
  const Folder folder;
  const std::string session = test::golden_session(folder);
  for (const char* threads : {"1", "2", "5"})
    test::expect_golden(
        output_of(folder, "nearmesh-subscriber", {"verify", session, "--threads", threads}),
        "verify.txt");
}

TEST(GoldenSession, HasWhatIsWorthKeeping) {
  const Folder folder;
  const auto reader = RecordingReader::open(test::golden_session(folder)).value();
  const auto report = subscriber::verify(*reader, {});
  ASSERT_TRUE(report.is_ok()) << report.status().message();
  EXPECT_EQ(report.value().different + report.value().lacking + report.value().gave_up, 0U);
  EXPECT_EQ(report.value().peers, 2U);
  EXPECT_LT(std::filesystem::file_size(test::golden_file("session_v1.db3")), 300'000U);
}

// ---- another wire version -----------------------------------------------------------------------

TEST(OtherVersion, IsRefusedByAllThatReadsASession) {
  const Folder folder;
  const std::string session = test::golden_session(folder);
  sqlite3* opened = nullptr;
  ASSERT_EQ(sqlite3_open(session.c_str(), &opened), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(opened, "UPDATE nearmesh_session SET wire_version = 4", nullptr, nullptr,
                         nullptr),
            SQLITE_OK);
  sqlite3_close(opened);
  struct Reader {
    const char* program;
    std::vector<std::string> words;
  };
  for (const auto& [program, words] : std::vector<Reader>{
           {"nearmesh-subscriber", {"info", session}},
           {"nearmesh-subscriber", {"verify", session}},
           {"nearmesh-subscriber", {"report", session, "-o", folder.file("report")}},
           {"nearmesh-subscriber",
            {"export", session, "--time", "2", "--peer", "00000000000000b1", "-o",
             folder.file("mesh.ply")}},
           {"nearmesh-publisher", {"replay", session}},
           {"nearmesh-example-read-session", {session}}}) {
    if (!std::filesystem::exists(NEARMESH_BIN_DIR + std::string("/") + program)) continue;
    std::string out, err;
    EXPECT_EQ(test::run(folder, program, words, &out, &err), 1) << program << " " << words[0];
    EXPECT_NE(err.find(wire::check_recorded_version(4).message()), std::string::npos) << err;
    EXPECT_EQ(out, "") << program << " " << words[0];
  }
}

// ---- the questions of docs/sessions.md ----------------------------------------------------------

std::vector<std::string> sql_of(const std::string& page) {
  std::vector<std::string> statements;
  const std::string open = "```sql\n", close = "```";
  for (std::size_t at = page.find(open); at != std::string::npos; at = page.find(open, at)) {
    at += open.size();
    const std::size_t end = page.find(close, at);
    statements.push_back(page.substr(at, end - at));
  }
  return statements;
}

/// As `sqlite3 -header` prints it.
std::string ask(const std::string& session, const std::string& sql) {
  sqlite3* opened = nullptr;
  EXPECT_EQ(sqlite3_open_v2(session.c_str(), &opened, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> database(opened, sqlite3_close);
  std::string out;
  const auto add = [](void* to, int columns, char** values, char** names) {
    auto& text = *static_cast<std::string*>(to);
    for (char** row : text.empty() ? std::vector{names, values} : std::vector{values})
      for (int i = 0; i < columns; ++i)
        text += std::string(row[i] == nullptr ? "" : row[i]) + (i + 1 < columns ? "|" : "\n");
    return 0;
  };
  char* error = nullptr;
  EXPECT_EQ(sqlite3_exec(opened, sql.c_str(), add, &out, &error), SQLITE_OK)
      << (error == nullptr ? "" : error) << "\n"
      << sql;
  sqlite3_free(error);
  return out;
}

TEST(GoldenSession, AnswersTheQuestionsOfTheDocument) {
  const Folder folder;
  const std::string session = test::golden_session(folder);
  const auto statements =
      sql_of(test::read_text(std::string(NEARMESH_SESSION_SOURCE) + "/docs/sessions.md"));
  ASSERT_EQ(statements.size(), 3U);
  std::string found;
  for (const std::string& statement : statements) found += ask(session, statement) + "\n";
  test::expect_golden(found, "questions.txt");
}

// What plain SQL reads out of the bytes is what the decoder reads.
TEST(GoldenSession, SqlAgreesWithTheDecoder) {
  const Folder folder;
  const std::string session = test::golden_session(folder);
  const auto reader = RecordingReader::open(session).value();
  std::map<std::string, std::pair<double, double>> first;  // touch and certified, by pair
  const Status status = reader->read(
      1, reader->message_count() + 1, [&](std::int64_t, const RecordedMessage& message) {
        const auto& type = reader->topics()[reader->writers()[message.writer].topic].type;
        if (type != "nearmesh::wire_types::ContactReportSample") return true;
        const auto report = wire::decode_payload<wire::ContactReport>(message.cdr).value();
        char key[200];
        std::snprintf(key, sizeof key, "%016llx|%s|%s",
                      static_cast<unsigned long long>(report.peer), report.body_a.c_str(),
                      report.body_b.c_str());
        auto& [touch, certified] = first.try_emplace(key, -1, -1).first->second;
        const double now = static_cast<double>(message.received_ns - reader->begin_ns()) * 1e-9;
        if (report.pair_count > 0 && touch < 0) touch = now;
        if (report.status != 2 && report.status != 3 && certified < 0) certified = now;
        return true;
      });
  ASSERT_TRUE(status.is_ok());
  const auto statements =
      sql_of(test::read_text(std::string(NEARMESH_SESSION_SOURCE) + "/docs/sessions.md"));
  const auto lines = test::lines_of(ask(session, statements.back()));
  ASSERT_EQ(lines.size(), first.size() + 1);
  std::size_t touching = 0;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const std::size_t last = lines[i].rfind('|'), before = lines[i].rfind('|', last - 1);
    ASSERT_TRUE(first.contains(lines[i].substr(0, before))) << lines[i];
    const auto [touch, certified] = first.at(lines[i].substr(0, before));
    const std::string text = lines[i].substr(before + 1, last - before - 1);
    EXPECT_NEAR(text.empty() ? -1 : std::stod(text), touch, 1e-3) << lines[i];
    EXPECT_NEAR(std::stod(lines[i].substr(last + 1)), certified, 1e-3) << lines[i];
    touching += touch >= 0 ? 1 : 0;
  }
  EXPECT_GT(touching, 0U);
}

TEST(ReadSession, PrintsTheExpectedOutput) {
  const std::string program = NEARMESH_BIN_DIR "/nearmesh-example-read-session";
  if (!std::filesystem::exists(program)) GTEST_SKIP() << "built without examples";
  const Folder folder;
  const std::string example = std::string(NEARMESH_SESSION_SOURCE) + "/examples/read_session";
  const std::string expected = test::read_text(example + "/expected_output.txt");
  EXPECT_EQ(output_of(folder, "nearmesh-example-read-session", {test::golden_session(folder)}),
            expected);
  EXPECT_NE(test::read_text(example + "/README.md").find("```\n" + expected + "```"),
            std::string::npos);
  EXPECT_LT(test::lines_of(test::read_text(example + "/main.cpp")).size(), 60U);
  std::string err;
  EXPECT_EQ(test::run(folder, "nearmesh-example-read-session", {"none.db3"}, nullptr, &err), 1);
  EXPECT_NE(err.find("none.db3"), std::string::npos) << err;
}

}  // namespace
}  // namespace nearmesh
