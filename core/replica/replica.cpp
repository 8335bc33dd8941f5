// SPDX-License-Identifier: Apache-2.0
#include "replica.hpp"

#include <algorithm>
#include <new>

#include "compare_block.hpp"
#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"

namespace nearmesh {
namespace {

constexpr std::size_t kMaxAuditors = 8;  ///< whose proofs may come at once

/// The largest known nodes that are split and meet no part of `keep`; disjoint.
std::vector<NodeSpan> nodes_outside(const SplitStore& store, std::span<const RegionPart> keep) {
  std::vector<NodeSpan> stack, outside;
  for (const BaseRoot& root : store.roots()) stack.push_back(root.node);
  while (!stack.empty()) {
    const NodeSpan node = stack.back();
    stack.pop_back();
    const VertexId split = node.size < 2 ? VertexId{} : store.split_of(node);
    if (!split.is_valid()) continue;
    const GridBox box = store.box(node);
    if (std::none_of(keep.begin(), keep.end(),
                     [&](const RegionPart& part) { return part.meets(box); })) {
      outside.push_back(node);
      continue;
    }
    stack.push_back(node.left_of(split));
    stack.push_back(node.right_of(split));
  }
  return outside;
}

}  // namespace

Replica::Replica(SpmHeader header) : refined_(std::move(header)), tree_(refined_.mesh()) {}

Result<Replica> Replica::from_header(std::span<const std::uint8_t> bytes, SharedTables* shared) {
  Result<SpmHeader> header = decode_header(bytes, shared);
  NEARMESH_RETURN_IF_ERROR(header);
  try {
    return Replica(std::move(header).value());
  } catch (const std::bad_alloc&) {
    return Status{StatusCode::kIo, "no address space for its vertices"};
  }
}

Replica::Taken Replica::take(std::span<const std::uint8_t> bytes, std::uint64_t sender) {
  Taken taken;
  ++taken_batches_;
  if (distrusts(sender)) return taken;
  const Stopwatch watch;
  const auto unsealed = unseal_batch(header().content, bytes);
  if (!unsealed.is_ok()) {
    taken.status = unsealed.status();
    return taken;
  }
  taken.liar = sender;
  if (is_audit_piece(unsealed.value())) {
    audit(unsealed.value(), sender, taken);
    taken.times.load_s = watch.seconds();
  } else {
    const Result<SplitBatch> batch = decode_batch(header(), unsealed.value());
    taken.times.load_s = watch.seconds();
    taken.status =
        batch.is_ok() ? refine(batch.value(), teller_of(sender), taken.times) : batch.status();
  }
  taken.contradicts = !taken.status.is_ok();
  taken.rests_on_kept = has_kept_;
  if (taken.contradicts) {
    if (has_kept_) taken.liar = 0;
    if (taken.liar != 0) distrusted_.insert(taken.liar);
    forget_all();
  }
  return taken;
}

Replica::Taken Replica::take_kept(std::span<const std::uint8_t> bytes) {
  has_kept_ = true;
  taken_batches_ = std::max(taken_batches_, kKeptBatches);
  return take(bytes);
}

/// In weeks there are more publishers than numbers. One who told of nothing that is here needs
/// none: else who lies later would never be named.
Teller Replica::teller_of(std::uint64_t sender) {
  const auto at = std::find(tellers_.begin(), tellers_.end(), sender);
  if (at != tellers_.end()) return static_cast<Teller>(at - tellers_.begin());
  if (tellers_.size() < kManyTellers) {
    tellers_.push_back(sender);
    return static_cast<Teller>(tellers_.size() - 1);
  }
  if (has_no_spare_teller_) return kManyTellers;
  const auto needed = refined_.tellers();
  for (std::size_t number = 0; number < tellers_.size(); ++number) {
    if (needed[number]) continue;
    tellers_[number] = sender;
    return static_cast<Teller>(number);
  }
  has_no_spare_teller_ = true;
  return kManyTellers;
}

/// Pieces make a whole with those of the same sender alone: else whoever writes one between two
/// would make a liar of who proves.
void Replica::audit(std::span<const std::uint8_t> piece, std::uint64_t sender, Taken& taken) {
  if (audits_.size() == kMaxAuditors && !audits_.contains(sender)) audits_.erase(audits_.begin());
  Result<std::optional<AuditedBlock>> whole = audits_[sender].take(piece);
  if (whole.is_ok() && !whole.value()) return;
  audits_.erase(sender);
  taken.status = whole.status();
  if (!whole.is_ok()) return;
  const AuditedBlock& block = *whole.value();
  const std::string name = "audit of the block of " + to_string(block.root) + ": ";
  Result<SplitBatch> proved = is_proved(block, header())
                                  ? decode_batch(header(), block.bytes)
                                  : Status{StatusCode::kCorrupt, "it is not of this content"};
  if (!proved.is_ok()) {
    taken.status = {StatusCode::kCorrupt, name + proved.status().message()};
    return;
  }
  for (const SplitRecord& record : proved.value().splits) taken.audited.push_back(record.node);
  const std::optional<Difference> found = difference(store(), block.root, proved.value());
  if (!found) return;
  const Teller teller = refined_.teller_of(found->split);
  taken.liar = teller < tellers_.size() ? tellers_[teller] : 0;
  taken.status = {StatusCode::kCorrupt,
                  name + "split " + std::to_string(found->split.value) + " was told with hash " +
                      to_hex(found->told) + ", " +
                      (found->proved ? "the content has " + to_hex(*found->proved)
                                     : "which cuts that node of the content")};
}

// More than give_up() takes: half-spaces of nodes that are not split, and splits that wait for
// their parents and would come in with these.
void Replica::distrust(std::uint64_t sender) {
  distrusted_.insert(sender);
  forget_all();
  ++give_ups_;
}

Replica::Taken Replica::take(const SplitBatch& batch, std::uint64_t sender) {
  Taken taken;
  ++taken_batches_;
  taken.status = refine(batch, teller_of(sender), taken.times);
  taken.contradicts = !taken.status.is_ok();
  if (taken.contradicts) forget_all();
  return taken;
}

Status Replica::refine(const SplitBatch& batch, Teller teller, Times& times) {
  Stopwatch watch;
  RefinedMesh::Applied applied = refined_.apply_batch(batch, teller);
  times.refine_s += watch.lap();
  if (applied.status.is_ok()) {
    tree_.update(applied.delta);
    if (const NodeSpan slot = tree_.contradiction(); slot.size != 0)
      applied.status = {StatusCode::kCorrupt,
                        to_string(slot) + ": a face lies outside the box that came for it"};
  }
  times.tree_s += watch.lap();
  return std::move(applied.status);
}

void Replica::forget_all() {
  refined_ = RefinedMesh(header());
  tree_ = AbTree(refined_.mesh());
  has_kept_ = false;
  has_no_spare_teller_ = false;
}

Replica::Times Replica::give_up(std::span<const RegionPart> keep) {
  Times times;
  const std::vector<NodeSpan> outside = nodes_outside(store(), keep);
  give_ups_ += outside.empty() ? 0 : 1;
  has_no_spare_teller_ = has_no_spare_teller_ && outside.empty();
  for (const NodeSpan& node : outside) {
    Stopwatch watch;
    const RefineDelta delta = refined_.collapse(node);
    times.refine_s += watch.lap();
    tree_.update(delta);
    times.tree_s += watch.lap();
    refined_.forget(node);  // last: the tree asks the store for the faces that it drops
    times.refine_s += watch.lap();
  }
  return times;
}

}  // namespace nearmesh
