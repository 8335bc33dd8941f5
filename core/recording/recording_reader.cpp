// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>
#include <optional>
#include <utility>

#include "nearmesh/core/recording/recording.hpp"
#include "recording_parts.hpp"
#include "sqlite.hpp"

namespace nearmesh {
namespace {

// One file of a recording; the first ids of what it holds, counted through all parts.
struct Part {
  sqlite::Database database;
  std::string path;
  std::int64_t messages = 0, first_message = 0;
  std::uint32_t first_writer = 0, writers = 0;
  std::uint32_t first_key = 0, keys = 0;
  // Of read(), while no one uses it: to prepare takes longer than a message.
  std::optional<sqlite::Statement> select;
};

/// Less than any message takes in its file: a cell of both tables and of the index on the time.
constexpr std::int64_t kLeastMessageBytes = 16;

/// `id`: in its file.
Status missing_message(const std::string& path, std::int64_t id) {
  return {StatusCode::kCorrupt, path + ": message " + std::to_string(id) + " is missing"};
}

std::uint64_t from_hex(const std::string& text) { return std::strtoull(text.c_str(), nullptr, 16); }

/// Of the 32 digits that to_hex() gives.
ContentHash content_from_hex(const std::string& text) {
  if (text.size() != 32) return {};
  return {from_hex(text.substr(0, 16)), from_hex(text.substr(16))};
}

}  // namespace

struct RecordingReader::Impl {
  RecordingFacts facts;
  std::vector<Part> parts;
  std::vector<RecordedTopic> topics;
  std::vector<RecordedWriter> writers;
  std::vector<RecordedKey> keys;
  std::vector<RecordingGap> gaps;
  std::vector<RecordedModel> models;
  std::int64_t messages = 0, begin_ns = 0, end_ns = 0;

  Status read_keys(Part& part, const std::string& path) {
    part.first_key = static_cast<std::uint32_t>(keys.size());
    // Where an earlier build has recorded, there may be none. Such a file is opened, so that its
    // wire version can be told.
    bool any = false;
    NEARMESH_RETURN_IF_ERROR(part.database.each(
        "SELECT 1 FROM sqlite_master WHERE name = 'nearmesh_keys'", [&](const sqlite::Statement&) {
          any = true;
          return Status::ok();
        }));
    if (!any) return Status::ok();
    return part.database.each(
        "SELECT id, writer_id, name FROM nearmesh_keys ORDER BY id",
        [&](const sqlite::Statement& row) -> Status {
          const std::int64_t writer = row.integer(1) - 1;
          if (row.integer(0) != std::int64_t{part.keys} + 1 || writer < 0 ||
              writer >= std::int64_t{part.writers})
            return {StatusCode::kCorrupt, path + ": nearmesh_keys does not fit the writers"};
          keys.push_back({part.first_writer + static_cast<std::uint32_t>(writer), row.text(2)});
          ++part.keys;
          return Status::ok();
        });
  }

  /// How many messages the part has, and when the first and the last were received. Whether those
  /// between are there is seen where they are read.
  Status read_span(Part& part) {
    // A message is in two tables. It is missing, not none, where one of them has lost it.
    NEARMESH_RETURN_IF_ERROR(
        part.database.each("SELECT max(0, coalesce((SELECT max(id) FROM messages), 0), "
                           "coalesce((SELECT max(message_id) FROM nearmesh_messages), 0))",
                           [&](const sqlite::Statement& row) {
                             part.messages = row.integer(0);
                             return Status::ok();
                           }));
    // Callers count up to the last id, so a damaged one must not be believed. A file of SQLite has
    // at most 2^48 bytes: no sum over the parts that a process can open overflows.
    NEARMESH_RETURN_IF_ERROR(part.database.each(
        "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size",
        [&](const sqlite::Statement& row) -> Status {
          const std::int64_t most = row.integer(0) / kLeastMessageBytes;
          if (part.messages <= most) return Status::ok();
          return {StatusCode::kCorrupt,
                  part.path + ": the last message is " + std::to_string(part.messages) +
                      ", and the file has room for " + std::to_string(most) + " at most"};
        }));
    bool has_first = false, has_last = false;
    NEARMESH_RETURN_IF_ERROR(
        part.database.each("SELECT id, timestamp FROM messages WHERE id IN (1, " +
                               std::to_string(part.messages) + ") ORDER BY id",
                           [&](const sqlite::Statement& row) {
                             has_first |= row.integer(0) == 1;
                             has_last |= row.integer(0) == part.messages;
                             if (messages == 0 && begin_ns == 0) begin_ns = row.integer(1);
                             end_ns = row.integer(1);
                             return Status::ok();
                           }));
    if (part.messages > 0 && !(has_first && has_last))
      return missing_message(part.path, has_first ? part.messages : 1);
    return Status::ok();
  }

