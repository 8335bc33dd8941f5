// SPDX-License-Identifier: Apache-2.0
// An .spm file of any content. The first byte says what the rest is: a file as it stands; a file
// whose checksums are put right first, so that the decoders behind them are reached; changes to a
// true file, put right too; or a header.

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <string>

#include "core/spm/file_layout.hpp"
#include "fuzz_models.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#include "reseal.hpp"

using namespace nearmesh;
using file_layout::DirectoryEntry;
using file_layout::OriginEntry;
using file_layout::Preamble;

namespace {

/// A file in memory, under a path.
class MemoryFile {
 public:
  MemoryFile() : file_(::memfd_create("model", MFD_CLOEXEC)) { FUZZ_CHECK(file_ >= 0); }
  [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(file_); }
  void write(const std::vector<std::uint8_t>& bytes) const {
    FUZZ_CHECK(::ftruncate(file_, static_cast<off_t>(bytes.size())) == 0);
    FUZZ_CHECK(::pwrite(file_, bytes.data(), bytes.size(), 0) ==
               static_cast<ssize_t>(bytes.size()));
  }

 private:
  int file_;
};

const std::vector<std::uint8_t>& true_file() {
  static const std::vector<std::uint8_t> bytes = [] {
    const std::string path = "/dev/shm/nearmesh_fuzz_" + std::to_string(::getpid());
    const BakedModel& model = fuzz::models().front().baked;
    FUZZ_CHECK(write_model_file(model.header, model.store, model.numbers, path).is_ok());
    std::vector<std::uint8_t> content;
    std::FILE* file = std::fopen(path.c_str(), "rb");
    FUZZ_CHECK(file != nullptr);
    for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file))
      content.push_back(static_cast<std::uint8_t>(c));
    std::fclose(file);
    ::unlink(path.c_str());
    return content;
  }();
  return bytes;
}

/// Sizes and checksums as a writer would set them, where the sections lie inside the file.
void put_right(std::vector<std::uint8_t>& bytes) {
  if (bytes.size() < sizeof(Preamble)) return;
  Preamble p;
  std::memcpy(&p, bytes.data(), sizeof p);
  std::memcpy(bytes.data(), &p, sizeof p);
  if (p.directory_offset <= bytes.size() && p.block_count <= bytes.size()) test::reseal(bytes);
}

void read_header(std::span<const std::uint8_t> bytes) {
  const Result<SpmHeader> header = decode_header(bytes);
  if (!header.is_ok()) return;
  const std::vector<std::uint8_t> again = encode_header(header.value());
  const Result<SpmHeader> back = decode_header(again);
  FUZZ_CHECK(back.is_ok());
  FUZZ_CHECK(encode_header(back.value()) == again);
}

void open_file(const std::string& path) {
  Result<ModelFile> opened = ModelFile::open(path);
  if (!opened.is_ok()) {
    FUZZ_CHECK(opened.status().message().find(path) != std::string::npos);
    return;
  }
  ModelFile& file = opened.value();
  const SplitStore& store = file.store();
  static_cast<void>(file.mesh_bytes());
  const bool is_whole = file.verify().is_ok();
  // As requests come: from the roots down, one node after the other.
  std::vector<NodeSpan> stack;
  for (const BaseRoot& root : store.roots()) stack.push_back(root.node);
  for (int steps = 0; steps < 300 && !stack.empty(); ++steps) {
    const NodeSpan node = stack.back();
    stack.pop_back();
    if (node.size < 2 || !file.require(node).is_ok()) continue;
    FUZZ_CHECK(store.is_node(node));
    FUZZ_CHECK(!store.box(node).is_empty());
    const VertexId split = store.split_of(node);
    FUZZ_CHECK(split.is_valid());
    stack.push_back(node.left_of(split));
    stack.push_back(node.right_of(split));
  }
  static_cast<void>(file.require({{7}, 12}));
  const bool is_complete = file.require_all().is_ok();
  const Result<FaceNumbering> numbers = file.face_numbering();
  FUZZ_CHECK(!numbers.is_ok() || (is_whole && is_complete));
  if (store.vertex_count() > 10000) return;
  ActiveMesh mesh(store);
  RefineDelta delta;
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
    FUZZ_CHECK(mesh.split({v}, delta) == store.is_known({v}));
  fuzz::check_mesh(mesh);
  AbTree tree(mesh);
  if (numbers.is_ok())
    for (const ActiveFace& face : extract_faces(mesh)) static_cast<void>(numbers.value()[face.key]);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  const std::uint8_t kind = in.byte() % 4;
  if (kind == 3) {
    read_header(in.rest());
    return 0;
  }
  std::vector<std::uint8_t> bytes(in.rest().begin(), in.rest().end());
  if (kind == 2) {
    bytes = true_file();
    while (!in.is_empty()) {
      const std::size_t at = in.number<std::uint16_t>() % bytes.size();
      bytes[at] ^= in.byte();
    }
  }
  if (kind != 0) put_right(bytes);
  static const MemoryFile file;
  file.write(bytes);
  open_file(file.path());
  return 0;
}
