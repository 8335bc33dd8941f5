// SPDX-License-Identifier: Apache-2.0
#include "mcap_recording.hpp"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <utility>

#include "core/base/hash.hpp"
#include "nearmesh/core/base/parse_content_hash.hpp"

namespace nearmesh {
namespace {

constexpr const char* kSessionName = "nearmesh session";  // the metadata
constexpr const char* kTopicsName = "nearmesh topics";   // metadata, too: names and types, in order
constexpr const char* kTablesName = "nearmesh tables";   // the attachment
constexpr const char* kWriterIndex = "nearmesh_writer";  // of a channel: the writer's index
constexpr const char* kMediaType = "application/octet-stream";

// ---- tables: what the recorder knew beside the samples ------------------------------------------
// Numbers are little-endian, lists and texts begin with their length (4 bytes):
//   gaps:    writer (4), first sequence, count, noticed (8 each)
//   models:  content, name (texts), message (8)
//   writers: the first sequence of each (8): a message of MCAP has the lower half only
//   keys:    writer (4), name (text), a list of messages (8 each)

template <class T>
void put(std::vector<std::uint8_t>& out, T value) {
  std::uint8_t bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.insert(out.end(), bytes, bytes + sizeof value);
}
void put_text(std::vector<std::uint8_t>& out, const std::string& text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  out.insert(out.end(), text.begin(), text.end());
}

struct Tables {
  std::vector<RecordingGap> gaps;
  std::vector<RecordedModel> models;
  std::vector<std::uint64_t> first_sequences;  // by writer
  struct Key {
    RecordedKey key;
    std::vector<std::int64_t> messages;
  };
  std::vector<Key> keys;

  [[nodiscard]] std::vector<std::uint8_t> encode() const {
    std::vector<std::uint8_t> out;
    put(out, static_cast<std::uint32_t>(gaps.size()));
    for (const RecordingGap& gap : gaps) {
      put(out, gap.writer);
      put(out, gap.first_sequence);
      put(out, gap.count);
      put(out, gap.noticed_ns);
    }
    put(out, static_cast<std::uint32_t>(models.size()));
    for (const RecordedModel& model : models) {
      put_text(out, to_hex(model.content_hash));
      put_text(out, model.name);
      put(out, model.message);
    }
    put(out, static_cast<std::uint32_t>(first_sequences.size()));
    for (const std::uint64_t first : first_sequences) put(out, first);
    put(out, static_cast<std::uint32_t>(keys.size()));
    for (const Key& key : keys) {
      put(out, key.key.writer);
      put_text(out, key.key.name);
      put(out, static_cast<std::uint32_t>(key.messages.size()));
      for (const std::int64_t id : key.messages) put(out, id);
    }
    return out;
  }

