// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// The .spm file, read piece by piece (layout and reasons: core/spm_format.md). Opening reads the
// header and the directory (40 bytes a block, about one a vertex); blocks are read, checked and
// decoded when a request first touches them, so resident memory follows what is touched.
// The file may change meanwhile: one that is renamed or deleted is read on as it was; one that is
// cut or written over gives kCorrupt, never another mesh, since every block must have the digest
// that the directory had when it was opened. That is also why it is not mapped: what is cut off a
// mapped file ends the process that touches it (SIGBUS).

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/mesh_origin.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

/// Which face of the input a face is, and which of its corners() the input names first.
struct FaceNumber {
  FaceId face;
  std::uint8_t first_corner = 0;
};

/// Input numbers of all faces of a model. They stay in the file: peers name faces by FaceKey.
class FaceNumbering {
 public:
  /// `numbers` in canonical order: base faces, then by split, then by index. The store must be
  /// complete.
  FaceNumbering(const SplitStore& store, std::vector<FaceNumber> numbers);
  [[nodiscard]] FaceNumber operator[](FaceKey key) const {
    return numbers_[(key.split.is_valid() ? first_[key.split.value] : 0) + key.index];
  }

 private:
  std::vector<std::uint32_t> first_;  // by split
  std::vector<FaceNumber> numbers_;
};

class ModelFile {
 public:
  /// Holds a file descriptor. Errors: kIo (cannot open or read, no address space), kCorrupt
  /// (truncated, checksum), kUnsupported (version); each names path, place, expected and found.
  [[nodiscard]] static Result<ModelFile> open(const std::string& path);
  ModelFile(ModelFile&&) noexcept;
  ModelFile& operator=(ModelFile&&) noexcept;
  ~ModelFile();

  [[nodiscard]] const std::string& path() const;
  [[nodiscard]] const SpmHeader& header() const;
  /// The header as it stands in the file and goes on the wire.
  [[nodiscard]] std::span<const std::uint8_t> header_bytes() const;
  /// Names the whole content; models with equal hashes are the same model.
  [[nodiscard]] const ContentHash& content_hash() const;
  /// Where its metres and axes come from, as whoever built it was told. Not part of the content.
  [[nodiscard]] const MeshOrigin& origin() const;
  [[nodiscard]] std::uint64_t file_bytes() const;
  /// Header and all blocks: what a whole replica would have to receive.
  [[nodiscard]] std::uint64_t mesh_bytes() const;
  [[nodiscard]] std::uint64_t block_count() const;
  /// What is decoded so far. Grows with `require`.
  [[nodiscard]] const SplitStore& store() const;

  /// Makes the split of `node` known to store(). Cost: a look-up, or one block decoded (about 15
  /// us).
  /// Errors: kCorrupt naming the block, also where it holds no such node or the file has changed;
  /// kIo. Threads: one at a time.
  [[nodiscard]] Status require(NodeSpan node);
  /// The block that holds the split of `node`, as it is stored, with what shows that it is of this
  /// content: what answers an audit, in pieces, without seals. Of a span that is no node the
  /// smallest block around it, which shows that: one of its splits cuts the span in two. Cost: the
  /// block; the first time a digest for each seven blocks.
  /// Errors: kInvalidArgument where the span is within none of the model's roots; kCorrupt where
  /// the file has changed; kIo; kUnsupported where the block is larger than an audit may be.
  [[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> prove(NodeSpan node);
  /// Decodes everything. Errors: those of require(). Cost: O(model), some 6 M splits/s.
  [[nodiscard]] Status require_all();
  /// Checks every digest without decoding.
  /// Errors: kCorrupt naming the place, kIo. Cost: the file is read once.
  [[nodiscard]] Status verify() const;
  /// Checks and decodes everything, that each node's box encloses every face that has a corner in
  /// it, and that the header says the truth of the surface: what every certified answer about the
  /// model rests on. Cost: O(model).
  /// Errors: kCorrupt naming the node, or what was counted.
  [[nodiscard]] Status check_deep();

  /// Reads the table of input face numbers; decodes everything. Errors: kCorrupt.
  [[nodiscard]] Result<FaceNumbering> face_numbering();

 private:
  friend Result<ModelFile> open_sharing(const std::string& path, SharedTables* shared);
  struct Impl;
  explicit ModelFile(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh
