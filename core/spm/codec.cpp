// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/codec.hpp"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "make_record.hpp"
#include "nearmesh/core/spm/detail/half_space.hpp"
#include "record_codec.hpp"

namespace nearmesh {
namespace {

// Follows which nodes the decoder expects next, so that only true attach nodes are named.
class ExpectedNodes {
 public:
  /// For so many records.
  explicit ExpectedNodes(std::size_t records) : nodes_(records + 1) {}
  /// Takes `node`; true when it hangs on an earlier record of the same batch.
  bool take(const NodeSpan& node) {
    if (count_ == 0) return false;
    NEARMESH_ASSERT(nodes_[count_ - 1] == node);
    --count_;
    return true;
  }
  // Which children are included is as good as random, so nothing branches: what is not is written
  // over.
  void push_children(const SplitRecord& record, const record::Inclusion& included) {
    nodes_[count_] = record.right();
    count_ += included.right ? 1 : 0;
    nodes_[count_] = record.left();
    count_ += included.left ? 1 : 0;
  }
  [[nodiscard]] bool pop(NodeSpan& node) {
    if (count_ == 0) return false;
    node = nodes_[--count_];
    return true;
  }
  void clear() { count_ = 0; }

 private:
  std::vector<NodeSpan> nodes_;  // a record takes one at most and adds two at most
  std::size_t count_ = 0;
};

// The half-spaces to be sent, by their nodes.
class NodesToTell {
 public:
  explicit NodesToTell(std::span<const NodeHalfSpace> half_spaces) {
    for (std::size_t i = 0; i < half_spaces.size();) {
      const std::size_t begin = i;
      while (i < half_spaces.size() && half_spaces[i].node == half_spaces[begin].node) ++i;
      NEARMESH_ASSERT(i - begin <= kMaxHalfSpaces && half_spaces[begin].node.size > 1);
      groups_.push_back(half_spaces.subspan(begin, i - begin));
    }
    told_.resize(groups_.size());
  }
  [[nodiscard]] bool is_empty() const { return groups_.empty(); }
  using Group = std::span<const NodeHalfSpace>;
  /// Those of a node that a record makes; perhaps none.
  [[nodiscard]] Group take(NodeSpan node) {
    const std::size_t at = find(node);
    if (at == groups_.size()) return {};
    told_[at] = true;
    return groups_[at];
  }
  void give_back(NodeSpan node) {
    const std::size_t at = find(node);
    if (at < groups_.size()) told_[at] = false;
  }
  /// Those that nobody took.
  [[nodiscard]] std::vector<Group> left() const {
    std::vector<Group> left;
    for (std::size_t i = 0; i < groups_.size(); ++i)
      if (!told_[i]) left.push_back(groups_[i]);
    return left;
  }

 private:
  // As many as there are where it has none.
  [[nodiscard]] std::size_t find(NodeSpan node) const {
    const auto at = std::lower_bound(
        groups_.begin(), groups_.end(), node,
        [](const Group& group, const NodeSpan& wanted) { return group.front().node < wanted; });
    if (at == groups_.end() || at->front().node != node) return groups_.size();
    return static_cast<std::size_t>(at - groups_.begin());
  }

  std::vector<Group> groups_;
  std::vector<bool> told_;
};

// Nodes that a batch names, ascending and disjoint. Most are whole roots, which the header knows:
// all of a first answer's are.
class NodeNames {
 public:
  explicit NodeNames(std::span<const BaseRoot> roots) : roots_(roots) {}