  /// Nothing where the bytes are damaged.
  static std::optional<Tables> decode(std::span<const std::uint8_t> bytes) {
    std::size_t at = 0;
    bool failed = false;
    const auto take = [&]<class T>(T& value) {
      failed = failed || bytes.size() - at < sizeof value;
      if (failed) return;
      std::memcpy(&value, &bytes[at], sizeof value);
      at += sizeof value;
    };
    const auto take_text = [&](std::string& text) {
      std::uint32_t size = 0;
      take(size);
      failed = failed || bytes.size() - at < size;
      if (failed) return;
      text.assign(reinterpret_cast<const char*>(bytes.data()) + at, size);
      at += size;
    };
    const auto take_list = [&](const auto& take_one) {
      std::uint32_t count = 0;
      take(count);
      for (std::uint32_t i = 0; i < count && !failed; ++i) take_one();
    };
    Tables tables;
    take_list([&] {
      RecordingGap& gap = tables.gaps.emplace_back();
      take(gap.writer);
      take(gap.first_sequence);
      take(gap.count);
      take(gap.noticed_ns);
    });
    take_list([&] {
      RecordedModel& model = tables.models.emplace_back();
      std::string content;
      take_text(content);
      take_text(model.name);
      take(model.message);
      const Result<ContentHash> parsed = parse_content_hash(content);
      failed = failed || !parsed.is_ok();
      if (!failed) model.content_hash = parsed.value();
    });
    take_list([&] { take(tables.first_sequences.emplace_back()); });
    take_list([&] {
      Key& key = tables.keys.emplace_back();
      take(key.key.writer);
      take_text(key.key.name);
      take_list([&] { take(key.messages.emplace_back()); });
    });
    if (failed || at != bytes.size()) return std::nullopt;
    return tables;
  }
};

Result<Tables> tables_of(RecordingReader& recording) {
  Tables tables{.gaps = recording.gaps(), .models = recording.models()};
  tables.first_sequences.resize(recording.writers().size());
  std::vector<bool> is_known(recording.writers().size());
  NEARMESH_RETURN_IF_ERROR(recording.read(
      1, recording.message_count() + 1, [&](std::int64_t, const RecordedMessage& message) {
        if (is_known[message.writer]) return true;
        is_known[message.writer] = true;
        tables.first_sequences[message.writer] = message.sequence;
        return true;
      }));
  for (std::uint32_t i = 0; i < recording.keys().size(); ++i) {
    Result<std::vector<std::int64_t>> ids = recording.ids_of(i);
    NEARMESH_RETURN_IF_ERROR(ids);
    tables.keys.push_back({recording.keys()[i], std::move(ids).value()});
  }
  return tables;
}

template <class Number>
std::optional<Number> number_in(const mcap::Texts& texts, std::string_view key, int base = 10) {
  for (const auto& [name, value] : texts) {
    if (name != key) continue;
    Number number{};
    const char* end = value.data() + value.size();
    const auto [stop, error] = std::from_chars(value.data(), end, number, base);
    if (error == std::errc() && stop == end) return number;
  }
  return std::nullopt;
}
std::string text_in(const mcap::Texts& texts, std::string_view key) {
  for (const auto& [name, value] : texts)
    if (name == key) return value;
  return {};
}

std::string hex_of(const EndpointGuid& guid) {
  std::string hex;
  for (const std::uint8_t byte : guid)
    for (const int half : {byte >> 4, byte & 15})
      hex += "0123456789abcdef"[static_cast<std::size_t>(half)];
  return hex;
}
std::optional<EndpointGuid> guid_from(const std::string& hex) {
  EndpointGuid guid{};
  if (hex.size() != 2 * guid.size()) return std::nullopt;
  for (std::size_t i = 0; i < guid.size(); ++i) {
    const char* at = hex.data() + 2 * i;
    const auto [stop, error] = std::from_chars(at, at + 2, guid[i], 16);
    if (error != std::errc() || stop != at + 2) return std::nullopt;
  }
  return guid;
}

}  // namespace

Result<std::vector<std::uint16_t>> begin_mcap_recording(RecordingReader& recording,
                                                        mcap::Writer& file) {
  const RecordingFacts& facts = recording.facts();
  NEARMESH_RETURN_IF_ERROR(
      file.add_metadata(kSessionName, {{"version", std::to_string(kRecordingVersion)},
                                       {"session", to_hex(facts.session)},
                                       {"wire_version", std::to_string(facts.wire_version)},
                                       {"prefix", facts.prefix},
                                       {"idl", facts.idl}}));
  mcap::Texts topics;
  for (const RecordedTopic& topic : recording.topics()) topics.emplace_back(topic.name, topic.type);
  NEARMESH_RETURN_IF_ERROR(file.add_metadata(kTopicsName, topics));
  const Result<Tables> tables = tables_of(recording);
  NEARMESH_RETURN_IF_ERROR(tables);
  NEARMESH_RETURN_IF_ERROR(file.attach(kTablesName, kMediaType, tables.value().encode()));
  std::vector<std::uint16_t> schemas, channels;
  for (const RecordedTopic& topic : recording.topics()) {
    const Result<std::uint16_t> schema = file.add_schema({topic.type, "omgidl", facts.idl});
    NEARMESH_RETURN_IF_ERROR(schema);
    schemas.push_back(schema.value());
  }
  for (std::size_t i = 0; i < recording.writers().size(); ++i) {
    const RecordedWriter& writer = recording.writers()[i];
    const Result<std::uint16_t> channel =
        file.add_channel({.schema = schemas[writer.topic],
                          .topic = recording.topics()[writer.topic].name,
                          .message_encoding = "cdr",
                          .metadata = {{kWriterIndex, std::to_string(i)},
                                       {"guid", hex_of(writer.guid)},
                                       {"partition", writer.partition}}});
    NEARMESH_RETURN_IF_ERROR(channel);
    channels.push_back(channel.value());
  }
  return channels;
}

namespace {

/// Writes the recording as what an MCAP file holds is met.
class Unpacking {
 public:
  Unpacking(std::string from, std::string path) : from_(std::move(from)), path_(std::move(path)) {}

  Status run() {
    const Status status = mcap::read(
        from_, {.channel = [this](std::uint16_t id, const mcap::Channel& channel,
                                  const mcap::Schema&) { return take(id, channel); },
                .message = [this](const mcap::Message& message) { return take(message); },
                .metadata =
                    [this](std::string_view name, const mcap::Texts& texts) {
                      return name == kTopicsName ? take_topics(texts) : take_facts(name, texts);
                    },
                .attachment =
                    [this](std::string_view name, std::span<const std::uint8_t> data) {
                      return take_tables(name, data);
                    }});
    NEARMESH_RETURN_IF_ERROR(status);
    if (!writer_) return corrupt("no recorded session of nearmesh is in it");
    if (!tables_) return corrupt(std::string("attachment '") + kTablesName + "' is missing");
    for (const RecordingGap& gap : tables_->gaps) {
      if (gap.writer >= sequences_.size()) return corrupt("a gap names no writer");
      NEARMESH_RETURN_IF_ERROR(writer_->add_gap(gap));
    }
    for (const RecordedModel& model : tables_->models)
      NEARMESH_RETURN_IF_ERROR(writer_->add_model(model));
    return writer_->close();
  }

