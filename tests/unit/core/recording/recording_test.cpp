// SPDX-License-Identifier: Apache-2.0
// The file of a recording: what is written is read; what was committed outlives kills, full disks
// and foreign readers.
#include "nearmesh/core/recording/recording.hpp"

#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <thread>

#include "core/base/random.hpp"
#include "core/base/stopwatch.hpp"
#include "tests/support/folder.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;

constexpr auto kNobodyWrites = static_cast<fs::perms>(0555);

class Recording : public ::testing::Test {
 protected:
  [[nodiscard]] std::string path(const std::string& name = "s.db3") const {
    return (folder_ / name).string();
  }
  const test::Folder scratch_;
  const fs::path folder_ = scratch_.path();
};

RecordingFacts facts(std::uint32_t part = 0) {
  return {0xabcdef, part, 3, "prefix", "module m {};"};
}

RecordedMessage message(std::uint64_t number, std::uint32_t writer = 0, std::size_t size = 300) {
  RecordedMessage m{.writer = writer,
                    .sequence = number,
                    .received_ns = static_cast<std::int64_t>(number) * 10,
                    .source_ns = static_cast<std::int64_t>(number) * 10 - 3};
  Random random(number);
  for (std::size_t i = 0; i < size; ++i)
    m.cdr.push_back(static_cast<std::uint8_t>(random.below(256)));
  return m;
}

std::unique_ptr<RecordingWriter> start(const std::string& path, std::uint32_t part = 0,
                                       double period_s = RecordingWriter::kCommitPeriod_s) {
  auto created = RecordingWriter::create(path, facts(part), period_s);
  EXPECT_TRUE(created.is_ok()) << created.status().message();
  std::unique_ptr<RecordingWriter> writer = std::move(created).value();
  EXPECT_EQ(writer->add_topic({"prefix/pose", "Pose"}).value(), 0U);
  EXPECT_EQ(writer->add_topic({"prefix/batch", "Batch"}).value(), 1U);
  EXPECT_EQ(writer->add_writer({0, EndpointGuid{1, 2, 3}, ""}).value(), 0U);
  EXPECT_EQ(writer->add_writer({1, EndpointGuid{4, 5, 6}, "00aa"}).value(), 1U);
  return writer;
}

std::unique_ptr<RecordingReader> open(const std::string& path) {
  auto opened = RecordingReader::open(path);
  EXPECT_TRUE(opened.is_ok()) << opened.status().message();
  return std::move(opened).value();
}

/// Expects messages 1, 2, ... as message() makes them; gives their number.
std::uint64_t count_right(RecordingReader& reader) {
  std::uint64_t count = 0;
  const Status status =
      reader.read(1, reader.message_count() + 1, [&](std::int64_t id, const RecordedMessage& m) {
        ++count;
        const RecordedMessage expected = message(count, m.writer, m.cdr.size());
        EXPECT_EQ(id, static_cast<std::int64_t>(count));
        EXPECT_EQ(m.sequence, count);
        EXPECT_EQ(m.received_ns, expected.received_ns);
        EXPECT_EQ(m.source_ns, expected.source_ns);
        EXPECT_EQ(m.cdr, expected.cdr);
        return !::testing::Test::HasFailure();
      });
  EXPECT_TRUE(status.is_ok()) << status.message();
  EXPECT_EQ(count, static_cast<std::uint64_t>(reader.message_count()));
  return count;
}

/// First column of the first row.
std::string ask(const std::string& path, const std::string& sql) {
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  sqlite3_stmt* rows = nullptr;
  EXPECT_EQ(sqlite3_prepare_v2(database, sql.c_str(), -1, &rows, nullptr), SQLITE_OK)
      << sqlite3_errmsg(database);
  std::string answer;
  if (sqlite3_step(rows) == SQLITE_ROW)
    answer = reinterpret_cast<const char*>(sqlite3_column_text(rows, 0));
  sqlite3_finalize(rows);
  sqlite3_close(database);
  return answer;
}

/// Three parts or so, of messages 1 to 10, 11 to 20, ...
void record_parts(const std::string& path, std::uint32_t parts) {
  for (std::uint32_t part = 0; part < parts; ++part) {
    auto writer = start(part_path(path, part), part);
    for (std::uint64_t i = 1; i <= 10; ++i)
      ASSERT_TRUE(writer->append(message(10 * part + i, i % 2), "one").is_ok());
    ASSERT_TRUE(writer->add_model({{1, part + 1}, "hull", 1}).is_ok());
    ASSERT_TRUE(writer->close().is_ok());
  }
}

