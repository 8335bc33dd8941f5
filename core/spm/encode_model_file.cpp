// SPDX-License-Identifier: Apache-2.0
#include "encode_model_file.hpp"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <utility>

#include "blocks.hpp"
#include "core/base/digest.hpp"
#include "core/base/hash.hpp"
#include "core/base/parallel.hpp"
#include "file_layout.hpp"

namespace nearmesh {
namespace {

using file_layout::DirectoryEntry;
using file_layout::OriginEntry;
using file_layout::Preamble;

template <class T>
std::span<const std::uint8_t> bytes_of(const T* data, std::size_t count) {
  return {reinterpret_cast<const std::uint8_t*>(data), count * sizeof(T)};
}

void pad_to(std::string& out, std::size_t alignment) {
  out.resize((out.size() + alignment - 1) / alignment * alignment);
}

template <class T>
void append(std::string& out, const T* data, std::size_t count) {
  out.append(reinterpret_cast<const char*>(data), count * sizeof(T));
}

OriginEntry encode_origin(const MeshOrigin& origin) {
  OriginEntry entry{.unit_m = origin.unit_m,
                    .scale = origin.scale,
                    .unit_source = static_cast<std::uint8_t>(origin.unit_source),
                    .up = static_cast<std::uint8_t>(origin.up),
                    .up_source = static_cast<std::uint8_t>(origin.up_source),
                    .z_up = origin.z_up ? std::uint8_t{1} : std::uint8_t{0}};
  entry.checksum = static_cast<std::uint32_t>(
      hash_bytes(bytes_of(&entry, 1).first(offsetof(OriginEntry, checksum))));
  return entry;
}

struct Group {
  std::vector<DirectoryEntry> directory;  // without places in the file
  std::vector<std::vector<std::uint8_t>> blocks;
};

Group encode_group(const SpmHeader& header, const SplitStore& store,
                   std::span<const NodeSpan> roots) {
  Group group;
  for (const NodeSpan& root : roots) {
    auto encoded = encode_batches(header, store, block_treelet(store, root), BoxPolicy::kAllNodes,
                                  std::size_t{1} << 31);
    NEARMESH_ASSERT(encoded.size() == 1);
    group.directory.push_back({.first = root.begin(),
                               .size = root.size,
                               .digest = leaf_digest(root.begin(), root.size, encoded.front())});
    group.blocks.push_back(std::move(encoded.front()));
  }
  return group;
}

ContentHash root_of(std::span<const Group> groups, const ContentHash& last) {
  std::vector<ContentHash> leaves;
  for (const Group& group : groups)
    for (const DirectoryEntry& entry : group.directory) leaves.push_back(entry.digest);
  leaves.push_back(last);
  return tree_root(std::move(leaves));
}

}  // namespace

EncodedModel encode_model_file(const SpmHeader& header, const SplitStore& store,
                               std::span<const FaceNumber> numbers, unsigned threads,
                               const MeshOrigin& origin) {
  NEARMESH_ASSERT(store.known_splits() == header.split_count());
  NEARMESH_ASSERT(numbers.size() == header.face_count && numbers.size() < file_layout::kMaxFaces);
  // Blocks are encoded in groups, each alone, and stand in the order of their roots.
  constexpr std::size_t kGroup = 64;
  const std::vector<NodeSpan> roots = block_roots(store);
  std::vector<Group> groups((roots.size() + kGroup - 1) / kGroup);
  for_each_index(groups.size(), threads, [&](std::size_t i) {
    const std::size_t count = std::min(kGroup, roots.size() - i * kGroup);
    groups[i] = encode_group(header, store, std::span(roots).subspan(i * kGroup, count));
  });
  std::vector<std::uint32_t> table;
  table.reserve(numbers.size());
  for (const FaceNumber& number : numbers)
    table.push_back(number.face.value << 2 | number.first_corner);

  Preamble preamble;
  preamble.block_count = static_cast<std::uint32_t>(roots.size());
  preamble.face_table_digest = leaf_digest(0, 0, bytes_of(table.data(), table.size()));
  SpmHeader named = header;
  named.blocks_root = root_of(groups, preamble.face_table_digest);
  const std::vector<std::uint8_t> header_bytes = encode_header(named);
  preamble.header_bytes = header_bytes.size();
  preamble.content_hash = digest_of(header_bytes);

  std::string out(sizeof(Preamble), '\0');
  append(out, header_bytes.data(), header_bytes.size());
  std::vector<DirectoryEntry> directory;
  directory.reserve(roots.size());
  for (Group& group : groups) {
    for (std::size_t i = 0; i < group.blocks.size(); ++i) {
      std::vector<std::uint8_t>& block = group.blocks[i];
      seal_batch(preamble.content_hash, block);
      DirectoryEntry& entry = group.directory[i];
      entry.offset = out.size();
      entry.bytes = block.size();
      append(out, block.data(), block.size());
      directory.push_back(entry);
    }
    group = Group{};
  }
  const std::uint64_t block_bytes = out.size() - sizeof(Preamble) - header_bytes.size();
  pad_to(out, alignof(DirectoryEntry));
  const OriginEntry entry = encode_origin(origin);
  append(out, &entry, 1);
  preamble.directory_offset = out.size();
  append(out, directory.data(), directory.size());
  preamble.directory_checksum = hash_bytes(bytes_of(directory.data(), directory.size()));
  preamble.face_table_offset = out.size();
  append(out, table.data(), table.size());
  preamble.file_bytes = out.size();
  preamble.checksum = hash_bytes(bytes_of(&preamble, 1).first(sizeof(Preamble) - 8));
  std::memcpy(out.data(), &preamble, sizeof preamble);
  const WrittenModel written{.file_bytes = out.size(),
                             .header_bytes = header_bytes.size(),
                             .block_bytes = block_bytes,
                             .blocks = directory.size(),
                             .content_hash = preamble.content_hash};
  return {std::move(out), written};
}

}  // namespace nearmesh