  void put(const NodeSpan& node, BitWriter& out) {
    NEARMESH_ASSERT(node.begin() >= end_ && node.size > 1);
    const std::size_t next = next_root(), at = root_from(node.begin());
    const bool is_root = at < roots_.size() && roots_[at].node == node;
    out.put(is_root ? 1 : 0, 1);
    if (is_root) {
      out.put_gamma(at - next);
    } else {
      out.put_count(node.begin() - end_);
      out.put_gamma(node.size - 2);
    }
    end_ = node.end();
  }
  /// None where it would end beyond the model, or be a single vertex.
  std::optional<NodeSpan> get(BitReader& in) {
    NodeSpan node;
    if (in.get(1) != 0) {
      const std::uint64_t at = next_root() + in.get_gamma();
      if (at >= roots_.size()) return std::nullopt;
      node = roots_[at].node;
    } else {
      const std::uint64_t first = std::uint64_t{end_} + in.get_count(), size = in.get_gamma() + 2;
      if (first + size > roots_.back().node.end()) return std::nullopt;
      node = {{static_cast<std::uint32_t>(first)}, static_cast<std::uint32_t>(size)};
    }
    if (in.overrun() || node.size < 2) return std::nullopt;
    end_ = node.end();
    return node;
  }

 private:
  /// The first that begins there or later.
  [[nodiscard]] std::size_t root_from(std::uint32_t begin) const {
    const auto at = std::lower_bound(
        roots_.begin(), roots_.end(), begin,
        [](const BaseRoot& root, std::uint32_t wanted) { return root.node.begin() < wanted; });
    return static_cast<std::size_t>(at - roots_.begin());
  }
  [[nodiscard]] std::size_t next_root() const { return root_from(end_); }

  std::span<const BaseRoot> roots_;
  std::uint32_t end_ = 0;  // of the last one
};

// After each half-space a bit says whether another one follows; the last that there can be has
// none.
void put_half_spaces(NodesToTell::Group group, BitWriter& out) {
  for (std::size_t i = 0; i < group.size(); ++i) {
    const HalfSpace& half_space = group[i].half_space;
    NEARMESH_ASSERT(i == 0 || group[i - 1].half_space.direction < half_space.direction);
    out.put(half_space.direction, kDirectionBits);
    out.put(half_space.reach, kReachBits);
    if (i + 1 < kMaxHalfSpaces) out.put(i + 1 < group.size(), 1);
  }
}

// One batch under construction.
struct OpenBatch {
  explicit OpenBatch(std::span<const BaseRoot> roots) : attached(roots), held_nodes(roots) {}

  BitWriter attach, body;
  BitWriter made, held;  // half-spaces: of nodes that the records make, of others
  NodeNames attached, held_nodes;
  std::uint32_t held_count = 0;
  bool any_made = false;
  std::uint32_t attach_count = 0, record_count = 0;
  record::OpenEdges edges;

