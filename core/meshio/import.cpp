// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/meshio/import.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include "assimp_reader.hpp"
#include "child.hpp"
#include "core/base/float_guard.hpp"
#include "plain_formats.hpp"

namespace nearmesh {
namespace {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

Result<std::string> read_file(const std::string& path) {
  const auto failed = [] {
    return Status(StatusCode::kIo, std::string("cannot be read: ") + std::strerror(errno));
  };
  // Looked at before it is opened: opening a fifo would wait for its writer.
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return failed();
  if (!S_ISREG(info.st_mode)) return Status(StatusCode::kIo, "expected a regular file");
  const std::unique_ptr<std::FILE, FileCloser> file(std::fopen(path.c_str(), "rb"));
  if (!file) return failed();
  std::string bytes(static_cast<std::size_t>(info.st_size), '\0');
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), file.get()));
  if (std::ferror(file.get()) != 0) return failed();
  return bytes;
}

meshio::ChildLimits limits_for(std::uint64_t file_bytes) {
  constexpr std::uint64_t kMiB = 1 << 20;
  return {.memory_bytes = std::min(8192 * kMiB, 512 * kMiB + 200 * file_bytes),
          .wall_time = std::chrono::seconds(60 + 2 * (file_bytes / kMiB))};
}

Result<IndexedMesh> read_any(const std::string& path) {
  std::uint64_t file_bytes = 0;
  {
    const Result<std::string> bytes = read_file(path);
    NEARMESH_RETURN_IF_ERROR(bytes);
    if (bytes.value().empty()) return Status(StatusCode::kCorrupt, "the file is empty");
    if (const auto format = meshio::find_plain_format(path, bytes.value()))
      return meshio::read_plain(*format, bytes.value());
    file_bytes = bytes.value().size();
  }
  return meshio::run_in_child([&path] { return meshio::read_with_assimp(path); },
                              limits_for(file_bytes));
}

Status check_faces(const IndexedMesh& mesh) {
  if (mesh.faces.empty())
    return {StatusCode::kInvalidArgument, "expected at least one face, found none"};
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::uint32_t v : mesh.faces[f]) {
      if (v >= mesh.positions_m.size())
        return {StatusCode::kCorrupt,
                "face " + std::to_string(f) + ": expected vertex indices below " +
                    std::to_string(mesh.positions_m.size()) + ", found " + std::to_string(v)};
      for (const double x : mesh.positions_m[v])
        if (!std::isfinite(x))
          return {StatusCode::kInvalidArgument,
                  "vertex " + std::to_string(v) + ": expected finite coordinates, found " +
                      std::to_string(x) + " (face " + std::to_string(f) + ")"};
    }
  }
  return Status::ok();
}

}  // namespace

Result<IndexedMesh> import_mesh(const std::string& path) {
  const FloatGuard guard;
  Status status;
  try {
    Result<IndexedMesh> mesh = read_any(path);
    status = mesh.is_ok() ? check_faces(mesh.value()) : mesh.status();
    if (status.is_ok()) return mesh;
  } catch (const std::exception& e) {  // no memory for the file or the mesh
    status = Status(StatusCode::kIo, std::string("cannot be held: ") + e.what());
  }
  return Status(status.code(), path + ": " + status.message());
}

}  // namespace nearmesh
