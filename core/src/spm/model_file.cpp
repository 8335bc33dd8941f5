// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/model_file.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>

#include "file_layout.hpp"
#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/spm/blocks.hpp"

namespace nearmesh {

using file_layout::DirectoryEntry;
using file_layout::Preamble;

struct ModelFile::Impl {
  std::string path;
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
  Preamble preamble;
  SpmHeader header;
  std::vector<std::span<const DirectoryEntry>> levels;
  std::unique_ptr<SplitStore> store;

  ~Impl() {
    if (data != nullptr) ::munmap(const_cast<std::uint8_t*>(data), size);
  }
  [[nodiscard]] std::span<const std::uint8_t> bytes(std::uint64_t offset,
                                                    std::uint64_t count) const {
    return {data + offset, count};
  }
  [[nodiscard]] Status corrupt(const std::string& what) const {
    return {StatusCode::kCorrupt, path + ": " + what};
  }
  [[nodiscard]] std::span<const DirectoryEntry> directory() const {
    return {reinterpret_cast<const DirectoryEntry*>(data + preamble.directory_offset),
            preamble.block_count};
  }
  [[nodiscard]] std::string name(const DirectoryEntry& entry) const {
    return "block of node [" + std::to_string(entry.first) + ", " +
           std::to_string(entry.first + entry.size) + ") at byte " + std::to_string(entry.offset);
  }

  Status map();
  Status read_preamble();
  Status read_directory();
  [[nodiscard]] Status check_block(const DirectoryEntry& entry) const;
  Status load(const DirectoryEntry& entry);
};

Status ModelFile::Impl::map() {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return {StatusCode::kIo, path + ": cannot open: " + std::strerror(errno)};
  struct stat info {};
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
    ::close(fd);
    return {StatusCode::kIo, path + ": not a regular file"};
  }
  size = static_cast<std::size_t>(info.st_size);
  if (size < sizeof(Preamble)) {
    ::close(fd);
    return corrupt("an .spm file has at least " + std::to_string(sizeof(Preamble)) +
                   " bytes, found " + std::to_string(size));
  }
  void* mapped = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, fd, 0);
  ::close(fd);
  if (mapped == MAP_FAILED)
    return {StatusCode::kIo, path + ": cannot map: " + std::strerror(errno)};
  data = static_cast<const std::uint8_t*>(mapped);
  return Status::ok();
}

Status ModelFile::Impl::read_preamble() {
  std::memcpy(&preamble, data, sizeof preamble);
  if (preamble.magic != file_layout::kMagic) return corrupt("not an .spm file (magic bytes)");
  if (preamble.version != file_layout::kVersion)
    return {StatusCode::kUnsupported, path + ": .spm version " + std::to_string(preamble.version) +
                                          ", this build reads version " +
                                          std::to_string(file_layout::kVersion)};
  if (preamble.checksum != hash_bytes(bytes(0, sizeof(Preamble) - 8)))
    return corrupt("checksum of the preamble does not match");
  if (preamble.file_bytes != size)
    return corrupt("expected " + std::to_string(preamble.file_bytes) + " bytes, found " +
                   std::to_string(size) + " (truncated or appended to)");
  const std::uint64_t directory_bytes =
      std::uint64_t{preamble.block_count} * sizeof(DirectoryEntry);
  if (preamble.header_bytes > kMaxHeaderBytes ||
      sizeof(Preamble) + preamble.header_bytes > preamble.directory_offset ||
      preamble.directory_offset % alignof(DirectoryEntry) != 0 ||
      preamble.directory_offset > size || directory_bytes > size - preamble.directory_offset ||
      preamble.face_table_offset != preamble.directory_offset + directory_bytes)
    return corrupt("sections overlap or leave the file");
  return Status::ok();
}

