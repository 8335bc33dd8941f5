// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

#include "core/base/float_guard.hpp"

namespace nearmesh {
namespace {

template <class UInt>
char* put_little_endian(char* out, UInt value) {
  for (std::size_t k = 0; k < sizeof(UInt); ++k) *out++ = static_cast<char>(value >> (8 * k));
  return out;
}

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

Status io_error(const std::string& path, const char* action) {
  return {StatusCode::kIo, path + ": cannot " + action + ": " + std::strerror(errno)};
}

bool write_body(const IndexedMesh& mesh, std::FILE* file) {
  // 4 KiB at a time; stdio's own buffer would cost a call a number.
  constexpr std::size_t kBatch = 4096, kRecord = 24;
  char buffer[kBatch + kRecord];
  char* end = buffer;
  const auto flush = [&](std::size_t limit) {
    const auto used = static_cast<std::size_t>(end - buffer);
    if (used < limit) return true;
    end = buffer;
    return std::fwrite(buffer, 1, used, file) == used;
  };
  for (const auto& p : mesh.positions_m) {
    for (const double x : p) end = put_little_endian(end, std::bit_cast<std::uint64_t>(x));
    if (!flush(kBatch)) return false;
  }
  for (const auto& f : mesh.faces) {
    *end++ = 3;
    for (const std::uint32_t v : f) end = put_little_endian(end, v);
    if (!flush(kBatch)) return false;
  }
  return flush(0);
}

}  // namespace

Status write_ply(const IndexedMesh& mesh, const std::string& path) {
  const FloatGuard guard;
  std::unique_ptr<std::FILE, FileCloser> file(std::fopen(path.c_str(), "wb"));
  if (!file) return io_error(path, "create");
  const bool written =
      std::fprintf(file.get(),
                   "ply\nformat binary_little_endian 1.0\nelement vertex %zu\n"
                   "property double x\nproperty double y\nproperty double z\n"
                   "element face %zu\nproperty list uchar int vertex_indices\nend_header\n",
                   mesh.positions_m.size(), mesh.faces.size()) > 0 &&
      write_body(mesh, file.get());
  if (!written) return io_error(path, "write");
  // Full disks are often told of only here.
  if (std::fclose(file.release()) != 0) return io_error(path, "finish writing");
  return Status::ok();
}

}  // namespace nearmesh
