// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/model_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <new>

#include "audit.hpp"
#include "blocks.hpp"
#include "check_boxes.hpp"
#include "check_surface.hpp"
#include "core/base/digest.hpp"
#include "core/base/hash.hpp"
#include "file_layout.hpp"
#include "open_sharing.hpp"

namespace nearmesh {

using file_layout::DirectoryEntry;
using file_layout::OriginEntry;
using file_layout::Preamble;

namespace {

std::string range(std::uint64_t offset, std::uint64_t count) {
  return "bytes " + std::to_string(offset) + " to " + std::to_string(offset + count);
}

}  // namespace

struct ModelFile::Impl {
  std::string path;
  int descriptor = -1;
  struct stat opened {};  ///< as the file was then
  std::uint64_t size = 0;
  Preamble preamble;
  std::vector<std::uint8_t> header_bytes;
  SpmHeader header;
  MeshOrigin origin;
  std::vector<DirectoryEntry> directory;
  std::vector<std::span<const DirectoryEntry>> levels;
  std::vector<std::uint8_t> block;  ///< scratch of require()
  std::unique_ptr<SplitStore> store;
  DigestTree tree;  ///< of the blocks, once prove() was asked

  ~Impl() {
    if (descriptor >= 0) ::close(descriptor);
  }
  [[nodiscard]] Status corrupt(const std::string& what) const {
    return {StatusCode::kCorrupt, path + ": " + what + change()};
  }
  [[nodiscard]] std::string name(const DirectoryEntry& entry) const {
    return "block of node [" + std::to_string(entry.first) + ", " +
           std::to_string(entry.first + entry.size) + ") at byte " + std::to_string(entry.offset);
  }

