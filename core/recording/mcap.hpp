// SPDX-License-Identifier: Apache-2.0
#pragma once
// Files in the MCAP format (https://mcap.dev/spec), as far as recordings need it: chunks without
// compression, with checksums, indexed, and a summary. Takes and gives bytes; what they mean is
// mcap_recording's business.

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::mcap {

using Texts = std::vector<std::pair<std::string, std::string>>;

struct Schema {
  std::string name, encoding, text;
};
struct Channel {
  std::uint16_t schema = 0;  ///< as add_schema gave it; 0: none
  std::string topic, message_encoding;
  Texts metadata;
};
struct Message {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_ns = 0, publish_ns = 0;
  std::span<const std::uint8_t> data;
};

/// Whether a file begins as such files do; also false where there is none.
[[nodiscard]] bool is_mcap(const std::string& path);

/// Writes a file, which is in its place when it is closed. After a failure nothing more is written,
/// and every call gives the same status.
class Writer {
 public:
  /// Errors: those of OutputFile::create().
  [[nodiscard]] static Result<std::unique_ptr<Writer>> create(
      const std::string& path, const std::string& library,
      const std::vector<std::string>& inputs = {});
  ~Writer();

  /// Out: its number, from 1. Errors: kUnsupported beyond 65,535; those of the disk.
  [[nodiscard]] Result<std::uint16_t> add_schema(const Schema& schema);
  /// Out: its number, from 0. Errors as add_schema.
  [[nodiscard]] Result<std::uint16_t> add_channel(const Channel& channel);
  [[nodiscard]] Status append(const Message& message);
  [[nodiscard]] Status add_metadata(const std::string& name, const Texts& metadata);
  [[nodiscard]] Status attach(const std::string& name, const std::string& media_type,
                              std::span<const std::uint8_t> data);
  /// Writes what waits, and the summary, and puts the file in its place.
  [[nodiscard]] Status close();
  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Impl;
  explicit Writer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// What a reader meets, in the order of the file. What it is given is valid during the call.
struct Visitor {
  std::function<Status(std::uint16_t id, const Channel& channel, const Schema& schema)> channel;
  std::function<Status(const Message& message)> message;
  std::function<Status(std::string_view name, const Texts& metadata)> metadata;
  std::function<Status(std::string_view name, std::span<const std::uint8_t> data)> attachment;
};

/// Reads a file from its begin to the end of its data; the summary is not needed.
/// Errors: kNotFound; kCorrupt naming the byte; kUnsupported for compressed chunks; kIo; those of
/// the visitor.
[[nodiscard]] Status read(const std::string& path, const Visitor& visitor);

}  // namespace nearmesh::mcap
