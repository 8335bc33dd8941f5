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

class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  /// Beyond the end: 0, and it has failed.
  bool get() {
    if (at_ >= 8 * bytes_.size()) {
      failed_ = true;
      return false;
    }
    const bool bit = (bytes_[at_ / 8] >> at_ % 8 & 1U) != 0;
    ++at_;
    return bit;
  }
  std::uint32_t get(int bits) {
    std::uint32_t value = 0;
    for (int i = 0; i < bits; ++i) value |= std::uint32_t{get()} << i;
    return value;
  }
  /// All was read, but for what fills the last byte.
  [[nodiscard]] bool is_over() const { return !failed_ && (at_ + 7) / 8 == bytes_.size(); }
  [[nodiscard]] bool has_failed() const { return failed_; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  bool failed_ = false;
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

/// Makes the batch of what the bits say.
class HeldReader {
 public:
  HeldReader(const SplitStore& model, const std::function<Status(NodeSpan)>& require,
             std::span<const std::uint8_t> bits)
      : model_(model), require_(require), bits_(bits) {}

  Result<SplitBatch> read() {
    tells_half_spaces_ = bits_.get();
    for (const BaseRoot& root : model_.roots()) {
      stack_.assign(1, {root.node, kNoRecord, false});
      while (!stack_.empty()) {
        const Step step = stack_.back();
        stack_.pop_back();
        NEARMESH_RETURN_IF_ERROR(take(step));
      }
    }
    if (bits_.is_over()) return std::move(batch_);
    return Status{StatusCode::kInvalidArgument, "held nodes: more bits than the model has nodes"};
  }

 private:
  static constexpr std::size_t kNoRecord = ~std::size_t{0};
  struct Step {
    NodeSpan node;
    std::size_t maker;  ///< the record that makes it
    bool whole;         ///< all below it is done
  };

  Status take(const Step& step) {
    if (step.node.size < 2) return Status::ok();
    const bool is_split = step.whole || bits_.get();
    const bool whole = step.whole || (is_split && bits_.get());
    // Inside of what is done none is told: those that are at hand may be needed when detail is given up.
    if (whole || bits_.get()) give_box(step);
    while (!is_split && tells_half_spaces_ && bits_.get()) {
      const auto direction = static_cast<std::uint16_t>(bits_.get(kDirectionBits));
      const auto reach = static_cast<std::uint8_t>(bits_.get(kReachBits));
      batch_.half_spaces.push_back({step.node, {direction, reach}});
    }
    if (bits_.has_failed())
      return {StatusCode::kInvalidArgument, "held nodes: fewer bits than the model has nodes"};
    if (!is_split) return Status::ok();
    NEARMESH_RETURN_IF_ERROR(require_(step.node));
    const VertexId split = model_.split_of(step.node);
    if (!split.is_valid())
      return {StatusCode::kInvalidArgument, "held nodes: the model lacks " + to_string(step.node)};
    const std::size_t maker = batch_.splits.size();
    batch_.splits.push_back(record_of(step.node, split));
    stack_.push_back({step.node.right_of(split), maker, whole});
    stack_.push_back({step.node.left_of(split), maker, whole});
    return Status::ok();
  }

  SplitRecord record_of(NodeSpan node, VertexId split) {
    const SplitFaces faces = model_.faces(split);
    SplitRecord record{.node = node,
                       .split = split,
                       .face_begin = static_cast<std::uint32_t>(batch_.faces.size()),
                       .face_count = static_cast<std::uint32_t>(faces.size())};
    const GridPoint &from = model_.position(node.first), &to = model_.position(split);
    for (std::size_t k = 0; k < 3; ++k)
      record.offset[k] = to[static_cast<int>(k)] - from[static_cast<int>(k)];
    batch_.faces.insert(batch_.faces.end(), faces.begin(), faces.end());
    return record;
  }

  /// Roots have theirs from the header.
  void give_box(const Step& step) {
    if (step.maker == kNoRecord) return;
    SplitRecord& record = batch_.splits[step.maker];
    (step.node == record.left() ? record.left_box : record.right_box) = model_.box_code(step.node);
  }

  const SplitStore& model_;
  const std::function<Status(NodeSpan)>& require_;
  BitReader bits_;
  bool tells_half_spaces_ = false;
  std::vector<Step> stack_;
  SplitBatch batch_;
};

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
      const BoxCode box = store.box_code(node);
      const VertexId split = store.split_of(node);
      const bool is_split = split.is_valid() && mesh.is_active(split);
      bits.put(is_split);
      if (!is_split) held.box_digest = mix(held.box_digest ^ word_of(box));
      const bool whole = is_split && is_whole(mesh, node);
      if (is_split) bits.put(whole);
      if (whole) continue;
      bits.put(box != kNoBox);
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

Result<SplitBatch> held_batch(const SplitStore& model,
                              const std::function<Status(NodeSpan)>& require,
                              std::span<const std::uint8_t> bits) {
  return HeldReader(model, require, bits).read();
}

}  // namespace nearmesh
