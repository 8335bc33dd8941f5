// SPDX-License-Identifier: Apache-2.0
#include "world_folder.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>

#include "core/base/digest.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

/// A small file: at most a byte more than `most`.
Result<std::vector<std::uint8_t>> read_small(const std::string& path, std::size_t most) {
  const std::unique_ptr<std::FILE, FileCloser> file(std::fopen(path.c_str(), "rb"));
  if (!file)
    return Status(errno == ENOENT ? StatusCode::kNotFound : StatusCode::kIo,
                  path + ": cannot be read: " + std::strerror(errno));
  std::vector<std::uint8_t> bytes(most + 1);
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), file.get()));
  if (std::ferror(file.get()) != 0)
    return Status(StatusCode::kIo, path + ": cannot be read: " + std::strerror(errno));
  return bytes;
}

Status naming(const std::string& path, const Status& status) {
  return {status.code(), path + ": " + status.message()};
}

Status write_bytes(const std::string& path, const FileKind& kind,
                   const std::vector<std::uint8_t>& bytes) {
  return write_file(path, kind, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace

std::string WorldFolder::record_path(const std::string& folder) {
  return (fs::path(folder) / "world.nmw").string();
}
std::string WorldFolder::page_path(const std::string& folder, const ContentHash& page) {
  return (fs::path(folder) / "pages" / (to_hex(page) + ".nmp")).string();
}
std::string WorldFolder::tile_path(const std::string& folder, const ContentHash& tile) {
  return (fs::path(folder) / "tiles" / (to_hex(tile) + ".spm")).string();
}

Result<WorldFolder> WorldFolder::open(const std::string& folder) {
  const std::string path = record_path(folder);
  const auto bytes = read_small(path, kWorldRecordBytes);
  NEARMESH_RETURN_IF_ERROR(bytes);
  const Result<WorldRecord> world = decode_world(bytes.value());
  if (!world.is_ok()) return naming(path, world.status());
  WorldFolder out;
  out.folder_ = folder;
  out.world_ = world.value();
  out.name_ = digest_of(bytes.value());
  return out;
}

Result<std::vector<std::uint8_t>> WorldFolder::page_bytes(const ContentHash& content) const {
  constexpr std::size_t kMostBytes = 2048;
  const std::string path = page_path(folder_, content);
  auto bytes = read_small(path, kMostBytes);
  NEARMESH_RETURN_IF_ERROR(bytes);
  if (digest_of(bytes.value()) != content)
    return Status(StatusCode::kCorrupt, path + ": its bytes are not those that its name says");
  return bytes;
}

Result<WorldPage> WorldFolder::read(const ContentHash& content) const {
  const std::string path = page_path(folder_, content);
  const auto bytes = page_bytes(content);
  NEARMESH_RETURN_IF_ERROR(bytes);
  Result<WorldPage> page = decode_page(bytes.value());
  if (!page.is_ok()) return naming(path, page.status());
  return page;
}

Result<WorldPage> WorldFolder::root() const {
  Result<WorldPage> page = read(world_.root);
  if (page.is_ok() && page.value().level != world_.root_level)
    return Status(StatusCode::kCorrupt, page_path(folder_, world_.root) + ": expected level " +
                                            std::to_string(world_.root_level) + ", found " +
                                            std::to_string(page.value().level));
  return page;
}

Result<WorldPage> WorldFolder::page(const WorldEntry& entry, int level) const {
  Result<WorldPage> page = read(entry.content);
  NEARMESH_RETURN_IF_ERROR(page);
  const Status announced = check_page(page.value(), entry, level);
  if (!announced.is_ok()) return naming(page_path(folder_, entry.content), announced);
  return page;
}

std::string name_of_folder(const std::string& folder) {
  const fs::path its = fs::path(folder).lexically_normal();
  return (its.has_filename() ? its : its.parent_path()).stem().string();
}

Status write_world(const WorldPages& pages, const std::string& folder) {
  std::error_code error;
  fs::create_directories(fs::path(folder) / "pages", error);
  if (error) return {StatusCode::kIo, folder + ": cannot create: " + error.message()};
  for (const auto& [content, bytes] : pages.pages) {
    const std::string path = WorldFolder::page_path(folder, content);
    const auto there = read_small(path, bytes.size());
    if (there.is_ok() && there.value() == bytes) continue;
    NEARMESH_RETURN_IF_ERROR(write_bytes(path, kPageFile, bytes));
  }
  return write_bytes(WorldFolder::record_path(folder), kWorldFile, encode_world(pages.world));
}

}  // namespace nearmesh
