// SPDX-License-Identifier: Apache-2.0
#include "mcap.hpp"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>

#include "core/base/output_file.hpp"

namespace nearmesh::mcap {
namespace {

static_assert(std::endian::native == std::endian::little);

// A record is its kind, the length of what follows as 8 bytes, and that.
enum Kind : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0a,
  kStatistics = 0x0b,
  kMetadata = 0x0c,
  kMetadataIndex = 0x0d,
  kSummaryOffset = 0x0e,
  kDataEnd = 0x0f,
};

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
constexpr FileKind kFile{"an MCAP file", kMagic};
constexpr std::size_t kRecordHead = 9;
constexpr std::size_t kChunkBytes = std::size_t{1} << 20;

template <class T>
void put(std::string& out, T value) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}
void put_text(std::string& out, std::string_view text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  out += text;
}
void put_texts(std::string& out, const Texts& texts) {
  std::string inner;
  for (const auto& [key, value] : texts) {
    put_text(inner, key);
    put_text(inner, value);
  }
  put_text(out, inner);
}
void put_record(std::string& out, Kind kind, std::string_view content) {
  put(out, static_cast<std::uint8_t>(kind));
  put(out, std::uint64_t{content.size()});
  out += content;
}

std::uint32_t checksum(std::string_view bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(
      crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::string content_of(std::uint16_t id, const Schema& schema) {
  std::string content;
  put(content, id);
  put_text(content, schema.name);
  put_text(content, schema.encoding);
  put_text(content, schema.text);
  return content;
}
std::string content_of(std::uint16_t id, const Channel& channel) {
  std::string content;
  put(content, id);
  put(content, channel.schema);
  put_text(content, channel.topic);
  put_text(content, channel.message_encoding);
  put_texts(content, channel.metadata);
  return content;
}

std::string_view view_of(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

bool is_mcap(const std::string& path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             std::fclose);
  char magic[kMagic.size()];
  return file && std::fread(magic, 1, sizeof magic, file.get()) == sizeof magic &&
         std::string_view(magic, sizeof magic) == kMagic;
}

// ---- writing ------------------------------------------------------------------------------------

struct Writer::Impl {
  struct Chunk {
    std::uint64_t first_ns = 0, last_ns = 0;     // log times: the least and the greatest
    std::map<std::uint16_t, std::string> index;  // by channel: times and places
    std::string records;
  };

  Impl(std::string name, OutputFile opened) : path(std::move(name)), file(std::move(opened)) {}

  std::string path;
  OutputFile file;
  Status broken;
  bool closed = false;
  std::uint64_t at = 0;  // bytes written
  Chunk chunk;
  std::vector<std::string> schemas, channels;     // contents of their records
  std::map<std::uint16_t, std::uint64_t> counts;  // messages by channel
  std::uint64_t messages = 0, first_ns = std::numeric_limits<std::uint64_t>::max(), last_ns = 0;
  std::uint32_t attachments = 0, metadata = 0, chunks = 0;
  std::string chunk_indices, attachment_indices, metadata_indices;  // whole records

  Status write(std::string_view bytes) {
    if (broken.is_ok()) broken = file.write(bytes);
    at += bytes.size();
    return broken;
  }
  Status write_record(Kind kind, std::string_view content) {
    std::string record;
    put_record(record, kind, content);
    return write(record);
  }

  Status end_chunk() {
    if (chunk.records.empty()) return broken;
    std::string content;
    put(content, chunk.first_ns);
    put(content, chunk.last_ns);
    put(content, std::uint64_t{chunk.records.size()});
    put(content, checksum(chunk.records));
    put_text(content, "");
    put(content, std::uint64_t{chunk.records.size()});
    content += chunk.records;
    const std::uint64_t begin = at;
    NEARMESH_RETURN_IF_ERROR(write_record(kChunk, content));
    const std::uint64_t end = at;
    std::string places;  // of the message indices, by channel
    for (const auto& [channel, entries] : chunk.index) {
      put(places, channel);
      put(places, at);
      std::string index;
      put(index, channel);
      put_text(index, entries);
      NEARMESH_RETURN_IF_ERROR(write_record(kMessageIndex, index));
    }
    std::string index;
    put(index, chunk.first_ns);
    put(index, chunk.last_ns);
    put(index, begin);
    put(index, end - begin);
    put_text(index, places);
    put(index, at - end);
    put_text(index, "");
    put(index, std::uint64_t{chunk.records.size()});
    put(index, std::uint64_t{chunk.records.size()});
    put_record(chunk_indices, kChunkIndex, index);
    ++chunks;
    chunk = {};
    return Status::ok();
  }

  std::string statistics() const {
    std::string content;
    put(content, messages);
    put(content, static_cast<std::uint16_t>(schemas.size()));
    put(content, static_cast<std::uint32_t>(channels.size()));
    put(content, attachments);
    put(content, metadata);
    put(content, chunks);
    put(content, messages == 0 ? 0 : first_ns);
    put(content, last_ns);
    std::string by_channel;
    for (const auto& [channel, count] : counts) {
      put(by_channel, channel);
      put(by_channel, count);
    }
    put_text(content, by_channel);
    return content;
  }

  Status close() {
    if (closed) return broken;
    closed = true;
    NEARMESH_RETURN_IF_ERROR(end_chunk());
    std::string end;
    put(end, std::uint32_t{0});  // no checksum of all
    NEARMESH_RETURN_IF_ERROR(write_record(kDataEnd, end));
    const std::uint64_t begin = at;
    std::string summary, offsets;
    const auto add_group = [&](Kind kind, const std::string& records) {
      if (records.empty()) return;
      std::string offset;
      put(offset, static_cast<std::uint8_t>(kind));
      put(offset, begin + summary.size());
      put(offset, std::uint64_t{records.size()});
      put_record(offsets, kSummaryOffset, offset);
      summary += records;
    };
    const auto records_of = [](Kind kind, const std::vector<std::string>& contents) {
      std::string records;
      for (const std::string& content : contents) put_record(records, kind, content);
      return records;
    };
    add_group(kSchema, records_of(kSchema, schemas));
    add_group(kChannel, records_of(kChannel, channels));
    add_group(kStatistics, records_of(kStatistics, {statistics()}));
    add_group(kChunkIndex, chunk_indices);
    add_group(kAttachmentIndex, attachment_indices);
    add_group(kMetadataIndex, metadata_indices);
    const std::uint64_t offsets_begin = begin + summary.size();
    summary += offsets;
    // The footer's own beginning counts for the checksum.
    constexpr std::uint64_t kFooterBytes = 8 + 8 + 4;
    put(summary, static_cast<std::uint8_t>(kFooter));
    put(summary, kFooterBytes);
    put(summary, begin);
    put(summary, offsets_begin);
    put(summary, checksum(summary));
    summary += kMagic;
    NEARMESH_RETURN_IF_ERROR(write(summary));
    broken = file.close();
    return broken;
  }
};

Writer::Writer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Writer::~Writer() = default;

Result<std::unique_ptr<Writer>> Writer::create(const std::string& path, const std::string& library,
                                               const std::vector<std::string>& inputs) {
  Result<OutputFile> file = OutputFile::create(path, kFile, inputs);
  NEARMESH_RETURN_IF_ERROR(file);
  auto impl = std::make_unique<Impl>(path, std::move(file).value());
  std::string header;
  put_text(header, "");  // of no profile
  put_text(header, library);
  NEARMESH_RETURN_IF_ERROR(impl->write(kMagic));
  NEARMESH_RETURN_IF_ERROR(impl->write_record(kHeader, header));
  return std::unique_ptr<Writer>(new Writer(std::move(impl)));
}

Result<std::uint16_t> Writer::add_schema(const Schema& schema) {
  if (impl_->schemas.size() == 0xffff)
    return Status{StatusCode::kUnsupported, impl_->path + ": more than 65,535 types"};
  const auto id = static_cast<std::uint16_t>(impl_->schemas.size() + 1);
  impl_->schemas.push_back(content_of(id, schema));
  put_record(impl_->chunk.records, kSchema, impl_->schemas.back());
  return id;
}

Result<std::uint16_t> Writer::add_channel(const Channel& channel) {
  NEARMESH_ASSERT(channel.schema <= impl_->schemas.size());
  if (impl_->channels.size() > 0xffff)
    return Status{StatusCode::kUnsupported, impl_->path + ": more than 65,536 channels"};
  const auto id = static_cast<std::uint16_t>(impl_->channels.size());
  impl_->channels.push_back(content_of(id, channel));
  put_record(impl_->chunk.records, kChannel, impl_->channels.back());
  return id;
}

Status Writer::append(const Message& message) {
  NEARMESH_ASSERT(message.channel < impl_->channels.size());
  NEARMESH_RETURN_IF_ERROR(impl_->broken);
  Impl::Chunk& chunk = impl_->chunk;
  if (chunk.index.empty()) chunk.first_ns = chunk.last_ns = message.log_ns;
  chunk.first_ns = std::min(chunk.first_ns, message.log_ns);
  chunk.last_ns = std::max(chunk.last_ns, message.log_ns);
  std::string& index = chunk.index[message.channel];
  put(index, message.log_ns);
  put(index, std::uint64_t{chunk.records.size()});
  std::string content;
  put(content, message.channel);
  put(content, message.sequence);
  put(content, message.log_ns);
  put(content, message.publish_ns);
  content += view_of(message.data);
  put_record(chunk.records, kMessage, content);
  ++impl_->messages;
  ++impl_->counts[message.channel];
  impl_->first_ns = std::min(impl_->first_ns, message.log_ns);
  impl_->last_ns = std::max(impl_->last_ns, message.log_ns);
  return chunk.records.size() < kChunkBytes ? Status::ok() : impl_->end_chunk();
}

Status Writer::add_metadata(const std::string& name, const Texts& metadata) {
  NEARMESH_RETURN_IF_ERROR(impl_->end_chunk());
  std::string content;
  put_text(content, name);
  put_texts(content, metadata);
  std::string index;
  put(index, impl_->at);
  put(index, std::uint64_t{kRecordHead + content.size()});
  put_text(index, name);
  put_record(impl_->metadata_indices, kMetadataIndex, index);
  ++impl_->metadata;
  return impl_->write_record(kMetadata, content);
}

Status Writer::attach(const std::string& name, const std::string& media_type,
                      std::span<const std::uint8_t> data) {
  NEARMESH_RETURN_IF_ERROR(impl_->end_chunk());
  std::string content;
  put(content, std::uint64_t{0});  // times
  put(content, std::uint64_t{0});
  put_text(content, name);
  put_text(content, media_type);
  put(content, std::uint64_t{data.size()});
  content += view_of(data);
  put(content, checksum(content));
  std::string index;
  put(index, impl_->at);
  put(index, std::uint64_t{kRecordHead + content.size()});
  put(index, std::uint64_t{0});
  put(index, std::uint64_t{0});
  put(index, std::uint64_t{data.size()});
  put_text(index, name);
  put_text(index, media_type);
  put_record(impl_->attachment_indices, kAttachmentIndex, index);
  ++impl_->attachments;
  return impl_->write_record(kAttachment, content);
}

Status Writer::close() { return impl_->close(); }
std::uint64_t Writer::bytes() const { return impl_->at; }

// ---- reading ------------------------------------------------------------------------------------

namespace {

/// Takes values from the front of some bytes; what is not there is 0 or empty, and then it has failed.
class Bytes {
 public:
  explicit Bytes(std::string_view bytes) : left_(bytes) {}
  template <class T>
  T take() {
    T value{};
    const std::string_view bytes = take_bytes(sizeof value);
    if (bytes.size() == sizeof value) std::memcpy(&value, bytes.data(), sizeof value);
    return value;
  }
  std::string_view take_bytes(std::uint64_t count) {
    if (count > left_.size()) {
      failed_ = true;
      return {};
    }
    const std::string_view taken = left_.substr(0, count);
    left_.remove_prefix(count);
    return taken;
  }
  std::string_view take_text() { return take_bytes(take<std::uint32_t>()); }
  Texts take_texts() {
    Bytes inner(take_text());
    Texts texts;
    while (!inner.left_.empty() && !inner.failed_) {
      const std::string_view key = inner.take_text(), value = inner.take_text();
      texts.emplace_back(key, value);
    }
    failed_ = failed_ || inner.failed_;
    return texts;
  }
  [[nodiscard]] std::string_view left() const { return left_; }
  [[nodiscard]] bool failed() const { return failed_; }

 private:
  std::string_view left_;
  bool failed_ = false;
};

std::span<const std::uint8_t> span_of(std::string_view bytes) {
  return {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()};
}

class FileReader {
 public:
  FileReader(const std::string& path, const Visitor& visitor, std::FILE* file, std::uint64_t size)
      : path_(path), visitor_(visitor), file_(file), size_(size) {}

  Status read_all() {
    if (next(kMagic.size()) != kMagic) return corrupt("no MCAP file");
    for (;;) {
      const std::uint64_t begin = at_;
      Bytes head(next(kRecordHead));
      const auto kind = head.take<std::uint8_t>();
      const auto length = head.take<std::uint64_t>();
      if (head.failed()) return corrupt("ends before its data do");
      if (length > size_ - at_) return corrupt_at(begin, "a record is longer than the file");
      if (kind == kDataEnd || kind == kFooter) return Status::ok();
      NEARMESH_RETURN_IF_ERROR(take_record(kind, next(length), begin));
    }
  }

 private:
  /// Valid until the next call; shorter where the file ends.
  std::string_view next(std::uint64_t count) {
    buffer_.resize(std::min(count, size_ - at_));
    buffer_.resize(std::fread(buffer_.data(), 1, buffer_.size(), file_));
    at_ += buffer_.size();
    return buffer_;
  }
  [[nodiscard]] Status corrupt(const std::string& what) const {
    return {StatusCode::kCorrupt, path_ + ": " + what};
  }
  [[nodiscard]] Status corrupt_at(std::uint64_t byte, const std::string& what) const {
    return corrupt("byte " + std::to_string(byte) + ": " + what);
  }

  /// `begin`: where in the file it begins, or the chunk that it is in.
  Status take_record(std::uint8_t kind, std::string_view content, std::uint64_t begin) {
    Bytes bytes(content);
    switch (kind) {
      case kSchema: {
        const auto id = bytes.take<std::uint16_t>();
        Schema schema;
        schema.name = bytes.take_text();
        schema.encoding = bytes.take_text();
        schema.text = bytes.take_text();
        if (bytes.failed() || id == 0) return corrupt_at(begin, "a schema is damaged");
        schemas_.insert_or_assign(id, std::move(schema));
        return Status::ok();
      }
      case kChannel: {
        const auto id = bytes.take<std::uint16_t>();
        Channel channel{.schema = bytes.take<std::uint16_t>()};
        channel.topic = bytes.take_text();
        channel.message_encoding = bytes.take_text();
        channel.metadata = bytes.take_texts();
        if (bytes.failed()) return corrupt_at(begin, "a channel is damaged");
        const auto schema = schemas_.find(channel.schema);
        if (channel.schema != 0 && schema == schemas_.end())
          return corrupt_at(begin, "channel " + channel.topic + " has no schema");
        return visitor_.channel(id, channel, schema == schemas_.end() ? Schema{} : schema->second);
      }
      case kMessage: {
        Message message{.channel = bytes.take<std::uint16_t>()};
        message.sequence = bytes.take<std::uint32_t>();
        message.log_ns = bytes.take<std::uint64_t>();
        message.publish_ns = bytes.take<std::uint64_t>();
        if (bytes.failed()) return corrupt_at(begin, "a message is damaged");
        message.data = span_of(bytes.left());
        return visitor_.message(message);
      }
      case kChunk:
        return take_chunk(bytes, begin);
      case kMetadata: {
        const std::string_view name = bytes.take_text();
        const Texts texts = bytes.take_texts();
        if (bytes.failed()) return corrupt_at(begin, "metadata are damaged");
        return visitor_.metadata(name, texts);
      }
      case kAttachment: {
        static_cast<void>(bytes.take_bytes(16));  // times
        const std::string_view name = bytes.take_text();
        static_cast<void>(bytes.take_text());
        const std::string_view data = bytes.take_bytes(bytes.take<std::uint64_t>());
        const std::string_view summed = content.substr(0, content.size() - bytes.left().size());
        const auto crc = bytes.take<std::uint32_t>();
        if (bytes.failed() || (crc != 0 && crc != checksum(summed)))
          return corrupt_at(begin, "attachment " + std::string(name) + " is damaged");
        return visitor_.attachment(name, span_of(data));
      }
      default:
        return Status::ok();  // indices, and what later versions may add
    }
  }

  Status take_chunk(Bytes& bytes, std::uint64_t begin) {
    static_cast<void>(bytes.take_bytes(24));  // times and size
    const auto crc = bytes.take<std::uint32_t>();
    const std::string_view compression = bytes.take_text();
    const std::string_view records = bytes.take_bytes(bytes.take<std::uint64_t>());
    if (bytes.failed()) return corrupt_at(begin, "a chunk is damaged");
    if (!compression.empty())
      return {StatusCode::kUnsupported,
              path_ + ": its chunks are compressed (" + std::string(compression) +
                  "); write it anew without: mcap compress --compression none"};
    if (crc != 0 && crc != checksum(records))
      return corrupt_at(begin, "the checksum of a chunk is wrong");
    Bytes inner(records);
    while (!inner.left().empty()) {
      const auto kind = inner.take<std::uint8_t>();
      const std::string_view content = inner.take_bytes(inner.take<std::uint64_t>());
      if (inner.failed() || kind == kChunk) return corrupt_at(begin, "a chunk is damaged");
      NEARMESH_RETURN_IF_ERROR(take_record(kind, content, begin));
    }
    return Status::ok();
  }

  const std::string& path_;
  const Visitor& visitor_;
  std::FILE* file_;
  std::uint64_t size_, at_ = 0;
  std::string buffer_;
  std::map<std::uint16_t, Schema> schemas_;
};

}  // namespace

Status read(const std::string& path, const Visitor& visitor) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             std::fclose);
  if (!file)
    return {errno == ENOENT ? StatusCode::kNotFound : StatusCode::kIo,
            path + ": " + std::strerror(errno)};
  std::fseek(file.get(), 0, SEEK_END);
  const long size = std::ftell(file.get());
  std::rewind(file.get());
  if (size < 0) return {StatusCode::kIo, path + ": " + std::strerror(errno)};
  return FileReader(path, visitor, file.get(), static_cast<std::uint64_t>(size)).read_all();
}

}  // namespace nearmesh::mcap
