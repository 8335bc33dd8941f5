// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>

#include "mcap_recording.hpp"
#include "nearmesh/core/recording/recording.hpp"
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

/// Visits all rows of a query.
template <class Visit>
Status each(sqlite::Database& database, const std::string& sql, Visit visit) {
  Result<sqlite::Statement> rows = database.prepare(sql);
  NEARMESH_RETURN_IF_ERROR(rows);
  for (;;) {
    const int code = rows.value().step();
    if (code == SQLITE_DONE) return Status::ok();
    if (code != SQLITE_ROW) return database.failure("read");
    NEARMESH_RETURN_IF_ERROR(visit(rows.value()));
  }
}

Result<sqlite::Database> open_part(const std::string& path) {
  const auto attempt = [&](int flags, const char* mode) -> Result<sqlite::Database> {
    Result<sqlite::Database> opened = sqlite::Database::open(path, flags);
    NEARMESH_RETURN_IF_ERROR(opened);
    if (mode != nullptr) NEARMESH_RETURN_IF_ERROR(opened.value().run(mode));
    NEARMESH_RETURN_IF_ERROR(opened.value().run("SELECT count(*) FROM sqlite_master"));
    return opened;
  };
  // Writing, since what a killed process has left in the log must be taken in.
  Result<sqlite::Database> opened = attempt(SQLITE_OPEN_READWRITE, nullptr);
  // On a full disk the log's index finds no room in a file; alone with the file it may be held in
  // memory.
  if (!opened.is_ok())
    if (auto alone = attempt(SQLITE_OPEN_READWRITE, "PRAGMA locking_mode=EXCLUSIVE"); alone.is_ok())
      return alone;
  // In a folder where nothing may be written.
  if (!opened.is_ok())
    if (auto plain = attempt(SQLITE_OPEN_READONLY, nullptr); plain.is_ok()) return plain;
  return opened;
}

/// Opens what an MCAP file holds as a recording of its own, which goes when it is closed.
Result<sqlite::Database> open_mcap(const std::string& path) {
  std::error_code error;
  std::string folder =
      (std::filesystem::temp_directory_path(error) / "nearmesh-recording-XXXXXX").string();
  if (error || ::mkdtemp(folder.data()) == nullptr)
    return Status{StatusCode::kIo, path + ": no folder for temporary files: " +
                                       (error ? error.message() : std::strerror(errno))};
  const std::string unpacked = folder + "/recording.db3";
  const Status status = unpack_mcap_recording(path, unpacked);
  Result<sqlite::Database> opened = status.is_ok() ? open_part(unpacked) : status;
  std::filesystem::remove_all(folder, error);  // an open file stays until it is closed
  return opened;
}

/// Tells the session also where this build does not read the version.
Status read_facts(sqlite::Database& database, const std::string& path, RecordingFacts& found) {
  bool any = false;
  const Status status = each(
      database, "SELECT version, session, part, wire_version, prefix, idl FROM nearmesh_session",
      [&](const sqlite::Statement& row) -> Status {
        any = true;
        found = {from_hex(row.text(1)), static_cast<std::uint32_t>(row.integer(2)),
                 static_cast<std::uint32_t>(row.integer(3)), row.text(4), row.text(5)};
        if (row.integer(0) != kRecordingVersion)
          return {StatusCode::kUnsupported,
                  path + ": recording version " + std::to_string(row.integer(0)) +
                      ", this build reads " + std::to_string(kRecordingVersion)};
        return Status::ok();
      });
  if (status.is_ok() && !any) return {StatusCode::kCorrupt, path + ": nearmesh_session is empty"};
  return status;
}

/// What stands under the name of a further part.
struct Candidate {
  const char* instead = nullptr;             // of a part of any recording; null where it is one
  std::optional<sqlite::Database> database;  // of a part
  RecordingFacts facts;
  Status version;  // kUnsupported where this build does not read it
};

