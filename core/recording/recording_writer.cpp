// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <utility>

#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "sqlite.hpp"

namespace nearmesh {
namespace {

// The first five as rosbag2 has them (schema version 4). An index on the time alone, as there; ids
// follow the order of arrival.
constexpr const char* kTables = R"sql(
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema VALUES(4, 'nearmesh');
CREATE TABLE nearmesh_session(version INTEGER NOT NULL, session TEXT NOT NULL, part INTEGER NOT NULL,
  wire_version INTEGER NOT NULL, prefix TEXT NOT NULL, idl TEXT NOT NULL);
CREATE TABLE nearmesh_writers(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, guid BLOB NOT NULL,
  partition TEXT NOT NULL);
CREATE TABLE nearmesh_keys(id INTEGER PRIMARY KEY, writer_id INTEGER NOT NULL, name BLOB NOT NULL);
CREATE TABLE nearmesh_messages(message_id INTEGER PRIMARY KEY, writer_id INTEGER NOT NULL,
  sequence INTEGER NOT NULL, source_timestamp INTEGER NOT NULL, key_id INTEGER);
CREATE INDEX nearmesh_key_idx ON nearmesh_messages(key_id) WHERE key_id IS NOT NULL;
CREATE TABLE nearmesh_gaps(id INTEGER PRIMARY KEY, writer_id INTEGER NOT NULL, first_sequence INTEGER NOT NULL,
  missing INTEGER NOT NULL, noticed INTEGER NOT NULL);
CREATE TABLE nearmesh_models(content_hash TEXT PRIMARY KEY, name TEXT NOT NULL, message_id INTEGER NOT NULL);
)sql";

/// What a message takes beside its bytes, about.
constexpr std::uint64_t kRowBytes = 80;

}  // namespace

struct RecordingWriter::Impl {
  Impl(sqlite::Database opened, std::string file, double period_s)
      : database(std::move(opened)), path(std::move(file)), commit_period_s(period_s) {}

  sqlite::Database database;
  std::string path;
  double commit_period_s;
  std::string idl;
  std::vector<std::uint32_t> topic_of_writer;
  std::map<std::pair<std::uint32_t, std::string>, std::int64_t> keys;  // by writer and name
  std::uint32_t topics = 0;
  std::int64_t messages = 0;
  std::uint64_t bytes = 0;
  Stopwatch clock;
  double begun_s = -1;  // of the open transaction; below 0: none is open
  Status broken;        // why nothing is written any more
  bool closed = false;
  sqlite::Statement put_topic, put_definition, put_message, put_extra, put_writer, put_key, put_gap,
      put_model;

  Status prepare(sqlite::Statement& statement, const char* sql) {
    Result<sqlite::Statement> prepared = database.prepare(sql);
    NEARMESH_RETURN_IF_ERROR(prepared);
    statement = std::move(prepared).value();
    return Status::ok();
  }
  Status prepare_all() {
    NEARMESH_RETURN_IF_ERROR(prepare(put_topic, "INSERT INTO topics VALUES(?,?,?,'cdr','','')"));
    NEARMESH_RETURN_IF_ERROR(
        prepare(put_definition, "INSERT INTO message_definitions VALUES(?,?,'omgidl',?,'')"));
    NEARMESH_RETURN_IF_ERROR(prepare(put_message, "INSERT INTO messages VALUES(?,?,?,?)"));
    NEARMESH_RETURN_IF_ERROR(prepare(put_extra, "INSERT INTO nearmesh_messages VALUES(?,?,?,?,?)"));
    NEARMESH_RETURN_IF_ERROR(prepare(put_key, "INSERT INTO nearmesh_keys VALUES(?,?,?)"));
    NEARMESH_RETURN_IF_ERROR(prepare(put_writer, "INSERT INTO nearmesh_writers VALUES(?,?,?,?)"));
    NEARMESH_RETURN_IF_ERROR(prepare(put_gap, "INSERT INTO nearmesh_gaps VALUES(NULL,?,?,?,?)"));
    return prepare(put_model, "INSERT OR IGNORE INTO nearmesh_models VALUES(?,?,?)");
  }