  void add_attach(const NodeSpan& node) {
    attached.put(node, attach);
    ++attach_count;
  }
  /// A bit for each node that a record makes and the treelet does not divide, whether there are
  /// any.
  void add_made(const SplitRecord& record, const record::Inclusion& included, NodesToTell& nodes) {
    for (const bool left : {true, false}) {
      const NodeSpan node = left ? record.left() : record.right();
      if (node.size < 2 || (left ? included.left : included.right)) continue;
      const NodesToTell::Group group = nodes.take(node);
      made.put(!group.empty(), 1);
      any_made |= !group.empty();
      put_half_spaces(group, made);
    }
  }
  void add_held(NodesToTell::Group group) {
    held_nodes.put(group.front().node, held);
    put_half_spaces(group, held);
    ++held_count;
  }
  [[nodiscard]] bool has_half_spaces() const { return any_made || held_count > 0; }
  [[nodiscard]] bool is_empty() const { return record_count == 0 && held_count == 0; }
  // Upper bound of finish()'s size: flags and counts of at most 63 bits.
  [[nodiscard]] std::size_t byte_bound() const {
    const std::size_t counts = 2 * (bit_length(record_count + 1) + bit_length(attach_count + 1));
    const std::size_t half_spaces =
        has_half_spaces() ? 2 * bit_length(held_count + 1) + made.bit_count() + held.bit_count()
                          : 0;
    return (8 + counts + attach.bit_count() + body.bit_count() + half_spaces + 7) / 8;
  }
  /// Where to cut back to.
  struct Mark {
    std::size_t attach, body, made;
    std::uint32_t attach_count;
    bool any_made;
  };
  [[nodiscard]] Mark mark() const {
    return {attach.bit_count(), body.bit_count(), made.bit_count(), attach_count, any_made};
  }
  /// Takes the last record back. `edges` stay as they are: the batch can be finished, no more.
  void take_back(const Mark& mark) {
    attach.truncate(mark.attach);
    body.truncate(mark.body);
    made.truncate(mark.made);
    attach_count = mark.attach_count;
    any_made = mark.any_made;
    --record_count;
  }
  [[nodiscard]] std::vector<std::uint8_t> finish(BoxPolicy policy) const {
    BitWriter out;
    out.put(has_half_spaces() ? kWithHalfSpaces : static_cast<std::uint64_t>(policy), 8);
    out.put_gamma(record_count);
    out.put_gamma(attach_count);
    out.append(attach);
    out.append(body);
    if (has_half_spaces()) {
      out.append(made);
      out.put_gamma(held_count);
      out.append(held);
    }
    return std::move(out).finish();
  }
};

Status corrupt(std::uint32_t record, const char* field) {
  return {StatusCode::kCorrupt,
          "split batch: record " + std::to_string(record) + ": " + field + " out of range"};
}

// What stands before the records.
struct BatchHead {
  BoxPolicy boxes;
  bool has_half_spaces;
  std::uint32_t record_count;
  std::vector<NodeSpan> attach;
};

Result<BatchHead> read_head(const SpmHeader& header, BitReader& in) {
  const std::uint32_t flags = in.get(8);
  const bool has_half_spaces = flags == kWithHalfSpaces;
  const BoxPolicy policy = has_half_spaces ? BoxPolicy::kCutNodes : static_cast<BoxPolicy>(flags);
  if (!has_half_spaces && flags > static_cast<std::uint32_t>(BoxPolicy::kAllNodes))
    return Status{StatusCode::kCorrupt,
                  "split batch: flags: expected 0, 1 or 3, found " + std::to_string(flags)};
  const std::uint64_t record_count = in.get_gamma();
  const std::uint64_t attach_count = in.get_gamma();
  // Every attach node takes at least two bits and every record three, whatever the tables say: so
  // what is allocated is bounded by the bytes.
  if (in.overrun() || attach_count * 2 + record_count * 3 > in.bits_left() ||
      attach_count > record_count)
    return Status{StatusCode::kCorrupt,
                  "split batch: counts exceed its " + std::to_string(in.bytes().size()) + " bytes"};
  BatchHead head{policy, has_half_spaces, static_cast<std::uint32_t>(record_count), {}};
  head.attach.resize(attach_count);
  NodeNames names(header.roots);
  for (NodeSpan& node : head.attach) {
    const std::optional<NodeSpan> next = names.get(in);
    if (!next)
      return Status{StatusCode::kCorrupt, "split batch: attach node outside the model's " +
                                              std::to_string(header.vertex_count) + " vertices"};
    node = *next;
  }
  return head;
}

// Out: how many bits are left after them.
[[gnu::flatten]] Result<std::size_t> read_records(const SpmHeader& header, const BatchHead& head,
                                                  record::ReadingCoder coder, SplitBatch& batch) {
  ExpectedNodes expected(head.record_count);
  record::OpenEdges edges;
  std::uint32_t face_count = 0;
  std::size_t next_attach = 0;
  for (std::uint32_t i = 0; i < head.record_count; ++i) {
    SplitRecord& record = batch.splits[i];
    if (!expected.pop(record.node)) {
      if (next_attach == head.attach.size()) return corrupt(i, "attach node");
      record.node = head.attach[next_attach++];
    }
    record.face_begin = face_count;
    record::Inclusion included;
    record::code_record(coder, header, head.boxes, edges, record, included, batch.faces);
    if (!coder.good()) return corrupt(i, coder.error());
    face_count += record.face_count;
    expected.push_children(record, included);
  }
  if (next_attach != head.attach.size() || (!head.has_half_spaces && coder.bits_left() >= 8))
    return Status{StatusCode::kCorrupt, "split batch: bytes left over after its last record"};
  batch.faces.resize(face_count);
  return coder.bits_left();
}

Status corrupt_half_space(NodeSpan node, const char* what) {
  return {StatusCode::kCorrupt, "split batch: half-spaces of " + to_string(node) + ": " + what};
}

// Those of one node, at least one.
Status read_half_spaces(NodeSpan node, BitReader& in, std::vector<NodeHalfSpace>& out) {
  for (std::size_t i = 0; i < kMaxHalfSpaces; ++i) {
    NodeHalfSpace next{node, {}};
    next.half_space.direction = static_cast<std::uint16_t>(in.get(kDirectionBits));
    next.half_space.reach = static_cast<std::uint8_t>(in.get(kReachBits));
    if (in.overrun()) return corrupt_half_space(node, "bytes end inside");
    if (i > 0 && out.back().half_space.direction >= next.half_space.direction)
      return corrupt_half_space(node, "directions do not ascend");
    out.push_back(next);
    if (i + 1 == kMaxHalfSpaces || in.get(1) == 0) break;
  }
  return Status::ok();
}

// What follows the records: a bit for each node that they make and that has a box, whether there
// are any of it; then other nodes, ascending and disjoint.
Status read_all_half_spaces(const SpmHeader& header, BitReader in, SplitBatch& batch) {
  for (const SplitRecord& record : batch.splits) {
    if (record.left_box != kNoBox && in.get(1) != 0)
      NEARMESH_RETURN_IF_ERROR(read_half_spaces(record.left(), in, batch.half_spaces));
    if (record.right_box != kNoBox && in.get(1) != 0)
      NEARMESH_RETURN_IF_ERROR(read_half_spaces(record.right(), in, batch.half_spaces));
  }
  const std::uint64_t held_count = in.get_gamma();
  NodeNames names(header.roots);
  for (std::uint64_t i = 0; i < held_count && !in.overrun(); ++i) {
    const std::optional<NodeSpan> node = names.get(in);
    if (!node)
      return {StatusCode::kCorrupt, "split batch: half-spaces of a node outside the model's " +
                                        std::to_string(header.vertex_count) + " vertices"};
    NEARMESH_RETURN_IF_ERROR(read_half_spaces(*node, in, batch.half_spaces));
  }
  if (in.overrun()) return {StatusCode::kCorrupt, "split batch: bytes end inside its half-spaces"};
  if (in.bits_left() >= 8)
    return {StatusCode::kCorrupt, "split batch: bytes left over after its half-spaces"};
  // A writer has no use for these flags then.
  if (batch.half_spaces.empty())
    return {StatusCode::kCorrupt, "split batch: flags say half-spaces, and there are none"};
  return Status::ok();
}

}  // namespace

std::vector<std::vector<std::uint8_t>> encode_batches(const SpmHeader& header,
                                                      const SplitStore& store,
                                                      const Treelet& treelet, BoxPolicy boxes,
                                                      std::size_t max_bytes,
                                                      std::span<const NodeHalfSpace> half_spaces,
                                                      std::size_t first_max_bytes) {
  std::size_t most = std::min(first_max_bytes, max_bytes);  // of the batch that is open
  NEARMESH_ASSERT(half_spaces.empty() || boxes == BoxPolicy::kCutNodes);
  std::vector<std::vector<std::uint8_t>> batches;
  OpenBatch open(header.roots);
  NodesToTell nodes(half_spaces);
  ExpectedNodes expected(treelet.size());
  std::vector<SplitFace> faces;
  for (const TreeletSplit& split : treelet) {
    for (bool fits = false; !fits;) {
      faces.clear();
      SplitRecord record = make_record(store, split, faces);
      record::Inclusion included{split.left_included, split.right_included};
      const OpenBatch::Mark mark = open.mark();
      if (!expected.take(split.node)) open.add_attach(split.node);
      record::WritingCoder coder(header.tables, open.body);
      record::code_record(coder, header, boxes, open.edges, record, included, faces);
      ++open.record_count;
      if (!nodes.is_empty()) {
        open.add_made(record, included, nodes);
        // A record with very many faces may leave no room for them: they are told beside it.
        if (open.record_count == 1 && open.any_made && open.byte_bound() > max_bytes) {
          nodes.give_back(record.left());
          nodes.give_back(record.right());
          NodesToTell none({});
          open.made.truncate(mark.made);
          open.any_made = mark.any_made;
          open.add_made(record, included, none);
        }
      }
      if (open.record_count == 1 && open.byte_bound() > most) most = max_bytes;
      fits = open.byte_bound() <= most || open.record_count == 1;
      if (fits) {
        expected.push_children(record, included);
        continue;
      }
      // Close the batch without the record, and start the next one with it.
      open.take_back(mark);
      batches.push_back(open.finish(boxes));
      most = max_bytes;
      open = OpenBatch(header.roots);
      expected.clear();
    }
  }
  for (const NodesToTell::Group& group : nodes.left()) {
    OpenBatch with = open;
    with.add_held(group);
    if (!open.is_empty() && with.byte_bound() > most) {
      batches.push_back(open.finish(boxes));
      most = max_bytes;
      with = OpenBatch(header.roots);
      with.add_held(group);
    }
    open = std::move(with);
  }
  if (!open.is_empty()) batches.push_back(open.finish(boxes));
  return batches;
}

std::vector<SplitBits> bits_of(const SpmHeader& header, const SplitStore& store,
                               const Treelet& treelet) {
  std::vector<SplitBits> bits(treelet.size());
  BitWriter out;
  record::WritingCoder coder(header.tables, out);
  const auto box_bits = [&](std::uint32_t size, BoxCode box) -> std::uint32_t {
    if (size < 2) return 0;
    out.clear();
    record::code_box(coder, size, box);
    return static_cast<std::uint32_t>(out.bit_count());
  };
  record::OpenEdges edges;
  std::vector<SplitFace> faces;
  for (std::size_t i = 0; i < treelet.size(); ++i) {
    const TreeletSplit& split = treelet[i];
    faces.clear();
    SplitRecord record = make_record(store, split, faces);
    bits[i].left_box = box_bits(record.left().size, record.left_box);
    bits[i].right_box = box_bits(record.right().size, record.right_box);
    record::Inclusion included{split.left_included, split.right_included};
    out.clear();
    record::code_record(coder, header, BoxPolicy::kCutNodes, edges, record, included, faces);
    bits[i].record = static_cast<std::uint32_t>(out.bit_count()) -
                     (included.left ? 0 : bits[i].left_box) -
                     (included.right ? 0 : bits[i].right_box);
  }
  return bits;
}

Result<SplitBatch> decode_batch(const SpmHeader& header, std::span<const std::uint8_t> bytes) {
  BitReader in(bytes);
  Result<BatchHead> head = read_head(header, in);
  NEARMESH_RETURN_IF_ERROR(head);
  const PaddedBytes padded(bytes);
  const WindowReader window(padded, in.used());
  SplitBatch batch;
  batch.splits.resize(head.value().record_count);
  batch.faces.resize(2 * batch.splits.size());
  const Result<std::size_t> left = read_records(
      header, head.value(), record::ReadingCoder(header.tables, window, bytes.size() * 8), batch);
  NEARMESH_RETURN_IF_ERROR(left);
  if (head.value().has_half_spaces) {
    in.skip(static_cast<int>(in.bits_left() - left.value()));
    NEARMESH_RETURN_IF_ERROR(read_all_half_spaces(header, in, batch));
  }
  return batch;
}

}  // namespace nearmesh