  [[nodiscard]] std::string change() const;
  Status open();
  Status read(std::uint64_t offset, void* bytes, std::uint64_t count) const;
  Status read_preamble();
  Status read_header(SharedTables* shared);
  Status read_origin();
  Status read_directory();
  [[nodiscard]] Status check_directory();
  [[nodiscard]] Status read_block(const DirectoryEntry& entry,
                                  std::vector<std::uint8_t>& bytes) const;
  [[nodiscard]] Status check_blocks() const;
  [[nodiscard]] Status read_face_table(std::vector<std::uint32_t>& table) const;
  [[nodiscard]] Result<const DirectoryEntry*> entry_of(NodeSpan node) const;
  [[nodiscard]] const DirectoryEntry* entry_at(std::size_t level, NodeSpan node) const;
  Status load(const DirectoryEntry& entry);
};

/// For messages: why what was right when the file was opened is so no more.
std::string ModelFile::Impl::change() const {
  struct stat now {};
  if (::fstat(descriptor, &now) != 0 ||
      (now.st_size == opened.st_size && now.st_mtim.tv_sec == opened.st_mtim.tv_sec &&
       now.st_mtim.tv_nsec == opened.st_mtim.tv_nsec))
    return {};
  return " (the file was changed after it was opened: " + std::to_string(opened.st_size) +
         " bytes then, " + std::to_string(now.st_size) +
         " now; put another in its place by renaming, and open that)";
}

Status ModelFile::Impl::open() {
  // To open a FIFO waits for who writes to it, and to open a device may do something: neither is
  // opened, and what comes in the file's place just then does not block.
  if (::stat(path.c_str(), &opened) == 0 && !S_ISREG(opened.st_mode))
    return {StatusCode::kIo, path + ": not a regular file"};
  descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  if (descriptor < 0) return {StatusCode::kIo, path + ": cannot open: " + std::strerror(errno)};
  if (::fstat(descriptor, &opened) != 0 || !S_ISREG(opened.st_mode))
    return {StatusCode::kIo, path + ": not a regular file"};
  size = static_cast<std::uint64_t>(opened.st_size);
  if (size < sizeof(Preamble))
    return corrupt("an .spm file has at least " + std::to_string(sizeof(Preamble)) +
                   " bytes, found " + std::to_string(size));
  return Status::ok();
}

Status ModelFile::Impl::read(std::uint64_t offset, void* bytes, std::uint64_t count) const {
  for (std::uint64_t done = 0; done < count;) {
    const ssize_t got = ::pread(descriptor, static_cast<std::uint8_t*>(bytes) + done, count - done,
                                static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0)
      return {StatusCode::kIo,
              path + ": cannot read " + range(offset, count) + ": " + std::strerror(errno)};
    if (got == 0)
      return corrupt(range(offset, count) + ": the file ends at " + std::to_string(offset + done));
    done += static_cast<std::uint64_t>(got);
  }
  return Status::ok();
}

Status ModelFile::Impl::read_preamble() {
  NEARMESH_RETURN_IF_ERROR(read(0, &preamble, sizeof preamble));
  if (preamble.magic != file_layout::kMagic)
    return corrupt(
        "expected an .spm file, found other first bytes; nearmesh-model build makes one of a mesh");
  if (preamble.version != file_layout::kVersion)
    return {StatusCode::kUnsupported, path + ": .spm version " + std::to_string(preamble.version) +
                                          ", this build reads version " +
                                          std::to_string(file_layout::kVersion)};
  if (preamble.checksum !=
      hash_bytes({reinterpret_cast<const std::uint8_t*>(&preamble), sizeof(Preamble) - 8}))
    return corrupt("checksum of the preamble does not match");
  if (preamble.file_bytes != size)
    return corrupt("expected " + std::to_string(preamble.file_bytes) + " bytes, found " +
                   std::to_string(size) + " (cut, or written on): copy it again, or build it anew");
  const std::uint64_t directory_bytes =
      std::uint64_t{preamble.block_count} * sizeof(DirectoryEntry);
  if (preamble.header_bytes > kMaxHeaderBytes ||
      sizeof(Preamble) + preamble.header_bytes + sizeof(OriginEntry) > preamble.directory_offset ||
      preamble.directory_offset % alignof(DirectoryEntry) != 0 ||
      preamble.directory_offset > size || directory_bytes > size - preamble.directory_offset ||
      preamble.face_table_offset != preamble.directory_offset + directory_bytes)
    return corrupt("sections overlap or leave the file");
  return Status::ok();
}

Status ModelFile::Impl::read_header(SharedTables* shared) {
  header_bytes.resize(preamble.header_bytes);
  NEARMESH_RETURN_IF_ERROR(read(sizeof(Preamble), header_bytes.data(), header_bytes.size()));
  Result<SpmHeader> decoded = decode_header(header_bytes, shared);
  if (!decoded.is_ok()) return corrupt(decoded.status().message());
  header = std::move(decoded).value();
  if (header.content != preamble.content_hash)
    return corrupt("content hash: the header gives " + to_hex(header.content) + ", expected " +
                   to_hex(preamble.content_hash));
  return Status::ok();
}

Status ModelFile::Impl::read_origin() {
  OriginEntry entry;
  NEARMESH_RETURN_IF_ERROR(read(preamble.directory_offset - sizeof entry, &entry, sizeof entry));
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(&entry),
                                            offsetof(OriginEntry, checksum));
  if (static_cast<std::uint32_t>(hash_bytes(bytes)) != entry.checksum)
    return corrupt("checksum of the origin does not match");
  const auto is_length = [](double x) { return std::isfinite(x) && x > 0; };
  if (!is_length(entry.unit_m) || !is_length(entry.scale) ||
      entry.unit_source > static_cast<std::uint8_t>(OriginSource::kOption) ||
      entry.up > static_cast<std::uint8_t>(UpAxis::kZ) ||
      entry.up_source > static_cast<std::uint8_t>(OriginSource::kOption) || entry.z_up > 1)
    return corrupt("the origin has a unit, a source or an axis that does not exist");
  origin = {.unit_m = entry.unit_m,
            .scale = entry.scale,
            .unit_source = static_cast<OriginSource>(entry.unit_source),
            .up = static_cast<UpAxis>(entry.up),
            .up_source = static_cast<OriginSource>(entry.up_source),
            .z_up = entry.z_up != 0};
  return Status::ok();
}