  /// Nothing is written after this. What the open transaction held is lost.
  Status give_up(Status status) {
    put_message.reset();
    put_extra.reset();
    static_cast<void>(database.run("ROLLBACK"));
    begun_s = -1;
    broken = std::move(status);
    return broken;
  }
  Status begin() {
    NEARMESH_ASSERT(!closed);
    if (!broken.is_ok() || begun_s >= 0) return broken;
    if (const Status status = database.run("BEGIN IMMEDIATE"); !status.is_ok())
      return give_up(status);
    begun_s = clock.seconds();
    return Status::ok();
  }
  Status insert(sqlite::Statement& statement) {
    const int code = statement.step();
    if (code == SQLITE_DONE) {
      statement.reset();
      return Status::ok();
    }
    const Status status = database.failure("write");
    statement.reset();
    return give_up(status);
  }
  Status commit() {
    if (!broken.is_ok() || begun_s < 0) return broken;
    if (const Status status = database.run("COMMIT"); !status.is_ok()) return give_up(status);
    begun_s = -1;
    std::error_code ignored;
    bytes = 0;
    for (const char* suffix : {"", "-wal"}) {
      const auto size = std::filesystem::file_size(path + suffix, ignored);
      if (!ignored) bytes += size;
    }
    return Status::ok();
  }
  Status commit_if_due() {
    if (begun_s < 0 || clock.seconds() - begun_s < commit_period_s) return broken;
    return commit();
  }
  /// Out: the key's id; 0 for none.
  Result<std::int64_t> key_of(std::uint32_t writer, const std::string& name) {
    if (name.empty()) return 0;
    const auto [known, is_new] =
        keys.try_emplace({writer, name}, static_cast<std::int64_t>(keys.size()) + 1);
    if (is_new) {
      put_key.bind(1, known->second);
      put_key.bind(2, std::int64_t{writer} + 1);
      put_key.bind(3, std::span(reinterpret_cast<const std::uint8_t*>(name.data()), name.size()));
      NEARMESH_RETURN_IF_ERROR(insert(put_key));
    }
    return known->second;
  }
  Status close() {
    if (closed) return broken;
    static_cast<void>(commit());
    closed = true;
    NEARMESH_RETURN_IF_ERROR(broken);
    // Takes the log into the file. A reader that is at it keeps the log alive: then its end does
    // so.
    for (sqlite::Statement* statement : {&put_topic, &put_definition, &put_message, &put_extra,
                                         &put_writer, &put_key, &put_gap, &put_model})
      *statement = sqlite::Statement();
    static_cast<void>(database.run("PRAGMA journal_mode=DELETE"));
    return Status::ok();
  }
};

std::string part_path(const std::string& first, std::uint32_t part) {
  if (part == 0) return first;
  const std::filesystem::path path(first);
  return (path.parent_path() /
          (path.stem().string() + "_" + std::to_string(part) + path.extension().string()))
      .string();
}

Result<std::unique_ptr<RecordingWriter>> RecordingWriter::create(const std::string& path,
                                                                 const RecordingFacts& facts,
                                                                 double commit_period_s) {
  // Not by SQLite, which would open what is there and does not say what the system did not like.
  const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (file < 0) {
    if (errno == EEXIST)
      return Status{
          StatusCode::kConflict,
          path + ": exists, and a recording never overwrites a file: name another, or remove it"};
    return Status{StatusCode::kIo, path + ": cannot create: " + std::strerror(errno)};
  }
  ::close(file);
  Result<std::unique_ptr<RecordingWriter>> begun = begin(path, facts, commit_period_s);
  // Nothing of a recording that never began: its name can be used again.
  if (!begun.is_ok())
    for (const char* suffix : {"", "-wal", "-shm"}) ::unlink((path + suffix).c_str());
  return begun;
}

Result<std::unique_ptr<RecordingWriter>> RecordingWriter::begin(const std::string& path,
                                                                const RecordingFacts& facts,
                                                                double commit_period_s) {
  Result<sqlite::Database> opened = sqlite::Database::open(path, SQLITE_OPEN_READWRITE);
  NEARMESH_RETURN_IF_ERROR(opened);
  auto impl = std::make_unique<Impl>(std::move(opened).value(), path, commit_period_s);
  // A killed process loses nothing that was committed; a power cut may lose the last seconds, and
  // damages nothing.
  NEARMESH_RETURN_IF_ERROR(impl->database.run("PRAGMA journal_mode=WAL"));
  NEARMESH_RETURN_IF_ERROR(impl->database.run("PRAGMA synchronous=NORMAL"));
  // As one: whoever finds the file finds all of its tables, or an empty file.
  NEARMESH_RETURN_IF_ERROR(impl->begin());
  NEARMESH_RETURN_IF_ERROR(impl->database.run(kTables));
  NEARMESH_RETURN_IF_ERROR(impl->prepare_all());
  Result<sqlite::Statement> put =
      impl->database.prepare("INSERT INTO nearmesh_session VALUES(?,?,?,?,?,?)");
  NEARMESH_RETURN_IF_ERROR(put);
  const std::string session = to_hex(facts.session);
  put.value().bind(1, std::int64_t{kRecordingVersion});
  put.value().bind(2, session);
  put.value().bind(3, std::int64_t{facts.part});
  put.value().bind(4, std::int64_t{facts.wire_version});
  put.value().bind(5, facts.prefix);
  put.value().bind(6, facts.idl);
  NEARMESH_RETURN_IF_ERROR(impl->insert(put.value()));
  NEARMESH_RETURN_IF_ERROR(impl->commit());
  impl->idl = facts.idl;
  return std::unique_ptr<RecordingWriter>(new RecordingWriter(std::move(impl)));
}

