// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>
#include <limits>

#include "core/base/output_file.hpp"
#include "mcap.hpp"
#include "mcap_format.hpp"

namespace nearmesh::mcap {
namespace {

constexpr FileKind kFile{"an MCAP file", kMagic};
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

}  // namespace nearmesh::mcap
