// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/codec.hpp"

#include <string>

#include "nearmesh/core/spm/train.hpp"
#include "record_codec.hpp"

namespace nearmesh {
namespace {

// The record of a treelet split, as the store knows it; faces are appended.
SplitRecord make_record(const SplitStore& store, const TreeletSplit& split,
                        std::vector<SplitFace>& faces) {
  SplitRecord record{.node = split.node, .split = split.split};
  const GridPoint& from = store.position(split.node.first);
  const GridPoint& to = store.position(split.split);
  for (int k = 0; k < 3; ++k) record.offset[k] = to[k] - from[k];
  const SplitFaces own = store.faces(split.split);
  record.face_begin = static_cast<std::uint32_t>(faces.size());
  record.face_count = static_cast<std::uint32_t>(own.size());
  faces.insert(faces.end(), own.begin(), own.end());
  // Who holds a part has no box of its own for a node that came split: it lies within the nearest ancestor's.
  const auto box_of = [&store](const NodeSpan& child) {
    const BoxCode code = store.box_code(child);
    return code[0] != kNoBoxCode ? code : encode_box(store.position(child.first), store.box(child));
  };
  if (record.left().size > 1) record.left_box = box_of(record.left());
  if (record.right().size > 1) record.right_box = box_of(record.right());
  return record;
}

// Follows which nodes the decoder expects next, so that only true attach nodes are named.
class ExpectedNodes {
 public:
  /// Takes `node`; true when it hangs on an earlier record of the same batch.
  bool take(const NodeSpan& node) {
    if (stack_.empty()) return false;
    NEARMESH_ASSERT(stack_.back() == node);
    stack_.pop_back();
    return true;
  }
  void push_children(const SplitRecord& record, const record::Inclusion& included) {
    if (included.right) stack_.push_back(record.right());
    if (included.left) stack_.push_back(record.left());
  }
  [[nodiscard]] bool pop(NodeSpan& node) {
    if (stack_.empty()) return false;
    node = stack_.back();
    stack_.pop_back();
    return true;
  }
  void clear() { stack_.clear(); }

 private:
  std::vector<NodeSpan> stack_;
};

// One batch under construction.
struct OpenBatch {
  BitWriter attach, body;
  std::uint32_t attach_count = 0, record_count = 0, last_attach = 0;
  record::OpenEdges edges;

