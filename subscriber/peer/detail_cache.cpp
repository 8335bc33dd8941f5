// SPDX-License-Identifier: Apache-2.0
#include "detail_cache.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string_view>

#include "core/base/hash.hpp"
#include "core/base/output_file.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {
namespace {

// kMagic, the wire version, the content; each batch behind its length; the checksum of all that.
// Little-endian.
constexpr std::string_view kMagic = "nearmesh detail\n";
constexpr std::size_t kMaxFileBytes =
    kMagic.size() + 26 + kMaxCachedBytes + kMaxCachedBatches * sizeof(std::uint16_t);
constexpr FileKind kCacheFile{"a file of cached detail", kMagic};

std::string path_of(const std::string& folder, const ContentHash& content) {
  return folder + "/" + to_hex(content) + ".detail";
}

template <class Number>
void put(std::string& to, Number value) {
  for (std::size_t i = 0; i < sizeof value; ++i)
    to.push_back(static_cast<char>(static_cast<std::uint8_t>(value >> (8 * i))));
}
template <class Number>
Number get(std::string_view from, std::size_t at) {
  Number value = 0;
  for (std::size_t i = 0; i < sizeof value; ++i)
    value = static_cast<Number>(value | static_cast<Number>(static_cast<std::uint8_t>(from[at + i]))
                                            << (8 * i));
  return value;
}

std::string head_of(const ContentHash& content) {
  std::string head(kMagic);
  put(head, wire::kWireVersion);
  put(head, content.high);
  put(head, content.low);
  return head;
}
std::uint64_t checksum_of(std::string_view bytes) {
  return hash_bytes({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
}

Status spoilt(const std::string& path, StatusCode code, const std::string& what) {
  return {code, path + ": " + what};
}

}  // namespace

Result<std::optional<Batches>> read_cached(const std::string& folder, const ContentHash& content) {
  const std::string path = path_of(folder, content);
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  if (error == std::errc::no_such_file_or_directory) return std::optional<Batches>();
  if (error) return spoilt(path, StatusCode::kIo, error.message());
  const std::string head = head_of(content);
  if (size > kMaxFileBytes)
    return spoilt(path, StatusCode::kCorrupt, "larger than any file of cached detail");
  std::ifstream file(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const std::string_view all = bytes;
  if (!all.starts_with(kMagic) || all.size() < head.size() + sizeof(std::uint64_t))
    return spoilt(path, StatusCode::kCorrupt, "no file of cached detail");
  const std::size_t end = all.size() - sizeof(std::uint64_t);
  if (get<std::uint64_t>(all, end) != checksum_of(all.substr(0, end)))
    return spoilt(path, StatusCode::kCorrupt, "damaged");
  if (const auto version = get<std::uint16_t>(all, kMagic.size()); version != wire::kWireVersion)
    return spoilt(path, StatusCode::kUnsupported,
                  "of wire version " + std::to_string(version) + ", this build speaks " +
                      std::to_string(wire::kWireVersion));
  if (!all.starts_with(head)) return spoilt(path, StatusCode::kCorrupt, "of another content");
  Batches batches;
  for (std::size_t at = head.size(); at < end;) {
    const std::size_t from = at + sizeof(std::uint16_t);
    const std::size_t length = from <= end ? get<std::uint16_t>(all, at) : end;
    if (length > end - std::min(from, end) || batches.size() == kMaxCachedBatches)
      return spoilt(path, StatusCode::kCorrupt, "batches that do not fit into it");
    const std::string_view batch = all.substr(from, length);
    batches.emplace_back(batch.begin(), batch.end());
    at = from + length;
  }
  return std::optional<Batches>(std::move(batches));
}

Status write_cached(const std::string& folder, const ContentHash& content, const Batches& batches) {
  const std::string path = path_of(folder, content);
  std::error_code error;
  if (batches.empty()) {
    std::filesystem::remove(path, error);
    return error ? spoilt(path, StatusCode::kIo, error.message()) : Status::ok();
  }
  std::filesystem::create_directories(folder, error);  // else the file cannot be written
  std::string bytes = head_of(content);
  for (const std::vector<std::uint8_t>& batch : batches) {
    put(bytes, static_cast<std::uint16_t>(batch.size()));
    bytes.append(batch.begin(), batch.end());
  }
  put(bytes, checksum_of(bytes));
  return write_file(path, kCacheFile, bytes);
}

}  // namespace nearmesh::subscriber
