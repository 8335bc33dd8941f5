// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "mcap.hpp"
#include "mcap_format.hpp"

namespace nearmesh::mcap {
namespace {

/// Takes values from the front of some bytes; what is not there is 0 or empty, and then it has
/// failed.
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

bool is_mcap(const std::string& path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             std::fclose);
  char magic[kMagic.size()];
  return file && std::fread(magic, 1, sizeof magic, file.get()) == sizeof magic &&
         std::string_view(magic, sizeof magic) == kMagic;
}

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