  void add_attach(const NodeSpan& node) {
    attach.put_gamma(node.begin() - last_attach);
    attach.put_gamma(node.size - 2);
    last_attach = node.begin();
    ++attach_count;
  }
  // Upper bound of finish()'s size: flags and two counts of at most 63 bits.
  [[nodiscard]] std::size_t byte_bound() const {
    const std::size_t counts = 2 * (bit_length(record_count + 1) + bit_length(attach_count + 1));
    return (8 + counts + attach.bit_count() + body.bit_count() + 7) / 8;
  }
  [[nodiscard]] std::vector<std::uint8_t> finish(BoxPolicy policy) const {
    BitWriter out;
    out.put(static_cast<std::uint64_t>(policy), 8);
    out.put_gamma(record_count);
    out.put_gamma(attach_count);
    out.append(attach);
    out.append(body);
    return std::move(out).finish();
  }
};

Status corrupt(std::uint32_t record, const char* field) {
  return {StatusCode::kCorrupt,
          "split batch: record " + std::to_string(record) + ": " + field + " out of range"};
}

}  // namespace

std::vector<std::vector<std::uint8_t>> encode_batches(const SpmHeader& header,
                                                      const SplitStore& store,
                                                      const Treelet& treelet, BoxPolicy boxes,
                                                      std::size_t max_bytes) {
  std::vector<std::vector<std::uint8_t>> batches;
  OpenBatch open;
  ExpectedNodes expected;
  std::vector<SplitFace> faces;
  for (const TreeletSplit& split : treelet) {
    for (bool fits = false; !fits;) {
      faces.clear();
      SplitRecord record = make_record(store, split, faces);
      record::Inclusion included{split.left_included, split.right_included};
      const std::size_t attach_mark = open.attach.bit_count();
      const std::size_t body_mark = open.body.bit_count();
      const std::uint32_t last_attach = open.last_attach;
      const bool hangs = expected.take(split.node);
      if (!hangs) open.add_attach(split.node);
      record::WritingCoder coder(header.tables, open.body);
      record::code_record(coder, header, boxes, open.edges, record, included, faces, 0);
      ++open.record_count;
      fits = open.byte_bound() <= max_bytes || open.record_count == 1;
      if (fits) {
        expected.push_children(record, included);
        continue;
      }
      // Take the record back, close the batch, and start the next one with it.
      open.body.truncate(body_mark);
      --open.record_count;
      if (!hangs) {
        open.attach.truncate(attach_mark);
        open.last_attach = last_attach;
        --open.attach_count;
      }
      batches.push_back(open.finish(boxes));
      open = OpenBatch{};
      expected.clear();
    }
  }
  if (open.record_count > 0) batches.push_back(open.finish(boxes));
  return batches;
}

[[gnu::flatten]] Result<SplitBatch> decode_batch(const SpmHeader& header,
                                                 std::span<const std::uint8_t> bytes) {
  BitReader in(bytes);
  const std::uint32_t policy = in.get(8);
  if (policy > static_cast<std::uint32_t>(BoxPolicy::kAllNodes))
    return Status{StatusCode::kCorrupt,
                  "split batch: flags: expected 0 or 1, found " + std::to_string(policy)};
  const std::uint64_t record_count = in.get_gamma();
  const std::uint64_t attach_count = in.get_gamma();
  // Every attach node takes at least two bits and every record three, whatever the tables say.
  if (in.overrun() || attach_count * 2 > in.bits_left() || record_count > in.bits_left() ||
      attach_count > record_count)
    return Status{StatusCode::kCorrupt,
                  "split batch: counts exceed its " + std::to_string(bytes.size()) + " bytes"};
  std::vector<NodeSpan> attach(attach_count);
  std::uint64_t next = 0;
  for (NodeSpan& node : attach) {
    next += in.get_gamma();
    const std::uint64_t size = in.get_gamma() + 2;
    if (in.overrun() || next + size > header.vertex_count)
      return Status{StatusCode::kCorrupt, "split batch: attach node outside the model's " +
                                              std::to_string(header.vertex_count) + " vertices"};
    node = {{static_cast<std::uint32_t>(next)}, static_cast<std::uint32_t>(size)};
  }

  SplitBatch batch;
  ExpectedNodes expected;
  record::OpenEdges edges;
  // Every record takes at least three bits, so what is reserved is bounded by the bytes, whatever the count says.
  batch.splits.reserve(std::min<std::size_t>(record_count, in.bits_left() / 3));
  batch.faces.resize(2 * batch.splits.capacity());
  std::uint32_t face_count = 0;
  record::ReadingCoder coder(header.tables, in);
  std::size_t next_attach = 0;
  for (std::uint32_t i = 0; i < record_count; ++i) {
    SplitRecord& record = batch.splits.emplace_back();
    if (!expected.pop(record.node)) {
      if (next_attach == attach.size()) return corrupt(i, "attach node");
      record.node = attach[next_attach++];
    }
    record::Inclusion included;
    record::code_record(coder, header, static_cast<BoxPolicy>(policy), edges, record, included,
                        batch.faces, face_count);
    if (!coder.good()) return corrupt(i, coder.error());
    face_count += record.face_count;
    expected.push_children(record, included);
  }
  if (next_attach != attach.size() || coder.bits_left() >= 8)
    return Status{StatusCode::kCorrupt, "split batch: bytes left over after its last record"};
  batch.faces.resize(face_count);
  return batch;
}

void count_treelet(const SpmHeader& header, const SplitStore& store, const Treelet& treelet,
                   BoxPolicy boxes, TrainingCounts& counts) {
  counts.resize(record::kContextCount);
  record::CountingCoder coder(counts);
  record::OpenEdges edges;
  std::vector<SplitFace> faces;
  for (const TreeletSplit& split : treelet) {
    faces.clear();
    SplitRecord record = make_record(store, split, faces);
    record::Inclusion included{split.left_included, split.right_included};
    record::code_record(coder, header, boxes, edges, record, included, faces, 0);
  }
}

CodingTables make_tables(const TrainingCounts& counts) {
  std::vector<HuffmanTable> contexts;
  for (const auto& context : counts) contexts.push_back(HuffmanTable::from_counts(context));
  return CodingTables(std::move(contexts));
}

int coding_context_count() { return record::kContextCount; }

}  // namespace nearmesh
