// SPDX-License-Identifier: Apache-2.0
#include <bit>

#include "core/base/float_guard.hpp"
#include "core/base/output_file.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {
namespace {

template <class UInt>
char* put_little_endian(char* out, UInt value) {
  for (std::size_t k = 0; k < sizeof(UInt); ++k) *out++ = static_cast<char>(value >> (8 * k));
  return out;
}

Status write_body(const IndexedMesh& mesh, OutputFile& file) {
  // 4 KiB at a time: a call for each number would cost more than the number.
  constexpr std::size_t kBatch = 4096, kRecord = 24;
  char buffer[kBatch + kRecord];
  char* end = buffer;
  const auto flush = [&](std::size_t limit) {
    const auto used = static_cast<std::size_t>(end - buffer);
    if (used < limit) return Status::ok();
    end = buffer;
    return file.write({buffer, used});
  };
  for (const auto& p : mesh.positions_m) {
    for (const double x : p) end = put_little_endian(end, std::bit_cast<std::uint64_t>(x));
    NEARMESH_RETURN_IF_ERROR(flush(kBatch));
  }
  for (const auto& f : mesh.faces) {
    *end++ = 3;
    for (const std::uint32_t v : f) end = put_little_endian(end, v);
    NEARMESH_RETURN_IF_ERROR(flush(kBatch));
  }
  return flush(0);
}

}  // namespace

Status write_ply(const IndexedMesh& mesh, const std::string& path) {
  const FloatGuard guard;
  Result<OutputFile> file = OutputFile::create(path, kPlyFile);
  NEARMESH_RETURN_IF_ERROR(file);
  NEARMESH_RETURN_IF_ERROR(file.value().write(
      "ply\nformat binary_little_endian 1.0\nelement vertex " +
      std::to_string(mesh.positions_m.size()) +
      "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
      std::to_string(mesh.faces.size()) +
      "\nproperty list uchar int vertex_indices\nend_header\n"));
  NEARMESH_RETURN_IF_ERROR(write_body(mesh, file.value()));
  return file.value().close();
}

}  // namespace nearmesh