/// Errors: it cannot be told whether it is a part, nor of which recording.
Result<Candidate> look_at(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) {
    if (error) return Status{StatusCode::kIo, path + ": " + error.message()};
    return Candidate{.instead = "no file"};
  }
  Result<sqlite::Database> opened = open_part(path);
  NEARMESH_RETURN_IF_ERROR(opened);
  bool any = false, is_recording = false;
  NEARMESH_RETURN_IF_ERROR(
      each(opened.value(), "SELECT name FROM sqlite_master", [&](const sqlite::Statement& row) {
        any = true;
        is_recording |= row.text(0) == "nearmesh_session";
        return Status::ok();
      }));
  // All tables of a part are committed as one: who is killed while it begins one leaves none of
  // them.
  if (!any) return Candidate{.instead = "an empty file"};
  if (!is_recording) return Candidate{.instead = "a database of another kind"};
  Candidate found;
  found.version = read_facts(opened.value(), path, found.facts);
  if (found.version.code() != StatusCode::kUnsupported) NEARMESH_RETURN_IF_ERROR(found.version);
  found.database = std::move(opened).value();
  return found;
}

/// Numbers of the files that have a name as further parts of `first` have, ascending.
Result<std::vector<std::uint32_t>> further_numbers(const std::string& first) {
  const std::filesystem::path path(first);
  const std::string begin = path.stem().string() + "_";
  const std::filesystem::path folder =
      path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  std::vector<std::uint32_t> numbers;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), last; !error && at != last;
       at.increment(error)) {
    const std::string name = at->path().filename().string();
    if (!name.starts_with(begin)) continue;
    std::uint32_t number = 0;
    std::from_chars(name.data() + begin.size(), name.data() + name.size(), number);
    // A number is written in one way: "x_01.db3" is no part.
    if (number > 0 && name == std::filesystem::path(part_path(first, number)).filename())
      numbers.push_back(number);
  }
  if (error)
    return Status{StatusCode::kIo, folder.string() + ": cannot look for further parts of " + first +
                                       ": " + error.message()};
  std::sort(numbers.begin(), numbers.end());
  return numbers;
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
    NEARMESH_RETURN_IF_ERROR(each(part.database,
                                  "SELECT 1 FROM sqlite_master WHERE name = 'nearmesh_keys'",
                                  [&](const sqlite::Statement&) {
                                    any = true;
                                    return Status::ok();
                                  }));
    if (!any) return Status::ok();
    return each(
        part.database, "SELECT id, writer_id, name FROM nearmesh_keys ORDER BY id",
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
    NEARMESH_RETURN_IF_ERROR(each(part.database,
                                  "SELECT max(0, coalesce((SELECT max(id) FROM messages), 0), "
                                  "coalesce((SELECT max(message_id) FROM nearmesh_messages), 0))",
                                  [&](const sqlite::Statement& row) {
                                    part.messages = row.integer(0);
                                    return Status::ok();
                                  }));
    // Callers count up to the last id, so a damaged one must not be believed. A file of SQLite has
    // at most 2^48 bytes: no sum over the parts that a process can open overflows.
    NEARMESH_RETURN_IF_ERROR(each(
        part.database, "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size",
        [&](const sqlite::Statement& row) -> Status {
          const std::int64_t most = row.integer(0) / kLeastMessageBytes;
          if (part.messages <= most) return Status::ok();
          return {StatusCode::kCorrupt,
                  part.path + ": the last message is " + std::to_string(part.messages) +
                      ", and the file has room for " + std::to_string(most) + " at most"};
        }));
    bool has_first = false, has_last = false;
    NEARMESH_RETURN_IF_ERROR(each(part.database,
                                  "SELECT id, timestamp FROM messages WHERE id IN (1, " +
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
    NEARMESH_RETURN_IF_ERROR(each(
        database, "SELECT name, type FROM topics ORDER BY id", [&](const sqlite::Statement& row) {
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
        each(database, "SELECT id, topic_id, guid, partition FROM nearmesh_writers ORDER BY id",
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
    NEARMESH_RETURN_IF_ERROR(
        each(database,
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
    NEARMESH_RETURN_IF_ERROR(each(
        database, "SELECT content_hash, name, message_id FROM nearmesh_models ORDER BY message_id",
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

  /// Parts 1, 2, ... of the recording whose part 0 is there. Errors: one cannot be read, or one is
  /// missing.
  [[nodiscard]] Status find_further_parts(const std::string& first,
                                          std::vector<Candidate>& found) const {
    // Before a part is looked for: a recorder at work begins none before the one before it is
    // there.
    const Result<std::vector<std::uint32_t>> numbers = further_numbers(first);
    NEARMESH_RETURN_IF_ERROR(numbers);
    for (std::uint32_t part = 1;; ++part) {
      Result<Candidate> next = look_at(part_path(first, part));
      if (!next.is_ok())
        return {next.status().code(), next.status().message() + "; by its name it is part " +
                                          std::to_string(part) + " of " + first +
                                          ": if it is not, move it elsewhere"};
      if (!is_ours(next.value(), part) || next.value().facts.part != part)
        return check_end(first, part, next.value(), numbers.value());
      NEARMESH_RETURN_IF_ERROR(next.value().version);
      found.push_back(std::move(next).value());
    }
  }

  /// Whether it is part `part` of this recording or a later one. A copy of one before is none.
  [[nodiscard]] bool is_ours(const Candidate& candidate, std::uint32_t part) const {
    return candidate.instead == nullptr && candidate.facts.session == facts.session &&
           candidate.facts.part >= part;
  }

  /// Where part `part` should be there is something else, or nothing: so it is behind the last
  /// part, where a recorder was killed while it began the next, and where files of others have such
  /// names. It is a hole where a later part is.
  [[nodiscard]] Status check_end(const std::string& first, std::uint32_t part,
                                 const Candidate& found,
                                 const std::vector<std::uint32_t>& numbers) const {
    std::string missing =
        part_path(first, part) + ": part " + std::to_string(part) +
        " of the recording is missing: found " +
        (found.instead != nullptr
             ? found.instead
             : "part " + std::to_string(found.facts.part) +
                   (found.facts.session == facts.session ? " of it" : " of another"));
    if (is_ours(found, part)) return {StatusCode::kCorrupt, missing};
    for (const std::uint32_t number : numbers) {
      if (number <= part) continue;
      const std::string path = part_path(first, number);
      const Result<Candidate> later = look_at(path);
      // Nothing says that one that cannot be read is of this recording.
      if (!later.is_ok() || !is_ours(later.value(), part)) continue;
      missing.append(", and ").append(path).append(" is part ");
      return {StatusCode::kCorrupt, missing + std::to_string(later.value().facts.part) + " of it"};
    }
    return Status::ok();
  }
};

Result<std::unique_ptr<RecordingReader>> RecordingReader::open(const std::string& path) {
  auto impl = std::make_unique<Impl>();
  std::error_code error;
  if (!std::filesystem::exists(path, error))
    return Status{StatusCode::kNotFound, path + ": " + (error ? error.message() : "no such file")};
  const bool is_mcap = mcap::is_mcap(path);  // such a file is whole
  Result<sqlite::Database> opened = is_mcap ? open_mcap(path) : open_part(path);
  Status status = opened.is_ok() ? read_facts(opened.value(), path, impl->facts) : opened.status();
  if (status.code() == StatusCode::kCorrupt && !is_mcap)
    status = {StatusCode::kCorrupt, "not a recorded session: " + status.message()};
  NEARMESH_RETURN_IF_ERROR(status);
  if (impl->facts.part != 0)
    return Status{StatusCode::kInvalidArgument, path + ": part " +
                                                    std::to_string(impl->facts.part) +
                                                    " of a recording; open its first file"};
  // All are found before the first is read: one that another follows is written no more.
  std::vector<Candidate> further;
  if (!is_mcap) NEARMESH_RETURN_IF_ERROR(impl->find_further_parts(path, further));
  NEARMESH_RETURN_IF_ERROR(impl->add_part(std::move(opened).value(), path));
  for (Candidate& part : further)
    NEARMESH_RETURN_IF_ERROR(
        impl->add_part(std::move(*part.database), part_path(path, part.facts.part)));
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
    NEARMESH_RETURN_IF_ERROR(each(part.database,
                                  "SELECT message_id FROM nearmesh_messages WHERE key_id = " +
                                      std::to_string(key - part.first_key + 1) +
                                      " AND message_id <= " + std::to_string(part.messages) +
                                      " ORDER BY message_id",
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
    NEARMESH_RETURN_IF_ERROR(
        each(part.database,
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