Status ModelFile::Impl::read_directory() {
  const std::uint64_t found = hash_bytes(
      bytes(preamble.directory_offset,
            std::uint64_t{preamble.block_count} * sizeof(DirectoryEntry)),
      hash_bytes(bytes(sizeof(Preamble), preamble.header_bytes), preamble.face_table_checksum));
  if (found != preamble.content_hash)
    return corrupt("checksum of header and directory does not match");
  if ((size - preamble.face_table_offset) !=
      std::uint64_t{header.face_count} * sizeof(std::uint32_t))
    return corrupt("length of the face table does not match the header's face count");
  // Entries stand by level, then by first id; require() searches within a level.
  const std::span<const DirectoryEntry> all = directory();
  for (std::size_t begin = 0; begin < all.size();) {
    if (all[begin].size < 2) return corrupt("directory entry " + std::to_string(begin));
    const int level = block_level(all[begin].size);
    std::size_t end = begin;
    std::uint64_t next = 0;
    for (; end < all.size() && all[end].size >= 2 && block_level(all[end].size) == level; ++end) {
      const DirectoryEntry& entry = all[end];
      if (entry.first < next || std::uint64_t{entry.first} + entry.size > header.vertex_count ||
          entry.offset < sizeof(Preamble) || entry.offset > preamble.directory_offset ||
          entry.bytes > preamble.directory_offset - entry.offset)
        return corrupt("directory entry " + std::to_string(end));
      next = std::uint64_t{entry.first} + entry.size;
    }
    if (level < static_cast<int>(levels.size())) return corrupt("directory levels out of order");
    levels.resize(static_cast<std::size_t>(level) + 1);
    levels.back() = all.subspan(begin, end - begin);
    begin = end;
  }
  return Status::ok();
}

Status ModelFile::Impl::check_block(const DirectoryEntry& entry) const {
  if (static_cast<std::uint32_t>(hash_bytes(bytes(entry.offset, entry.bytes))) != entry.checksum)
    return corrupt(name(entry) + ": checksum does not match");
  return Status::ok();
}

Status ModelFile::Impl::load(const DirectoryEntry& entry) {
  NEARMESH_RETURN_IF_ERROR(check_block(entry));
  const Result<SplitBatch> batch = decode_batch(header, bytes(entry.offset, entry.bytes));
  if (!batch.is_ok()) return corrupt(name(entry) + ": " + batch.status().message());
  for (const SplitRecord& record : batch.value().splits) {
    const std::span<const SplitFace> faces{batch.value().faces.data() + record.face_begin,
                                           record.face_count};
    const auto inserted = store->insert(record, faces);
    if (!inserted.is_ok()) return corrupt(name(entry) + ": " + inserted.status().message());
    if (inserted.value() == SplitStore::Insertion::kNoParent)
      return corrupt(name(entry) + ": does not hang on its level above");
  }
  return Status::ok();
}