RecordingWriter::RecordingWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RecordingWriter::~RecordingWriter() { static_cast<void>(impl_->close()); }

Result<std::uint32_t> RecordingWriter::add_topic(const RecordedTopic& topic) {
  NEARMESH_RETURN_IF_ERROR(impl_->begin());
  const std::int64_t id = impl_->topics + 1;
  impl_->put_topic.bind(1, id);
  impl_->put_topic.bind(2, topic.name);
  impl_->put_topic.bind(3, topic.type);
  NEARMESH_RETURN_IF_ERROR(impl_->insert(impl_->put_topic));
  impl_->put_definition.bind(1, id);
  impl_->put_definition.bind(2, topic.type);
  impl_->put_definition.bind(3, impl_->idl);
  NEARMESH_RETURN_IF_ERROR(impl_->insert(impl_->put_definition));
  return impl_->topics++;
}

Result<std::uint32_t> RecordingWriter::add_writer(const RecordedWriter& writer) {
  NEARMESH_ASSERT(writer.topic < impl_->topics);
  NEARMESH_RETURN_IF_ERROR(impl_->begin());
  const auto index = static_cast<std::uint32_t>(impl_->topic_of_writer.size());
  impl_->put_writer.bind(1, std::int64_t{index} + 1);
  impl_->put_writer.bind(2, std::int64_t{writer.topic} + 1);
  impl_->put_writer.bind(3, std::span<const std::uint8_t>(writer.guid));
  impl_->put_writer.bind(4, writer.partition);
  NEARMESH_RETURN_IF_ERROR(impl_->insert(impl_->put_writer));
  impl_->topic_of_writer.push_back(writer.topic);
  return index;
}

Result<std::int64_t> RecordingWriter::append(const RecordedMessage& message,
                                             const std::string& key) {
  NEARMESH_ASSERT(message.writer < impl_->topic_of_writer.size());
  NEARMESH_RETURN_IF_ERROR(impl_->begin());
  const Result<std::int64_t> key_id = impl_->key_of(message.writer, key);
  NEARMESH_RETURN_IF_ERROR(key_id);
  const std::int64_t id = impl_->messages + 1;
  impl_->put_message.bind(1, id);
  impl_->put_message.bind(2, std::int64_t{impl_->topic_of_writer[message.writer]} + 1);
  impl_->put_message.bind(3, message.received_ns);
  impl_->put_message.bind(4, std::span<const std::uint8_t>(message.cdr));
  NEARMESH_RETURN_IF_ERROR(impl_->insert(impl_->put_message));
  impl_->put_extra.bind(1, id);
  impl_->put_extra.bind(2, std::int64_t{message.writer} + 1);
  impl_->put_extra.bind(3, static_cast<std::int64_t>(message.sequence));
  impl_->put_extra.bind(4, message.source_ns);
  if (key_id.value() != 0) {
    impl_->put_extra.bind(5, key_id.value());
  } else {
    impl_->put_extra.bind_null(5);
  }
  NEARMESH_RETURN_IF_ERROR(impl_->insert(impl_->put_extra));
  impl_->messages = id;
  impl_->bytes += message.cdr.size() + kRowBytes;
  NEARMESH_RETURN_IF_ERROR(impl_->commit_if_due());
  return id;
}

Status RecordingWriter::add_gap(const RecordingGap& gap) {
  NEARMESH_ASSERT(gap.writer < impl_->topic_of_writer.size());
  NEARMESH_RETURN_IF_ERROR(impl_->begin());
  impl_->put_gap.bind(1, std::int64_t{gap.writer} + 1);
  impl_->put_gap.bind(2, static_cast<std::int64_t>(gap.first_sequence));
  impl_->put_gap.bind(3, static_cast<std::int64_t>(gap.count));
  impl_->put_gap.bind(4, gap.noticed_ns);
  return impl_->insert(impl_->put_gap);
}

Status RecordingWriter::add_model(const RecordedModel& model) {
  NEARMESH_RETURN_IF_ERROR(impl_->begin());
  const std::string hash = to_hex(model.content_hash);
  impl_->put_model.bind(1, hash);
  impl_->put_model.bind(2, model.name);
  impl_->put_model.bind(3, model.message);
  return impl_->insert(impl_->put_model);
}

Status RecordingWriter::commit_if_due() { return impl_->commit_if_due(); }
std::uint64_t RecordingWriter::bytes() const { return impl_->bytes; }
Status RecordingWriter::close() { return impl_->close(); }

}  // namespace nearmesh