/// A recording of one message, of another session.
void record_stranger(const std::string& path, std::uint32_t part) {
  RecordingFacts theirs = facts(part);
  theirs.session = 0x123;
  const auto writer = RecordingWriter::create(path, theirs).value();
  ASSERT_TRUE(writer->add_topic({"prefix/pose", "Pose"}).is_ok());
  ASSERT_TRUE(writer->add_writer({0, EndpointGuid{7}, ""}).is_ok());
  ASSERT_TRUE(writer->append(message(1)).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
}

/// Expects that the recording is refused in words that hold these.
void expect_refused(const std::string& path, StatusCode code,
                    const std::vector<std::string>& words) {
  const Status status = RecordingReader::open(path).status();
  EXPECT_EQ(status.code(), code) << status.message();
  for (const std::string& word : words)
    EXPECT_NE(status.message().find(word), std::string::npos)
        << word << " in: " << status.message();
}

/// What a child process does until it ends by itself, or is killed.
pid_t fork_child(const std::function<void()>& work) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  work();
  ::_exit(0);
}

TEST_F(Recording, GivesBackWhatWasWritten) {
  auto writer = start(path());
  for (std::uint64_t i = 1; i <= 500; ++i)
    ASSERT_EQ(writer->append(message(i, i % 3 == 0, i % 7 == 0 ? 0 : 300)).value(),
              static_cast<std::int64_t>(i));
  ASSERT_TRUE(writer->add_gap({1, 17, 3, 900}).is_ok());
  ASSERT_TRUE(writer->add_model({{0x0123456789abcdef, 0xfedcba9876543210}, "terrain", 5}).is_ok());
  ASSERT_TRUE(writer->add_model({{0x0123456789abcdef, 0xfedcba9876543210}, "again", 9}).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  EXPECT_FALSE(fs::exists(path() + "-wal"));

  const auto reader = open(path());
  EXPECT_EQ(reader->facts().session, 0xabcdefU);
  EXPECT_EQ(reader->facts().wire_version, 3U);
  EXPECT_EQ(reader->facts().prefix, "prefix");
  EXPECT_EQ(reader->facts().idl, "module m {};");
  ASSERT_EQ(reader->topics().size(), 2U);
  EXPECT_EQ(reader->topics()[1].name, "prefix/batch");
  EXPECT_EQ(reader->topics()[1].type, "Batch");
  ASSERT_EQ(reader->writers().size(), 2U);
  EXPECT_EQ(reader->writers()[1].topic, 1U);
  EXPECT_EQ(reader->writers()[1].guid, (EndpointGuid{4, 5, 6}));
  EXPECT_EQ(reader->writers()[1].partition, "00aa");
  ASSERT_EQ(reader->gaps().size(), 1U);
  EXPECT_EQ(reader->gaps()[0].writer, 1U);
  EXPECT_EQ(reader->gaps()[0].first_sequence, 17U);
  EXPECT_EQ(reader->gaps()[0].count, 3U);
  ASSERT_EQ(reader->models().size(), 1U);
  EXPECT_EQ(reader->models()[0].content_hash,
            (ContentHash{0x0123456789abcdef, 0xfedcba9876543210}));
  EXPECT_EQ(reader->models()[0].name, "terrain");
  EXPECT_EQ(reader->models()[0].message, 5);
  EXPECT_EQ(reader->begin_ns(), 10);
  EXPECT_EQ(reader->end_ns(), 5000);
  EXPECT_EQ(count_right(*reader), 500U);
  for (const auto& [time, id] : {std::pair(0, 1), {10, 1}, {11, 2}, {4000, 400}, {5001, 501}})
    EXPECT_EQ(reader->find(time).value(), id);
}

TEST_F(Recording, HasTheTablesOfRosbag2) {
  auto writer = start(path());
  for (std::uint64_t i = 1; i <= 20; ++i) ASSERT_TRUE(writer->append(message(i)).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  // The question that its reader asks.
  EXPECT_EQ(
      ask(path(),
          "SELECT count(*) || ' ' || sum(length(data)) || ' ' || max(timestamp) || ' ' || "
          "topics.name "
          "FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp"),
      "20 6000 200 prefix/pose");
  EXPECT_EQ(ask(path(),
                "SELECT serialization_format || offered_qos_profiles || type_description_hash FROM "
                "topics"),
            "cdr");
  EXPECT_EQ(
      ask(path(),
          "SELECT encoded_message_definition FROM message_definitions WHERE topic_type = 'Batch'"),
      "module m {};");
  EXPECT_EQ(ask(path(), "SELECT schema_version FROM schema"), "4");
}

TEST_F(Recording, PartsAreReadAsOne) {
  std::uint64_t next = 1;
  for (std::uint32_t part = 0; part < 3; ++part) {
    auto writer = start(part_path(path(), part), part);
    for (const std::uint64_t end = next + 100; next < end; ++next)
      ASSERT_TRUE(writer->append(message(next, next % 2)).is_ok());
    if (part == 1) {
      ASSERT_TRUE(writer->add_model({{0, 7}, "late", 3}).is_ok());
    }
    ASSERT_TRUE(writer->close().is_ok());
  }
  EXPECT_TRUE(fs::exists(path("s_2.db3")));
  const auto reader = open(path());
  EXPECT_EQ(reader->parts(), 3U);
  EXPECT_EQ(reader->topics().size(), 2U);
  EXPECT_EQ(reader->models().at(0).message, 103);
  EXPECT_EQ(reader->end_ns(), 3000);
  EXPECT_EQ(count_right(*reader), 300U);
  EXPECT_EQ(reader->find(1995).value(), 200);
  EXPECT_EQ(reader->find(2005).value(), 201);
  std::vector<std::int64_t> ids;
  ASSERT_TRUE(reader
                  ->read(99, 103,
                         [&](std::int64_t id, const RecordedMessage&) {
                           ids.push_back(id);
                           return true;
                         })
                  .is_ok());
  EXPECT_EQ(ids, (std::vector<std::int64_t>{99, 100, 101, 102}));
  EXPECT_EQ(RecordingReader::open(path("s_1.db3")).status().code(), StatusCode::kInvalidArgument);
}

// Nothing follows it: a recorder that is killed while it begins a part leaves a database without
// tables.
TEST_F(Recording, APartThatWasNeverBegunIsTheEnd) {
  record_parts(path(), 2);
  std::ofstream(path("s_2.db3"));
  EXPECT_EQ(count_right(*open(path())), 20U);
  fs::remove(path("s_2.db3"));
  ask(path("s_2.db3"), "PRAGMA journal_mode=WAL");
  EXPECT_TRUE(fs::exists(path("s_2.db3")));
  EXPECT_EQ(count_right(*open(path())), 20U);
}

TEST_F(Recording, APartThatCannotBeReadIsRefusedAndNamed) {
  for (const std::string name : {"s_1.db3", "s_2.db3"}) {
    SCOPED_TRACE(name);
    const auto again = [&] {
      for (std::uint32_t part = 0; part < 3; ++part) fs::remove_all(part_path(path(), part));
      record_parts(path(), 3);
    };
    again();
    std::ofstream(path(name)) << std::string(5000, 'x');
    expect_refused(path(), StatusCode::kCorrupt, {path(name) + ": ", "of " + path()});
    again();
    ask(path(name), "DELETE FROM nearmesh_session");
    expect_refused(path(), StatusCode::kCorrupt, {path(name) + ": nearmesh_session is empty"});
    again();
    ask(path(name), "UPDATE nearmesh_session SET version = 99");
    expect_refused(path(), StatusCode::kUnsupported, {path(name) + ": recording version 99"});
    again();
    fs::remove(path(name));
    fs::create_directory(path(name));  // root may read every file
    expect_refused(path(), StatusCode::kIo, {path(name) + ": "});
  }
}

TEST_F(Recording, APartThatIsMissingIsNamed) {
  record_parts(path(), 4);
  const auto is_missing = [&](std::uint32_t part, std::uint32_t later, const std::string& found) {
    const auto words = [](std::uint32_t of) { return "part " + std::to_string(of) + " of "; };
    expect_refused(path(), StatusCode::kCorrupt,
                   {part_path(path(), part) + ": " + words(part), "is missing: found " + found,
                    words(later) + "it"});
  };
  fs::copy_file(path("s_1.db3"), path("kept"));
  fs::remove(path("s_1.db3"));
  is_missing(1, 2, "no file, and " + path("s_2.db3"));
  std::ofstream(path("s_1.db3"));
  is_missing(1, 2, "an empty file, and " + path("s_2.db3"));
  fs::remove(path("s_1.db3"));
  ask(path("s_1.db3"), "CREATE TABLE theirs(a)");
  is_missing(1, 2, "a database of another kind");
  fs::remove(path("s_1.db3"));
  record_stranger(path("s_1.db3"), 1);
  is_missing(1, 2, "part 1 of another, and " + path("s_2.db3"));
  fs::remove(path("s_1.db3"));
  fs::copy_file(path(), path("s_1.db3"));
  is_missing(1, 2, "part 0 of it, and " + path("s_2.db3"));
  fs::remove(path("s_1.db3"));
  fs::rename(path("s_2.db3"), path("s_1.db3"));  // as if the rest were counted anew
  is_missing(1, 2, "part 2 of it");
  fs::remove(path("s_1.db3"));
  is_missing(1, 3, "no file, and " + path("s_3.db3"));
  // Now the end, with nothing behind it.
  fs::remove(path("s_3.db3"));
  EXPECT_EQ(count_right(*open(path())), 10U);
  fs::rename(path("kept"), path("s_1.db3"));
  EXPECT_EQ(count_right(*open(path())), 20U);
}

TEST_F(Recording, FilesOfOthersWithNamesOfPartsAreNoParts) {
  record_parts(path(), 2);
  for (const char* name : {"s_01.db3", "s_3.db3.old", "s_x.db3", "s_99999999999.db3", "s_7.db3"})
    std::ofstream(path(name)) << std::string(5000, 'x');
  record_stranger(path("s_20250101.db3"), 0);
  record_stranger(path("s_8.db3"), 8);
  EXPECT_EQ(count_right(*open(path())), 20U);
  const std::pair<const char*, std::function<void(const std::string&)>> theirs[] = {
      {"another session", [](const std::string& file) { record_stranger(file, 2); }},
      {"another database", [](const std::string& file) { ask(file, "CREATE TABLE theirs(a)"); }},
      {"a copy", [this](const std::string& file) { fs::copy_file(path("s_1.db3"), file); }}};
  for (const auto& [what, put] : theirs) {
    SCOPED_TRACE(what);
    put(path("s_2.db3"));
    const auto reader = open(path());
    EXPECT_EQ(reader->parts(), 2U);
    EXPECT_EQ(count_right(*reader), 20U);
    fs::remove(path("s_2.db3"));
  }
}

TEST_F(Recording, AMessageThatIsMissingIsNamed) {
  for (const std::string lost :
       {"DELETE FROM messages WHERE id = 7", "DELETE FROM nearmesh_messages WHERE message_id = 7",
        "UPDATE messages SET id = -7 WHERE id = 7"}) {
    SCOPED_TRACE(lost);
    for (std::uint32_t part = 0; part < 3; ++part) fs::remove(part_path(path(), part));
    record_parts(path(), 3);
    ask(path("s_1.db3"), lost);
    const auto reader = open(path());
    EXPECT_EQ(reader->message_count(), 30);
    std::vector<std::int64_t> ids;
    const auto read = [&](std::int64_t first, std::int64_t end) {
      ids.clear();
      return reader->read(first, end, [&](std::int64_t id, const RecordedMessage& m) {
        EXPECT_EQ(m.sequence, static_cast<std::uint64_t>(id));
        ids.push_back(id);
        return id != 13;
      });
    };
    const auto expect_missing = [&](const Status& status) {
      EXPECT_EQ(status.code(), StatusCode::kCorrupt);
      EXPECT_EQ(status.message(), path("s_1.db3") + ": message 7 is missing");
    };
    expect_missing(read(14, 31));
    EXPECT_EQ(ids, (std::vector<std::int64_t>{14, 15, 16}));
    expect_missing(read(17, 18));  // alone
    expect_missing(read(15, 18));  // at the end
    EXPECT_TRUE(read(1, 31).is_ok()) << "ended before it";
    EXPECT_EQ(ids.back(), 13);
    EXPECT_TRUE(read(14, 17).is_ok());
    EXPECT_TRUE(read(18, 31).is_ok());
    EXPECT_EQ(ids.size(), 13U);
  }
}

TEST_F(Recording, AFirstOrLastMessageThatIsMissingIsNamed) {
  for (const std::string id : {"1", "10"}) {
    fs::remove(path());
    record_parts(path(), 1);
    ask(path(), "DELETE FROM messages WHERE id = " + id);
    expect_refused(path(), StatusCode::kCorrupt, {path() + ": message " + id + " is missing"});
  }
}

TEST_F(Recording, ALastIdThatCannotBeIsNotBelieved) {
  for (const std::string id : {"1000000", "9223372036854775807"})
    for (const std::string tables : {"1", "2", "12"}) {
      SCOPED_TRACE(id + " in " + tables);
      for (std::uint32_t part = 0; part < 2; ++part) fs::remove(part_path(path(), part));
      record_parts(path(), 2);
      if (tables != "2") ask(path("s_1.db3"), "UPDATE messages SET id = " + id + " WHERE id = 10");
      if (tables != "1")
        ask(path("s_1.db3"),
            "UPDATE nearmesh_messages SET message_id = " + id + " WHERE message_id = 10");
      expect_refused(path(), StatusCode::kCorrupt,
                     {path("s_1.db3") + ": the last message is " + id});
    }
  // One that the file would have room for.
  for (std::uint32_t part = 0; part < 2; ++part) fs::remove(part_path(path(), part));
  record_parts(path(), 2);
  ask(path("s_1.db3"), "UPDATE messages SET id = 100 WHERE id = 10");
  ask(path("s_1.db3"), "UPDATE nearmesh_messages SET message_id = 100 WHERE message_id = 10");
  const auto reader = open(path());
  const Status status = reader->read(1, reader->message_count() + 1,
                                     [](std::int64_t, const RecordedMessage&) { return true; });
  EXPECT_EQ(status.message(), path("s_1.db3") + ": message 10 is missing");
}

TEST_F(Recording, AModelOfNoMessageIsRefused) {
  for (const std::string id : {"0", "11", "9223372036854775807"}) {
    for (std::uint32_t part = 0; part < 2; ++part) fs::remove(part_path(path(), part));
    record_parts(path(), 2);
    ask(path("s_1.db3"), "UPDATE nearmesh_models SET message_id = " + id);
    expect_refused(path(), StatusCode::kCorrupt,
                   {path("s_1.db3") + ": nearmesh_models names no message"});
  }
}

// The least that a message takes: many of them still fit into their file.
TEST_F(Recording, MessagesOfNoBytesAreRead) {
  constexpr int kMessages = 20'000;
  auto writer = start(path());
  for (int i = 0; i < kMessages; ++i) ASSERT_TRUE(writer->append({}).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  const auto reader = open(path());
  EXPECT_EQ(reader->message_count(), kMessages);
  EXPECT_TRUE(reader
                  ->read(1, kMessages + 1,
                         [](std::int64_t, const RecordedMessage& m) { return m.cdr.empty(); })
                  .is_ok());
}

TEST_F(Recording, KeysNameTheirMessages) {
  // Of each part: every third message of "one", the others but a fifth of "two", by two writers in
  // turn.
  const auto name_of = [](std::uint64_t i) { return i % 5 == 0 ? "" : i % 3 == 0 ? "one" : "two"; };
  std::uint64_t next = 1;
  for (std::uint32_t part = 0; part < 2; ++part) {
    auto writer = start(part_path(path(), part), part);
    for (const std::uint64_t end = next + 100; next < end; ++next)
      ASSERT_TRUE(writer->append(message(next, next % 2), name_of(next)).is_ok());
    ASSERT_TRUE(writer->close().is_ok());
  }
  const auto reader = open(path());
  ASSERT_EQ(reader->keys().size(), 8U);  // a part has two writers, and they two names each
  std::size_t found = 0;
  for (std::uint32_t key = 0; key < 8; ++key) {
    const RecordedKey& recorded = reader->keys()[key];
    const std::uint32_t part = recorded.writer / 2;
    std::vector<std::int64_t> expected;
    for (std::uint64_t i = 100 * part + 1; i <= 100 * part + 100; ++i)
      if (i % 2 == recorded.writer % 2 && name_of(i) == recorded.name)
        expected.push_back(static_cast<std::int64_t>(i));
    EXPECT_EQ(reader->ids_of(key).value(), expected) << recorded.name;
    found += expected.size();
  }
  EXPECT_EQ(found, 160U);
}

TEST_F(Recording, KeysAreThoseOfTheMomentWhenItWasOpened) {
  auto writer = start(path(), 0, 0);
  ASSERT_TRUE(writer->append(message(1), "one").is_ok());
  const auto early = open(path());
  ASSERT_TRUE(writer->append(message(2), "one").is_ok());
  ASSERT_TRUE(writer->append(message(3), std::string("a\0b", 3)).is_ok());
  EXPECT_EQ(early->ids_of(0).value(), std::vector<std::int64_t>{1});
  const auto late = open(path());
  EXPECT_EQ(late->ids_of(0).value(), (std::vector<std::int64_t>{1, 2}));
  ASSERT_EQ(late->keys().size(), 2U);
  EXPECT_EQ(late->keys()[1].name, std::string("a\0b", 3));
}

TEST_F(Recording, WithoutKeysIsOpened) {
  std::uint64_t next = 1;
  for (std::uint32_t part = 0; part < 2; ++part) {
    auto writer = start(part_path(path(), part), part);
    for (const std::uint64_t end = next + 10; next < end; ++next)
      ASSERT_TRUE(writer->append(message(next), "one").is_ok());
    ASSERT_TRUE(writer->close().is_ok());
  }
  ask(path(), "DROP TABLE nearmesh_keys");
  ask(path(), "DROP INDEX nearmesh_key_idx");
  ask(path(), "ALTER TABLE nearmesh_messages DROP COLUMN key_id");
  const auto reader = open(path());
  EXPECT_EQ(reader->keys().size(), 1U);  // of the second part
  EXPECT_EQ(reader->facts().wire_version, 3U);
  EXPECT_EQ(count_right(*reader), 20U);
}

TEST_F(Recording, MayBeReadWhileItIsRead) {
  auto writer = start(path());
  for (std::uint64_t i = 1; i <= 20; ++i) ASSERT_TRUE(writer->append(message(i)).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  const auto reader = open(path());
  std::vector<std::int64_t> ids;
  const auto note = [&](std::int64_t id, const RecordedMessage&) {
    ids.push_back(id);
    return true;
  };
  ASSERT_TRUE(reader
                  ->read(1, 4,
                         [&](std::int64_t id, const RecordedMessage& m) {
                           EXPECT_TRUE(reader->read(10 + id, 12 + id, note).is_ok());
                           return note(id, m);
                         })
                  .is_ok());
  EXPECT_EQ(ids, (std::vector<std::int64_t>{11, 12, 1, 12, 13, 2, 13, 14, 3}));
}

TEST_F(Recording, IsReadWhileItGrows) {
  auto writer = start(path(), 0, 0);
  for (std::uint64_t i = 1; i <= 2000; ++i) {
    ASSERT_TRUE(writer->append(message(i)).is_ok());
    if (i % 500 == 0) {
      EXPECT_EQ(count_right(*open(path())), i);
    }
  }
  // One that does not finish does not hold up the writer either.
  const auto slow = open(path());
  ASSERT_TRUE(
      slow->read(1, 2001,
                 [&](std::int64_t id, const RecordedMessage&) {
                   EXPECT_TRUE(
                       writer->append(message(2000 + static_cast<std::uint64_t>(id))).is_ok());
                   return id < 100;
                 })
          .is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  EXPECT_EQ(count_right(*open(path())), 2100U);
}

// A reader that opens while a new writer's first message is committed sees both of them, or
// neither.
TEST_F(Recording, OpensAtOneMomentOfAGrowingFile) {
  std::unique_ptr<RecordingWriter> writer = start(path(), 0, 0);  // each message is committed
  std::atomic<bool> done = false;
  std::thread recorder([&] {
    for (std::uint32_t n = 2; !done && n < 100'000; ++n) {
      const EndpointGuid guid{static_cast<std::uint8_t>(n), static_cast<std::uint8_t>(n >> 8)};
      EXPECT_EQ(writer->add_writer({0, guid, ""}).value(), n);
      EXPECT_TRUE(writer->append(message(n, n, 10)).is_ok());
    }
  });
  for (int i = 0; i < 300; ++i) {
    const auto reader = open(path());
    const Status status = reader->read(1, reader->message_count() + 1,
                                       [](std::int64_t, const RecordedMessage&) { return true; });
    EXPECT_TRUE(status.is_ok()) << status.message();
  }
  done = true;
  recorder.join();
}

TEST_F(Recording, ExistingFileIsLeftAlone) {
  std::ofstream(path()) << "precious";
  const auto created = RecordingWriter::create(path(), facts());
  EXPECT_EQ(created.status().code(), StatusCode::kConflict);
  EXPECT_NE(created.status().message().find("exists"), std::string::npos);
  EXPECT_EQ(fs::file_size(path()), 8U);
}

TEST_F(Recording, NamesWhatTheSystemRefused) {
  const auto missing = RecordingWriter::create(path("no/such.db3"), facts());
  EXPECT_EQ(missing.status().code(), StatusCode::kIo);
  EXPECT_NE(missing.status().message().find("No such file"), std::string::npos);
  fs::permissions(folder_, kNobodyWrites);
  int status = 0;
  ::waitpid(fork_child([&] {
              if (::geteuid() == 0 && ::setuid(65534) != 0) ::_exit(2);  // root may write anywhere
              const auto created = RecordingWriter::create(path(), facts());
              const bool named = created.status().message().find("Permission") != std::string::npos;
              ::_exit(created.status().code() == StatusCode::kIo && named ? 0 : 1);
            }),
            &status, 0);
  fs::permissions(folder_, fs::perms::owner_all);
  EXPECT_EQ(status, 0);
}

TEST_F(Recording, ReadsFromAFolderThatMayNotBeWritten) {
  auto writer = start(path());
  for (std::uint64_t i = 1; i <= 20; ++i) ASSERT_TRUE(writer->append(message(i)).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  fs::permissions(path(), kNobodyWrites);
  fs::permissions(folder_, kNobodyWrites);
  int status = 0;
  ::waitpid(fork_child([&] {
              if (::geteuid() == 0 && ::setuid(65534) != 0) ::_exit(2);
              const auto opened = RecordingReader::open(path());
              ::_exit(opened.is_ok() && opened.value()->message_count() == 20 ? 0 : 1);
            }),
            &status, 0);
  fs::permissions(folder_, fs::perms::owner_all);
  EXPECT_EQ(status, 0);
}

TEST_F(Recording, WhatIsNoRecordingIsRefused) {
  EXPECT_EQ(RecordingReader::open(path()).status().code(), StatusCode::kNotFound);
  std::ofstream(path("empty.db3"));
  EXPECT_EQ(RecordingReader::open(path("empty.db3")).status().code(), StatusCode::kCorrupt);
  std::ofstream(path("text.db3")) << std::string(5000, 'x');
  EXPECT_EQ(RecordingReader::open(path("text.db3")).status().code(), StatusCode::kCorrupt);
  auto writer = start(path());
  ASSERT_TRUE(writer->append(message(1)).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  ask(path(), "UPDATE nearmesh_session SET version = 99");
  EXPECT_EQ(RecordingReader::open(path()).status().code(), StatusCode::kUnsupported);
}

// The limit on a file's size stands for the full disk: the same refusal in the same places, and
// every test may set it.
TEST_F(Recording, FullDiskKeepsWhatWasCommitted) {
  for (const std::size_t limit : {300'000U, 1'000'000U, 5'000'000U}) {
    SCOPED_TRACE(limit);
    fs::remove_all(path());
    fs::remove_all(path() + "-wal");
    fs::remove_all(path() + "-shm");
    int status = 0;
    ::waitpid(fork_child([&] {
                std::signal(SIGXFSZ, SIG_IGN);
                auto writer = start(path(), 0, 0);
                const rlimit rule{limit, limit};
                ::setrlimit(RLIMIT_FSIZE, &rule);
                Status failed;
                for (std::uint64_t i = 1; i <= 1'000'000 && failed.is_ok(); ++i)
                  failed = writer->append(message(i)).status();
                const bool stays =
                    writer->append(message(1)).status().message() == failed.message() &&
                    writer->close().message() == failed.message();
                ::_exit(failed.code() == StatusCode::kIo && stays &&
                                failed.message().find("s.db3") != std::string::npos
                            ? 0
                            : 1);
              }),
              &status, 0);
    EXPECT_EQ(status, 0);
    EXPECT_GT(count_right(*open(path())), limit / 40'000);  // a commit writes some pages
  }
}

/// A file system of so many bytes, in a folder of its own, for as long as this lives.
class SmallDisk {
 public:
  SmallDisk(fs::path at, std::size_t bytes) : at_(std::move(at)) {
    fs::create_directory(at_);
    const std::string size = "size=" + std::to_string(bytes);
    if (::mount("tmpfs", at_.c_str(), "tmpfs", 0, size.c_str()) != 0) refused_ = errno;
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  ~SmallDisk() {
    if (refused_ == 0) ::umount2(at_.c_str(), MNT_DETACH);
  }
  [[nodiscard]] int refused() const { return refused_; }

 private:
  const fs::path at_;
  int refused_ = 0;
};

TEST_F(Recording, DiskThatIsReallyFullKeepsWhatWasCommitted) {
  for (const std::size_t size : {300'000U, 2'000'000U}) {
    SCOPED_TRACE(size);
    const SmallDisk disk(folder_ / "disk", size);
    if (disk.refused() != 0)
      GTEST_SKIP() << "may not mount here: " << std::strerror(disk.refused());
    const std::string file = path("disk/s.db3");
    Status failed;
    std::uint64_t appended = 0;
    {
      auto writer = start(file, 0, 0);
      while (failed.is_ok() && appended < 100'000) {
        failed = writer->append(message(appended + 1)).status();
        appended += failed.is_ok() ? 1 : 0;
      }
      EXPECT_EQ(failed.code(), StatusCode::kIo);
      EXPECT_NE(failed.message().find("disk/s.db3"), std::string::npos) << failed.message();
      EXPECT_NE(failed.message().find("full"), std::string::npos) << failed.message();
      EXPECT_EQ(writer->close().message(), failed.message());
    }
    // While the disk is still full; every append was committed.
    EXPECT_EQ(count_right(*open(file)), appended);
    EXPECT_GT(appended, size / 40'000);
  }
}

// Every repetition of this test takes other moments: --gtest_repeat=20 makes 200 of them.
TEST_F(Recording, KilledWriterLosesOnlyWhatWasNotDue) {
  constexpr double kPeriod_s = 0.02,
                   kSlack_s = 0.15;  // slack: for a machine that is busy elsewhere
  const std::uint64_t seed =
      static_cast<std::uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count());
  SCOPED_TRACE("seed " + std::to_string(seed));
  Random random(seed);
  // What the child has appended, and when: entry i of message i.
  constexpr std::size_t kMost = 200'000;
  struct Shared {
    std::atomic<std::uint64_t> appended;
    std::array<double, kMost> when_s;
  };
  void* memory =
      ::mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  auto* shared = new (memory) Shared;
  for (int moment = 0; moment < 10; ++moment) {
    const std::string file = path("k" + std::to_string(moment) + ".db3");
    shared->appended = 0;
    const Stopwatch clock;
    const pid_t child = fork_child([&] {
      auto writer = start(file, 0, kPeriod_s);
      for (std::uint64_t i = 1; i < kMost; ++i) {
        if (!writer->append(message(i, 0, 1 + i % 2000)).is_ok()) ::_exit(1);
        shared->when_s[i] = clock.seconds();
        shared->appended = i;
      }
    });
    // From before its file is whole until its log has been taken in several times.
    const double wait_s = random.between(0, moment % 2 == 0 ? 0.02 : 0.6);
    std::this_thread::sleep_for(std::chrono::duration<double>(wait_s));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    const std::uint64_t appended = shared->appended;
    // By when the child ran last: a busy machine may have left it waiting before it was killed.
    const double ran_s = appended > 0 ? shared->when_s[appended] : 0;
    std::uint64_t due = appended;
    while (due > 0 && shared->when_s[due] > ran_s - kPeriod_s - kSlack_s) --due;
    if (appended == 0 && !RecordingReader::open(file).is_ok())
      continue;  // killed before its tables were there
    const auto reader = open(file);
    const std::uint64_t kept = count_right(*reader);
    EXPECT_GE(kept, due) << "of " << appended;
    EXPECT_LE(kept, appended + 1);
    EXPECT_EQ(ask(file, "PRAGMA integrity_check"), "ok");
  }
  ::munmap(memory, sizeof(Shared));
}

}  // namespace
}  // namespace nearmesh
