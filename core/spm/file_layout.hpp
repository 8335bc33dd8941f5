// SPDX-License-Identifier: Apache-2.0
#pragma once
// Fixed parts of the .spm file; little-endian, as on every machine nearmesh runs on
// (core/spm_format.md).

#include <array>
#include <bit>
#include <cstdint>

#include "core/base/output_file.hpp"
#include "nearmesh/core/base/content_hash.hpp"

namespace nearmesh::file_layout {

static_assert(std::endian::native == std::endian::little,
              "the .spm reader takes structs as they stand in the file");

inline constexpr std::array<char, 8> kMagic{'N', 'M', 'S', 'P', 'M', '\r', '\n', '\x1a'};
inline constexpr std::uint32_t kVersion = 8;
/// Of any version.
inline constexpr FileKind kModelFile{"a nearmesh model (.spm)", {kMagic.data(), kMagic.size()}};

struct Preamble {
  std::array<char, 8> magic = kMagic;
  std::uint32_t version = kVersion;
  std::uint32_t block_count = 0;
  std::uint64_t header_bytes = 0;       // the header follows the preamble
  std::uint64_t directory_offset = 0;   // block_count entries
  std::uint64_t face_table_offset = 0;  // face_count numbers
  std::uint64_t file_bytes = 0;
  std::uint64_t directory_checksum = 0;
  ContentHash face_table_digest;  // the last leaf of the tree
  ContentHash content_hash;       // of the header, which holds the tree's root
  std::uint64_t checksum = 0;     // of the preamble before it
};
static_assert(sizeof(Preamble) == 96);

struct DirectoryEntry {
  std::uint32_t first = 0, size = 0;  // the block's root node
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
  ContentHash digest;  // a leaf of the tree
};
static_assert(sizeof(DirectoryEntry) == 40);

/// Where the model's metres and axes come from (mesh_origin.hpp). Stands before the directory; not
/// part of the content, since the same model may come from many files.
struct OriginEntry {
  double unit_m = 1, scale = 1;
  std::uint8_t unit_source = 0, up = 0, up_source = 0, z_up = 0;
  std::uint32_t checksum = 0;  // low half of the hash of what is before it
};
static_assert(sizeof(OriginEntry) == 24);

// A face number packs the place of the input's first corner in its two low bits.
inline constexpr std::uint32_t kMaxFaces = 1U << 30;

}  // namespace nearmesh::file_layout