ModelFile::ModelFile(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ModelFile::ModelFile(ModelFile&&) noexcept = default;
ModelFile& ModelFile::operator=(ModelFile&&) noexcept = default;
ModelFile::~ModelFile() = default;

Result<ModelFile> ModelFile::open(const std::string& path) {
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  NEARMESH_RETURN_IF_ERROR(impl->map());
  NEARMESH_RETURN_IF_ERROR(impl->read_preamble());
  Result<SpmHeader> header =
      decode_header(impl->bytes(sizeof(Preamble), impl->preamble.header_bytes));
  if (!header.is_ok()) return impl->corrupt(header.status().message());
  impl->header = std::move(header).value();
  NEARMESH_RETURN_IF_ERROR(impl->read_directory());
  try {
    impl->store = std::make_unique<SplitStore>(impl->header);
  } catch (const std::bad_alloc&) {  // a limit of this process: a store spans all ids
    return Status{StatusCode::kIo, path + ": no address space for " +
                                       std::to_string(impl->header.vertex_count) + " vertices"};
  }
  return ModelFile(std::move(impl));
}

const std::string& ModelFile::path() const { return impl_->path; }
const SpmHeader& ModelFile::header() const { return impl_->header; }
std::span<const std::uint8_t> ModelFile::header_bytes() const {
  return impl_->bytes(sizeof(Preamble), impl_->preamble.header_bytes);
}
std::uint64_t ModelFile::content_hash() const { return impl_->preamble.content_hash; }
std::uint64_t ModelFile::file_bytes() const { return impl_->size; }
std::uint64_t ModelFile::mesh_bytes() const {
  std::uint64_t bytes = impl_->preamble.header_bytes;
  for (const DirectoryEntry& entry : impl_->directory()) bytes += entry.bytes;
  return bytes;
}
std::uint64_t ModelFile::block_count() const { return impl_->preamble.block_count; }
const SplitStore& ModelFile::store() const { return *impl_->store; }

Status ModelFile::require(NodeSpan node) {
  Impl& impl = *impl_;
  if (node.size < 2 || (impl.store->is_node(node) && impl.store->split_of(node).is_valid()))
    return Status::ok();
  const auto level = static_cast<std::size_t>(block_level(node.size));
  if (level >= impl.levels.size()) return impl.corrupt("no block holds a node of that size");
  const auto entries = impl.levels[level];
  auto at = std::upper_bound(entries.begin(), entries.end(), node.begin(),
                             [](std::uint32_t v, const DirectoryEntry& e) { return v < e.first; });
  if (at == entries.begin() || node.end() > (at - 1)->first + (at - 1)->size)
    return impl.corrupt("no block holds node [" + std::to_string(node.begin()) + ", " +
                        std::to_string(node.end()) + ")");
  const DirectoryEntry& entry = *(at - 1);
  NEARMESH_RETURN_IF_ERROR(impl.load(entry));
  if (!impl.store->is_node(node) || !impl.store->split_of(node).is_valid())
    return impl.corrupt(impl.name(entry) + ": does not hold node [" + std::to_string(node.begin()) +
                        ", " + std::to_string(node.end()) + ")");
  return Status::ok();
}

Status ModelFile::require_all() {
  for (auto level = impl_->levels.rbegin(); level != impl_->levels.rend(); ++level)
    for (const DirectoryEntry& entry : *level)
      NEARMESH_RETURN_IF_ERROR(require({{entry.first}, entry.size}));
  if (impl_->store->known_splits() != impl_->header.split_count())
    return impl_->corrupt("expected " + std::to_string(impl_->header.split_count()) +
                          " splits, found " + std::to_string(impl_->store->known_splits()));
  return Status::ok();
}

Status ModelFile::verify() const {
  std::uint64_t end = sizeof(Preamble) + impl_->preamble.header_bytes;
  for (const DirectoryEntry& entry : impl_->directory()) {
    NEARMESH_RETURN_IF_ERROR(impl_->check_block(entry));
    end = std::max(end, entry.offset + entry.bytes);
  }
  // What fills up the last block is under no checksum.
  const auto padding = impl_->bytes(end, impl_->preamble.directory_offset - end);
  if (std::any_of(padding.begin(), padding.end(), [](std::uint8_t byte) { return byte != 0; }))
    return impl_->corrupt("bytes before the directory: expected zeros");
  const std::uint64_t faces = impl_->size - impl_->preamble.face_table_offset;
  if (hash_bytes(impl_->bytes(impl_->preamble.face_table_offset, faces)) !=
      impl_->preamble.face_table_checksum)
    return impl_->corrupt("checksum of the face table does not match");
  return Status::ok();
}

FaceNumbering::FaceNumbering(const SplitStore& store, std::vector<FaceNumber> numbers)
    : first_(store.vertex_count()), numbers_(std::move(numbers)) {
  auto next = static_cast<std::uint32_t>(store.base_faces().size());
  for (std::uint32_t v = 0; v < first_.size(); ++v) {
    first_[v] = next;
    if (!store.is_root({v})) next += static_cast<std::uint32_t>(store.faces({v}).size());
  }
  NEARMESH_ASSERT(next == numbers_.size());
}

Result<FaceNumbering> ModelFile::face_numbering() {
  NEARMESH_RETURN_IF_ERROR(verify());
  NEARMESH_RETURN_IF_ERROR(require_all());
  const auto* table =
      reinterpret_cast<const std::uint32_t*>(impl_->data + impl_->preamble.face_table_offset);
  std::vector<FaceNumber> numbers(impl_->header.face_count);
  std::uint64_t faces = impl_->store->base_faces().size();
  for (std::uint32_t v = 0; v < impl_->header.vertex_count; ++v)
    if (!impl_->store->is_root({v})) faces += impl_->store->faces({v}).size();
  if (faces != numbers.size())
    return impl_->corrupt("expected " + std::to_string(numbers.size()) + " faces, found " +
                          std::to_string(faces));
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    numbers[i] = {{table[i] >> 2}, static_cast<std::uint8_t>(table[i] & 3U)};
    if (numbers[i].first_corner > 2) return impl_->corrupt("face table entry " + std::to_string(i));
  }
  return FaceNumbering(*impl_->store, std::move(numbers));
}

}  // namespace nearmesh