 private:
  [[nodiscard]] Status corrupt(const std::string& what) const {
    return {StatusCode::kCorrupt, from_ + ": " + what};
  }

  Status take_facts(std::string_view name, const mcap::Texts& texts) {
    if (name != kSessionName || writer_) return Status::ok();
    const auto version = number_in<std::uint32_t>(texts, "version");
    const auto session = number_in<std::uint64_t>(texts, "session", 16);
    const auto wire_version = number_in<std::uint32_t>(texts, "wire_version");
    if (!version || !session || !wire_version)
      return corrupt(std::string("metadata '") + kSessionName + "' are damaged");
    if (*version != kRecordingVersion)
      return {StatusCode::kUnsupported, from_ + ": recording version " + std::to_string(*version) +
                                            ", this build reads " +
                                            std::to_string(kRecordingVersion)};
    Result<std::unique_ptr<RecordingWriter>> created =
        RecordingWriter::create(path_, {.session = *session,
                                        .wire_version = *wire_version,
                                        .prefix = text_in(texts, "prefix"),
                                        .idl = text_in(texts, "idl")});
    NEARMESH_RETURN_IF_ERROR(created);
    writer_ = std::move(created).value();
    return Status::ok();
  }

  Status take_topics(const mcap::Texts& texts) {
    if (!writer_ || !topics_.empty())
      return corrupt(std::string("metadata '") + kTopicsName + "' stand in a wrong place");
    for (const auto& [name, type] : texts) {
      const Result<std::uint32_t> added = writer_->add_topic({name, type});
      NEARMESH_RETURN_IF_ERROR(added);
      topics_[name] = added.value();
    }
    return Status::ok();
  }

  Status take_tables(std::string_view name, std::span<const std::uint8_t> data) {
    if (name != kTablesName || tables_) return Status::ok();
    tables_ = Tables::decode(data);
    if (!tables_) return corrupt(std::string("attachment '") + kTablesName + "' is damaged");
    for (const Tables::Key& key : tables_->keys)
      for (const std::int64_t id : key.messages) keys_[id] = &key.key;
    return Status::ok();
  }

  Status take(std::uint16_t id, const mcap::Channel& channel) {
    const auto index = number_in<std::uint32_t>(channel.metadata, kWriterIndex);
    if (!index || writers_.contains(id)) return Status::ok();
    const auto guid = guid_from(text_in(channel.metadata, "guid"));
    const auto topic = topics_.find(channel.topic);
    if (!writer_ || !tables_ || !guid || topic == topics_.end() || *index != sequences_.size() ||
        *index >= tables_->first_sequences.size())
      return corrupt("channel " + std::to_string(id) + " fits no recorded writer");
    const Result<std::uint32_t> added =
        writer_->add_writer({topic->second, *guid, text_in(channel.metadata, "partition")});
    NEARMESH_RETURN_IF_ERROR(added);
    writers_[id] = added.value();
    sequences_.push_back(tables_->first_sequences[*index]);
    return Status::ok();
  }

  Status take(const mcap::Message& message) {
    const auto at = writers_.find(message.channel);
    if (at == writers_.end()) return Status::ok();  // derived, or of somebody else
    std::uint64_t& sequence = sequences_[at->second];
    sequence += static_cast<std::uint64_t>(std::int64_t{
        static_cast<std::int32_t>(message.sequence - static_cast<std::uint32_t>(sequence))});
    const auto key = keys_.find(++messages_);
    if (key != keys_.end() && key->second->writer != at->second)
      return corrupt("message " + std::to_string(messages_) +
                     " is not of the writer that its key names: messages were left out");
    const Result<std::int64_t> id = writer_->append(
        {.writer = at->second,
         .sequence = sequence,
         .received_ns = static_cast<std::int64_t>(message.log_ns),
         .source_ns = static_cast<std::int64_t>(message.publish_ns),
         .cdr = std::vector<std::uint8_t>(message.data.begin(), message.data.end())},
        key == keys_.end() ? std::string() : key->second->name);
    return id.status();
  }

  std::string from_, path_;
  std::unique_ptr<RecordingWriter> writer_;
  std::optional<Tables> tables_;
  std::map<std::int64_t, const RecordedKey*> keys_;  // by message
  std::map<std::string, std::uint32_t> topics_;
  std::map<std::uint16_t, std::uint32_t> writers_;  // by channel
  std::vector<std::uint64_t> sequences_;            // the last of each writer
  std::int64_t messages_ = 0;
};

}  // namespace

Status unpack_mcap_recording(const std::string& mcap_path, const std::string& path) {
  const Status status = Unpacking(mcap_path, path).run();
  if (!status.is_ok()) {
    std::error_code ignored;
    for (const char* suffix : {"", "-wal", "-shm"}) std::filesystem::remove(path + suffix, ignored);
  }
  return status;
}

}  // namespace nearmesh
