// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A recording: every sample as the bytes that were on the wire, with who wrote it and when. Takes
// and gives bytes and names only; what they mean is the wire's business
// (nearmesh/idl/dds/payload.hpp). The tables `topics` and `messages` are laid out as rosbag2's
// SQLite storage does (schema 4), so its tools list and extract them; `message_definitions` holds
// the IDL. Everything else is in tables of our own, whose names begin with nearmesh_. A write-ahead
// log: what was committed survives a killed process, and readers never hold up the writer. While a
// recording runs, and after a kill, FILE-wal belongs to FILE; a clean end leaves one file.

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

using EndpointGuid = std::array<std::uint8_t, 16>;

/// What is known from the start. Version of the file format: kRecordingVersion.
struct RecordingFacts {
  std::uint64_t session = 0;  ///< names the recording: the same in all of its parts
  std::uint32_t part = 0;     ///< counts up from 0
  std::uint32_t wire_version = 0;
  std::string prefix;  ///< of the topics' names
  std::string idl;     ///< text of the types
};
inline constexpr std::uint32_t kRecordingVersion = 1;

struct RecordedTopic {
  std::string name, type;
};

/// One endpoint that was heard.
struct RecordedWriter {
  std::uint32_t topic = 0;  ///< index into the topics
  EndpointGuid guid{};
  std::string partition;  ///< "" for none
};

struct RecordedMessage {
  std::uint32_t writer = 0;       ///< index into the writers
  std::uint64_t sequence = 0;     ///< of its writer
  std::int64_t received_ns = 0;   ///< since the epoch, by the recorder's clock
  std::int64_t source_ns = 0;     ///< since the epoch, by the writer's clock
  std::vector<std::uint8_t> cdr;  ///< with its encapsulation
};

/// Samples that were sent and are not in the file.
struct RecordingGap {
  std::uint32_t writer = 0;
  std::uint64_t first_sequence = 0, count = 0;
  std::int64_t noticed_ns = 0;
};

/// A model whose header is in the file.
struct RecordedModel {
  ContentHash content_hash;
  std::string name;
  std::int64_t message = 0;  ///< id of the message that holds the header
};

/// Samples of one writer that concern one thing, by a name that whoever recorded them gave it:
/// those of a body, say.
struct RecordedKey {
  std::uint32_t writer = 0;  ///< index into the writers
  std::string name;
};

/// The file that follows a part: "x.db3", "x_1.db3", "x_2.db3".
[[nodiscard]] std::string part_path(const std::string& first, std::uint32_t part);

/// Appends to a new file. After a failure (a full disk, say) nothing more is written, every call
/// gives the same status, and what was committed stays readable.
/// Threads: one at a time. Blocks for as long as the disk does.
class RecordingWriter {
 public:
  /// A killed process loses at most what was appended in so many seconds.
  static constexpr double kCommitPeriod_s = 0.5;

  /// Errors: kConflict when the file exists; kIo naming what the system refused.
  [[nodiscard]] static Result<std::unique_ptr<RecordingWriter>> create(
      const std::string& path, const RecordingFacts& facts,
      double commit_period_s = kCommitPeriod_s);
  /// As close(), without its status.
  ~RecordingWriter();

  /// Out: the index.
  [[nodiscard]] Result<std::uint32_t> add_topic(const RecordedTopic& topic);
  [[nodiscard]] Result<std::uint32_t> add_writer(const RecordedWriter& writer);
  /// `key`: under what readers find the message without reading the others (RecordedKey::name);
  /// empty: under nothing.
  /// Out: the message's id, counted up from 1. Commits what waits when it is due.
  [[nodiscard]] Result<std::int64_t> append(const RecordedMessage& message,
                                            const std::string& key = {});
  [[nodiscard]] Status add_gap(const RecordingGap& gap);
  /// A model that is there already is left as it is.
  [[nodiscard]] Status add_model(const RecordedModel& model);
  /// Commits when it is due; to be called now and then where messages may stay away.
  [[nodiscard]] Status commit_if_due();
  /// Size of the file and its log; about, for what is not committed yet.
  [[nodiscard]] std::uint64_t bytes() const;
  /// Commits, and leaves one file without a log.
  [[nodiscard]] Status close();

 private:
  struct Impl;
  explicit RecordingWriter(std::unique_ptr<Impl> impl);
  /// In a file that was just created.
  [[nodiscard]] static Result<std::unique_ptr<RecordingWriter>> begin(const std::string& path,
                                                                      const RecordingFacts& facts,
                                                                      double commit_period_s);
  std::unique_ptr<Impl> impl_;
};

/// Reads a recording, all its parts in turn, also while it is being written or after its writer was
/// killed; or one that was exported to MCAP, which is first unpacked into the folder for temporary
/// files. Ids, indices and order are those of the whole: a message's id is its place, from 1.
/// Threads: one at a time; several readers may read one file.
class RecordingReader {
 public:
  /// Errors: kNotFound; kCorrupt when it is no recording, or a damaged one; kUnsupported for a
  /// later version, and for an MCAP file with compressed chunks; kIo.
  [[nodiscard]] static Result<std::unique_ptr<RecordingReader>> open(const std::string& path);
  ~RecordingReader();

  [[nodiscard]] const RecordingFacts& facts() const;
  [[nodiscard]] std::uint32_t parts() const;
  [[nodiscard]] const std::vector<RecordedTopic>& topics() const;
  [[nodiscard]] const std::vector<RecordedWriter>& writers() const;
  [[nodiscard]] const std::vector<RecordingGap>& gaps() const;
  [[nodiscard]] const std::vector<RecordedModel>& models() const;  ///< each content once
  [[nodiscard]] const std::vector<RecordedKey>& keys() const;
  /// Messages in the file when it was opened.
  [[nodiscard]] std::int64_t message_count() const;
  /// Receive times of the first and the last message; 0 where there is none.
  [[nodiscard]] std::int64_t begin_ns() const;
  [[nodiscard]] std::int64_t end_ns() const;

  /// Gives messages [first, end) in order until `visit` says false. Errors: kCorrupt, kIo.
  [[nodiscard]] Status read(
      std::int64_t first, std::int64_t end,
      const std::function<bool(std::int64_t id, const RecordedMessage& message)>& visit);
  /// Ids of the messages of a key, by index into the keys, ascending. Cost: of what it gives.
  [[nodiscard]] Result<std::vector<std::int64_t>> ids_of(std::uint32_t key);
  /// Id of the first message that was received at this time or later; message_count() + 1 where
  /// there is none.
  /// Cost: O(log messages).
  [[nodiscard]] Result<std::int64_t> find(std::int64_t received_ns);

 private:
  struct Impl;
  explicit RecordingReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh
