// SPDX-License-Identifier: Apache-2.0
#include "held_nodes.hpp"

#include <algorithm>

#include "core/base/hash.hpp"

namespace nearmesh {
namespace {

class BitWriter {
 public:
  void put(bool bit) {
    if (count_ % 8 == 0) bytes_.push_back(0);
    bytes_.back() = static_cast<std::uint8_t>(bytes_.back() | (bit ? 1U : 0U) << count_ % 8);
    ++count_;
  }
  void put(std::uint32_t value, int bits) {
    for (int i = 0; i < bits; ++i) put((value >> i & 1U) != 0);
  }
  [[nodiscard]] std::vector<std::uint8_t> take() { return std::move(bytes_); }

 private:
  std::vector<std::uint8_t> bytes_;
  std::size_t count_ = 0;
};

/// Whether all vertices of a node are active.
bool is_whole(const ActiveMesh& mesh, NodeSpan node) {
  for (std::uint32_t first = node.begin(); first < node.end(); first += 64) {
    const std::uint32_t count = std::min(64U, node.end() - first);
    const std::uint64_t mask = count == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << count) - 1;
    if ((mesh.active_bits({first}) & mask) != mask) return false;
  }
  return true;
}

std::uint64_t word_of(const BoxCode& code) {
  std::uint64_t word = 0;
  for (std::size_t k = 0; k < code.size(); ++k) word |= std::uint64_t{code[k]} << 8 * k;
  return word;
}

SplitRecord record_of(const SplitStore& model, NodeSpan node, VertexId split, SplitBatch& batch) {
  const SplitFaces faces = model.faces(split);
  SplitRecord record{.node = node,
                     .split = split,
                     .face_begin = static_cast<std::uint32_t>(batch.faces.size()),
                     .face_count = static_cast<std::uint32_t>(faces.size())};
  const GridPoint &from = model.position(node.first), &to = model.position(split);
  for (std::size_t k = 0; k < 3; ++k)
    record.offset[k] = to[static_cast<int>(k)] - from[static_cast<int>(k)];
  batch.faces.insert(batch.faces.end(), faces.begin(), faces.end());
  return record;
}

}  // namespace

HeldNodes held_nodes(const Replica& replica) { return held_nodes(replica.mesh()); }

HeldNodes held_nodes(const ActiveMesh& mesh) {
  const SplitStore& store = mesh.store();
  HeldNodes held;
  BitWriter bits;
  const bool tells_half_spaces = !mesh.half_spaces().is_empty();
  bits.put(tells_half_spaces);
  std::vector<NodeSpan> stack;
  for (const BaseRoot& root : store.roots()) {
    stack.assign(1, root.node);
    while (!stack.empty()) {
      const NodeSpan node = stack.back();
      stack.pop_back();
      if (node.size < 2) continue;
      const VertexId split = store.split_of(node);
      const bool is_split = split.is_valid() && mesh.is_active(split);
      bits.put(is_split);
      if (!is_split) held.box_digest = mix(held.box_digest ^ word_of(store.box_code(node)));
      const bool whole = is_split && is_whole(mesh, node);
      if (is_split) bits.put(whole);
      if (whole) continue;
      bits.put(store.has_box(node));
      if (!is_split && tells_half_spaces) {
        for (const HalfSpace& half_space : mesh.half_spaces().of(node.first)) {
          bits.put(true);
          bits.put(half_space.direction, kDirectionBits);
          bits.put(half_space.reach, kReachBits);
        }
        bits.put(false);
      }
      if (!is_split) continue;
      stack.push_back(node.right_of(split));
      stack.push_back(node.left_of(split));
    }
  }
  held.bits = bits.take();
  return held;
}

HeldWalk::HeldWalk(const SplitStore& model, std::function<Status(NodeSpan)> require,
                   std::vector<std::uint8_t> bits)
    : model_(&model),
      require_(std::move(require)),
      bits_(std::move(bits)),
      tells_half_spaces_(get()) {}

/// Beyond the end: 0, and it has failed.
bool HeldWalk::get() {
  if (at_ >= 8 * bits_.size()) {
    has_failed_ = true;
    return false;
  }
  const bool bit = (bits_[at_ / 8] >> at_ % 8 & 1U) != 0;
  ++at_;
  return bit;
}

std::uint32_t HeldWalk::get(int bits) {
  std::uint32_t value = 0;
  for (int i = 0; i < bits; ++i) value |= std::uint32_t{get()} << i;
  return value;
}

Result<const HeldWalk::Node*> HeldWalk::next() {
  while (true) {
    if (stack_.empty()) {
      if (roots_ == model_->roots().size()) break;
      stack_.push_back({model_->roots()[roots_++].node, kNoMaker, false});
    }
    const Step step = stack_.back();
    stack_.pop_back();
    if (step.node.size < 2) continue;
    NEARMESH_RETURN_IF_ERROR(take(step));
    return &node_;
  }
  // All was read, but for what fills the last byte.
  if (!has_failed_ && (at_ + 7) / 8 == bits_.size()) return nullptr;
  return Status{StatusCode::kInvalidArgument, "held nodes: more bits than the model has nodes"};
}

Status HeldWalk::take(const Step& step) {
  const bool is_split = step.whole || get();
  const bool whole = step.whole || (is_split && get());
  // Inside of what is done none is told: those that are at hand may be needed when detail is given
  // up.
  node_ = {.node = step.node, .maker = step.maker, .has_box = whole || get(), .half_spaces = {}};
  while (!is_split && tells_half_spaces_ && get()) {
    // Nobody holds more, and in a few bytes each a million could be told of one node.
    if (node_.half_spaces.size() == kMaxHalfSpaces)
      return {StatusCode::kInvalidArgument, "held nodes: more than " +
                                                std::to_string(kMaxHalfSpaces) +
                                                " half-spaces of " + to_string(step.node)};
    const auto direction = static_cast<std::uint16_t>(get(kDirectionBits));
    const auto reach = static_cast<std::uint8_t>(get(kReachBits));
    node_.half_spaces.push_back({direction, reach});
  }
  if (has_failed_)
    return {StatusCode::kInvalidArgument, "held nodes: fewer bits than the model has nodes"};
  if (!is_split) return Status::ok();
  NEARMESH_RETURN_IF_ERROR(require_(step.node));
  node_.split = model_->split_of(step.node);
  if (!node_.split.is_valid())
    return {StatusCode::kInvalidArgument, "held nodes: the model lacks " + to_string(step.node)};
  const std::size_t maker = splits_++;
  stack_.push_back({step.node.right_of(node_.split), maker, whole});
  stack_.push_back({step.node.left_of(node_.split), maker, whole});
  return Status::ok();
}

Result<SplitBatch> held_batch(const SplitStore& model,
                              const std::function<Status(NodeSpan)>& require,
                              std::span<const std::uint8_t> bits) {
  HeldWalk walk(model, require, {bits.begin(), bits.end()});
  SplitBatch batch;
  while (true) {
    const Result<const HeldWalk::Node*> next = walk.next();
    NEARMESH_RETURN_IF_ERROR(next);
    if (next.value() == nullptr) return batch;
    const auto& [node, split, maker, has_box, half_spaces] = *next.value();
    if (has_box && maker != HeldWalk::kNoMaker) {  // roots have theirs from the header
      SplitRecord& record = batch.splits[maker];
      (node == record.left() ? record.left_box : record.right_box) = model.box_code(node);
    }
    for (const HalfSpace& half_space : half_spaces) batch.half_spaces.push_back({node, half_space});
    if (split.is_valid()) batch.splits.push_back(record_of(model, node, split, batch));
  }
}

}  // namespace nearmesh