Status ModelFile::Impl::read_directory() {
  // Each block holds a split of its own, so this also bounds what is read here.
  if (preamble.block_count > header.split_count())
    return corrupt("expected at most " + std::to_string(header.split_count()) + " blocks, found " +
                   std::to_string(preamble.block_count));
  directory.resize(preamble.block_count);
  const std::uint64_t bytes = directory.size() * sizeof(DirectoryEntry);
  NEARMESH_RETURN_IF_ERROR(read(preamble.directory_offset, directory.data(), bytes));
  if (hash_bytes({reinterpret_cast<const std::uint8_t*>(directory.data()), bytes}) !=
      preamble.directory_checksum)
    return corrupt("checksum of the directory does not match");
  std::vector<ContentHash> leaves;
  leaves.reserve(directory.size() + 1);
  for (const DirectoryEntry& entry : directory) leaves.push_back(entry.digest);
  leaves.push_back(preamble.face_table_digest);
  if (const ContentHash root = tree_root(std::move(leaves)); root != header.blocks_root)
    return corrupt("blocks: their digests give " + to_hex(root) + ", the header has " +
                   to_hex(header.blocks_root));
  if ((size - preamble.face_table_offset) !=
      std::uint64_t{header.face_count} * sizeof(std::uint32_t))
    return corrupt("length of the face table does not match the header's face count");
  return check_directory();
}

Status ModelFile::Impl::check_directory() {
  // Entries stand by level, then by first id; require() searches within a level. Their blocks stand
  // one after the other: were one named by many entries, to read them all would take far longer
  // than the file is long.
  const std::span<const DirectoryEntry> all = directory;
  const std::uint64_t blocks_end = preamble.directory_offset - sizeof(OriginEntry);
  std::uint64_t offset = sizeof(Preamble) + preamble.header_bytes;
  for (std::size_t begin = 0; begin < all.size();) {
    if (all[begin].size < 2) return corrupt("directory entry " + std::to_string(begin));
    const int level = block_level(all[begin].size);
    std::size_t end = begin;
    std::uint64_t next = 0;
    for (; end < all.size() && all[end].size >= 2 && block_level(all[end].size) == level; ++end) {
      const DirectoryEntry& entry = all[end];
      if (entry.offset != offset)
        return corrupt("directory entry " + std::to_string(end) + ": expected its block at byte " +
                       std::to_string(offset) + ", where the one before ends, found " +
                       std::to_string(entry.offset) + "; build the model again");
      if (entry.first < next || std::uint64_t{entry.first} + entry.size > header.vertex_count ||
          entry.bytes > blocks_end - offset)
        return corrupt("directory entry " + std::to_string(end));
      offset += entry.bytes;
      next = std::uint64_t{entry.first} + entry.size;
    }
    if (level < static_cast<int>(levels.size())) return corrupt("directory levels out of order");
    levels.resize(static_cast<std::size_t>(level) + 1);
    levels.back() = all.subspan(begin, end - begin);
    begin = end;
  }
  return Status::ok();
}

Status ModelFile::Impl::read_block(const DirectoryEntry& entry,
                                   std::vector<std::uint8_t>& bytes) const {
  try {
    bytes.resize(entry.bytes);
  } catch (const std::bad_alloc&) {
    return {StatusCode::kIo,
            path + ": no memory for " + std::to_string(entry.bytes) + " bytes: " + name(entry)};
  }
  NEARMESH_RETURN_IF_ERROR(read(entry.offset, bytes.data(), bytes.size()));
  const auto unsealed = unseal_batch(header.content, bytes);
  if (!unsealed.is_ok()) return corrupt(name(entry) + ": " + unsealed.status().message());
  if (leaf_digest(entry.first, entry.size, unsealed.value()) != entry.digest)
    return corrupt(name(entry) + ": digest does not match");
  return Status::ok();
}