  Status add_part(sqlite::Database opened, const std::string& path) {
    Part part{.database = std::move(opened), .path = path};
    sqlite::Database& database = part.database;
    // All of it as of one moment: between two reads the recorder may commit messages of a writer
    // that the first did not see.
    NEARMESH_RETURN_IF_ERROR(database.run("BEGIN"));
    std::vector<std::uint32_t> topic_index;
    NEARMESH_RETURN_IF_ERROR(database.each(
        "SELECT name, type FROM topics ORDER BY id", [&](const sqlite::Statement& row) {
          const std::string name = row.text(0);
          const auto known = std::find_if(topics.begin(), topics.end(),
                                          [&](const RecordedTopic& t) { return t.name == name; });
          topic_index.push_back(static_cast<std::uint32_t>(known - topics.begin()));
          if (known == topics.end()) topics.push_back({name, row.text(1)});
          return Status::ok();
        }));
    part.first_writer = static_cast<std::uint32_t>(writers.size());
    const auto corrupt = [&](const char* what) {
      return Status{StatusCode::kCorrupt, path + ": " + what};
    };
    // Writers, gaps and models name what comes before them.
    NEARMESH_RETURN_IF_ERROR(
        database.each("SELECT id, topic_id, guid, partition FROM nearmesh_writers ORDER BY id",
                      [&](const sqlite::Statement& row) {
                        RecordedWriter writer;
                        const std::int64_t topic = row.integer(1) - 1;
                        const auto guid = row.blob(2);
                        if (row.integer(0) != std::int64_t{part.writers} + 1 || topic < 0 ||
                            topic >= static_cast<std::int64_t>(topic_index.size()) ||
                            guid.size() != writer.guid.size())
                          return corrupt("nearmesh_writers does not fit the topics");
                        writer.topic = topic_index[static_cast<std::size_t>(topic)];
                        std::copy(guid.begin(), guid.end(), writer.guid.begin());
                        writer.partition = row.text(3);
                        writers.push_back(writer);
                        ++part.writers;
                        return Status::ok();
                      }));
    NEARMESH_RETURN_IF_ERROR(read_keys(part, path));
    NEARMESH_RETURN_IF_ERROR(read_span(part));
    NEARMESH_RETURN_IF_ERROR(database.each(
        "SELECT writer_id, first_sequence, missing, noticed FROM nearmesh_gaps ORDER BY id",
        [&](const sqlite::Statement& row) {
          const std::int64_t writer = row.integer(0) - 1;
          if (writer < 0 || writer >= std::int64_t{part.writers})
            return corrupt("nearmesh_gaps names no writer");
          gaps.push_back({part.first_writer + static_cast<std::uint32_t>(writer),
                          static_cast<std::uint64_t>(row.integer(1)),
                          static_cast<std::uint64_t>(row.integer(2)), row.integer(3)});
          return Status::ok();
        }));
    part.first_message = messages;
    NEARMESH_RETURN_IF_ERROR(database.each(
        "SELECT content_hash, name, message_id FROM nearmesh_models ORDER BY message_id",
        [&](const sqlite::Statement& row) -> Status {
          if (row.integer(2) < 1 || row.integer(2) > part.messages)
            return corrupt("nearmesh_models names no message");
          RecordedModel model{content_from_hex(row.text(0)), row.text(1),
                              row.integer(2) + part.first_message};
          if (std::none_of(models.begin(), models.end(), [&](const RecordedModel& m) {
                return m.content_hash == model.content_hash;
              }))
            models.push_back(std::move(model));
          return Status::ok();
        }));
    NEARMESH_RETURN_IF_ERROR(database.run("COMMIT"));
    messages += part.messages;
    parts.push_back(std::move(part));
    return Status::ok();
  }
};

Result<std::unique_ptr<RecordingReader>> RecordingReader::open(const std::string& path) {
  Result<OpenedRecording> opened = open_recording(path);
  NEARMESH_RETURN_IF_ERROR(opened);
  auto impl = std::make_unique<Impl>();
  impl->facts = std::move(opened.value().facts);
  for (OpenedPart& part : opened.value().parts)
    NEARMESH_RETURN_IF_ERROR(impl->add_part(std::move(part.database), part.path));
  return std::unique_ptr<RecordingReader>(new RecordingReader(std::move(impl)));
}

RecordingReader::RecordingReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RecordingReader::~RecordingReader() = default;

const RecordingFacts& RecordingReader::facts() const { return impl_->facts; }
std::uint32_t RecordingReader::parts() const {
  return static_cast<std::uint32_t>(impl_->parts.size());
}
const std::vector<RecordedTopic>& RecordingReader::topics() const { return impl_->topics; }
const std::vector<RecordedWriter>& RecordingReader::writers() const { return impl_->writers; }
const std::vector<RecordedKey>& RecordingReader::keys() const { return impl_->keys; }
const std::vector<RecordingGap>& RecordingReader::gaps() const { return impl_->gaps; }
const std::vector<RecordedModel>& RecordingReader::models() const { return impl_->models; }
std::int64_t RecordingReader::message_count() const { return impl_->messages; }
std::int64_t RecordingReader::begin_ns() const { return impl_->begin_ns; }
std::int64_t RecordingReader::end_ns() const { return impl_->end_ns; }

namespace {

/// Of messages [from, to), as the part counts them, which all must be there. Out: false when
/// `visit` said so.
Result<bool> visit_rows(Part& part, sqlite::Statement& rows, std::int64_t from, std::int64_t to,
                        const std::function<bool(std::int64_t, const RecordedMessage&)>& visit) {
  RecordedMessage message;
  for (std::int64_t id = from;; ++id) {
    const int code = rows.step();
    if (code == SQLITE_DONE && id == to) return true;
    if (code != SQLITE_ROW && code != SQLITE_DONE) return part.database.failure("read");
    if (code == SQLITE_DONE || rows.integer(0) != id) return missing_message(part.path, id);
    const std::int64_t writer = rows.integer(1) - 1;
    if (writer < 0 || writer >= std::int64_t{part.writers})
      return Status{StatusCode::kCorrupt,
                    part.path + ": message " + std::to_string(id) + " names no writer"};
    message.writer = part.first_writer + static_cast<std::uint32_t>(writer);
    message.sequence = static_cast<std::uint64_t>(rows.integer(2));
    message.received_ns = rows.integer(3);
    message.source_ns = rows.integer(4);
    const auto cdr = rows.blob(5);
    message.cdr.assign(cdr.begin(), cdr.end());
    if (!visit(id + part.first_message, message)) return false;
  }
}

}  // namespace

Status RecordingReader::read(
    std::int64_t first, std::int64_t end,
    const std::function<bool(std::int64_t, const RecordedMessage&)>& visit) {
  for (Part& part : impl_->parts) {
    const std::int64_t from = std::max(first, part.first_message + 1) - part.first_message;
    const std::int64_t to =
        std::min(end, part.first_message + part.messages + 1) - part.first_message;
    if (from >= to) continue;
    // Taken, since `visit` may read too.
    std::optional<sqlite::Statement> rows = std::exchange(part.select, std::nullopt);
    if (!rows) {
      Result<sqlite::Statement> prepared = part.database.prepare(
          "SELECT id, writer_id, sequence, timestamp, source_timestamp, data FROM messages "
          "JOIN nearmesh_messages ON message_id = id WHERE id >= ? AND id < ? ORDER BY id");
      NEARMESH_RETURN_IF_ERROR(prepared);
      rows = std::move(prepared).value();
    }
    rows->bind(1, from);
    rows->bind(2, to);
    const Result<bool> more = visit_rows(part, *rows, from, to, visit);
    rows->reset();
    part.select = std::move(rows);
    NEARMESH_RETURN_IF_ERROR(more);
    if (!more.value()) break;
  }
  return Status::ok();
}

Result<std::vector<std::int64_t>> RecordingReader::ids_of(std::uint32_t key) {
  std::vector<std::int64_t> ids;
  for (Part& part : impl_->parts) {
    if (key < part.first_key || key - part.first_key >= part.keys) continue;
    // Not what was recorded since it was opened.
    NEARMESH_RETURN_IF_ERROR(part.database.each(
        "SELECT message_id FROM nearmesh_messages WHERE key_id = " +
            std::to_string(key - part.first_key + 1) +
            " AND message_id <= " + std::to_string(part.messages) + " ORDER BY message_id",
        [&](const sqlite::Statement& row) {
          ids.push_back(row.integer(0) + part.first_message);
          return Status::ok();
        }));
  }
  return ids;
}

Result<std::int64_t> RecordingReader::find(std::int64_t received_ns) {
  for (Part& part : impl_->parts) {
    std::int64_t found = 0;
    NEARMESH_RETURN_IF_ERROR(part.database.each(
        "SELECT id FROM messages WHERE timestamp >= " + std::to_string(received_ns) +
            " ORDER BY timestamp, id LIMIT 1",
        [&](const sqlite::Statement& row) {
          found = row.integer(0);
          return Status::ok();
        }));
    if (found != 0 && found <= part.messages) return found + part.first_message;
  }
  return impl_->messages + 1;
}

}  // namespace nearmesh