Status ModelFile::Impl::load(const DirectoryEntry& entry) {
  NEARMESH_RETURN_IF_ERROR(read_block(entry, block));
  const Result<SplitBatch> batch =
      decode_batch(header, std::span(block).first(block.size() - kSealBytes));
  if (!batch.is_ok()) return corrupt(name(entry) + ": " + batch.status().message());
  for (const SplitRecord& record : batch.value().splits) {
    const std::span<const SplitFace> faces{batch.value().faces.data() + record.face_begin,
                                           record.face_count};
    const GridBox outside =
        store->outside_of(faces, [this](VertexId corner) { return store->is_known(corner); });
    const auto inserted = store->insert(record, faces, outside);
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

Result<ModelFile> ModelFile::open(const std::string& path) { return open_sharing(path, nullptr); }

Result<ModelFile> open_sharing(const std::string& path, SharedTables* shared) {
  auto impl = std::make_unique<ModelFile::Impl>();
  impl->path = path;
  NEARMESH_RETURN_IF_ERROR(impl->open());
  NEARMESH_RETURN_IF_ERROR(impl->read_preamble());
  NEARMESH_RETURN_IF_ERROR(impl->read_header(shared));
  NEARMESH_RETURN_IF_ERROR(impl->read_origin());
  try {
    NEARMESH_RETURN_IF_ERROR(impl->read_directory());
    impl->store = std::make_unique<SplitStore>(impl->header);
  } catch (const std::bad_alloc&) {  // a limit of this process: a store spans all ids
    return Status{StatusCode::kIo, path + ": no address space for " +
                                       std::to_string(impl->header.vertex_count) + " vertices"};
  }
  return ModelFile(std::move(impl));
}

const std::string& ModelFile::path() const { return impl_->path; }
const SpmHeader& ModelFile::header() const { return impl_->header; }
std::span<const std::uint8_t> ModelFile::header_bytes() const { return impl_->header_bytes; }
const ContentHash& ModelFile::content_hash() const { return impl_->preamble.content_hash; }
std::uint64_t ModelFile::file_bytes() const { return impl_->size; }
std::uint64_t ModelFile::mesh_bytes() const {
  std::uint64_t bytes = impl_->preamble.header_bytes;
  for (const DirectoryEntry& entry : impl_->directory) bytes += entry.bytes;
  return bytes;
}
const MeshOrigin& ModelFile::origin() const { return impl_->origin; }
std::uint64_t ModelFile::block_count() const { return impl_->preamble.block_count; }
const SplitStore& ModelFile::store() const { return *impl_->store; }

/// The block of this level around a node; nullptr: there is none.
const DirectoryEntry* ModelFile::Impl::entry_at(std::size_t level, NodeSpan node) const {
  const auto entries = levels[level];
  const auto at =
      std::upper_bound(entries.begin(), entries.end(), node.begin(),
                       [](std::uint32_t v, const DirectoryEntry& e) { return v < e.first; });
  if (at == entries.begin() || node.end() > (at - 1)->first + (at - 1)->size) return nullptr;
  return &*(at - 1);
}

Result<const DirectoryEntry*> ModelFile::Impl::entry_of(NodeSpan node) const {
  const auto level = static_cast<std::size_t>(block_level(node.size));
  if (level >= levels.size()) return corrupt("no block holds a node of that size");
  const DirectoryEntry* entry = entry_at(level, node);
  if (entry == nullptr)
    return corrupt("no block holds node [" + std::to_string(node.begin()) + ", " +
                   std::to_string(node.end()) + ")");
  return entry;
}

Result<std::vector<std::vector<std::uint8_t>>> ModelFile::prove(NodeSpan node) {
  Impl& impl = *impl_;
  if (impl.tree.empty()) {
    std::vector<ContentHash> leaves;
    for (const DirectoryEntry& entry : impl.directory) leaves.push_back(entry.digest);
    leaves.push_back(impl.preamble.face_table_digest);
    impl.tree = grow_tree(std::move(leaves));
  }
  // A node of the content is in a block of its level. What is none may reach across all of those:
  // the next larger block shows it.
  const DirectoryEntry* entry = nullptr;
  for (auto level = static_cast<std::size_t>(block_level(node.size));
       entry == nullptr && level < impl.levels.size(); ++level)
    entry = impl.entry_at(level, node);
  if (entry == nullptr)
    return Status{StatusCode::kInvalidArgument,
                  to_string(node) + " is within no part of the model"};
  AuditedBlock block{{{entry->first}, entry->size}, {}, {}};
  NEARMESH_RETURN_IF_ERROR(impl.read_block(*entry, block.bytes));
  block.bytes.resize(block.bytes.size() - kSealBytes);
  block.path = path_of(impl.tree, static_cast<std::size_t>(entry - impl.directory.data()));
  return audit_pieces(block);
}

Status ModelFile::require(NodeSpan node) {
  Impl& impl = *impl_;
  if (node.size < 2 || (impl.store->is_node(node) && impl.store->split_of(node).is_valid()))
    return Status::ok();
  const Result<const DirectoryEntry*> found = impl.entry_of(node);
  NEARMESH_RETURN_IF_ERROR(found);
  const DirectoryEntry& entry = *found.value();
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

Status ModelFile::Impl::check_blocks() const {
  std::vector<std::uint8_t> bytes;
  std::uint64_t end = sizeof(Preamble) + preamble.header_bytes;
  for (const DirectoryEntry& entry : directory) {
    NEARMESH_RETURN_IF_ERROR(read_block(entry, bytes));
    end = entry.offset + entry.bytes;
  }
  // What fills up the last block is under no checksum.
  const std::uint64_t origin_offset = preamble.directory_offset - sizeof(OriginEntry);
  if (origin_offset - end >= alignof(DirectoryEntry))
    return corrupt(range(end, origin_offset - end) + ": expected the origin");
  bytes.resize(origin_offset - end);
  NEARMESH_RETURN_IF_ERROR(read(end, bytes.data(), bytes.size()));
  if (std::any_of(bytes.begin(), bytes.end(), [](std::uint8_t byte) { return byte != 0; }))
    return corrupt("bytes before the origin: expected zeros");
  return Status::ok();
}

Status ModelFile::Impl::read_face_table(std::vector<std::uint32_t>& table) const {
  table.resize(header.face_count);
  const std::uint64_t bytes = table.size() * sizeof(std::uint32_t);
  NEARMESH_RETURN_IF_ERROR(read(preamble.face_table_offset, table.data(), bytes));
  if (leaf_digest(0, 0, {reinterpret_cast<const std::uint8_t*>(table.data()), bytes}) !=
      preamble.face_table_digest)
    return corrupt("digest of the face table does not match");
  return Status::ok();
}

Status ModelFile::verify() const {
  NEARMESH_RETURN_IF_ERROR(impl_->check_blocks());
  std::vector<std::uint32_t> table;
  return impl_->read_face_table(table);
}

Status ModelFile::check_deep() {
  NEARMESH_RETURN_IF_ERROR(verify());
  NEARMESH_RETURN_IF_ERROR(require_all());
  if (const Status boxes = check_boxes(store()); !boxes.is_ok())
    return impl_->corrupt(boxes.message());
  const Status surface = check_surface(store());
  return surface.is_ok() ? surface : impl_->corrupt(surface.message());
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
  NEARMESH_RETURN_IF_ERROR(impl_->check_blocks());
  std::vector<std::uint32_t> table;
  NEARMESH_RETURN_IF_ERROR(impl_->read_face_table(table));
  NEARMESH_RETURN_IF_ERROR(require_all());
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
