// SPDX-License-Identifier: Apache-2.0
#include "collect.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <queue>
#include <string>

namespace nearmesh {
namespace {

/// A block that is decoded takes as long as so many nodes that are looked at.
constexpr std::size_t kBlockWork = 31;

constexpr std::uint32_t kNoParent = 0xffffffffU;

// A node and the parts of the region that may matter below it, as a range of one shared pool:
// children look at no others.
struct Candidate {
  NodeSpan node;
  GridBox box;
  std::uint32_t pool_begin = 0, pool_end = 0;
  bool meets = true;                 // one of them asks for the node itself
  std::uint32_t parent = kNoParent;  // its place in the treelet, where there is one
};

// The step that publisher and peer share: does a node matter to the region?
class RegionFilter {
 public:
  RegionFilter(const SplitStore& store, std::span<const RegionPart> region)
      : store_(store), region_(region), pool_(region.size()) {
    std::iota(pool_.begin(), pool_.end(), 0U);
  }
  [[nodiscard]] Candidate everything(NodeSpan node) const {
    return {node, node.size > 0 ? store_.box(node) : GridBox{}, 0,
            static_cast<std::uint32_t>(region_.size())};
  }
  // The node as a candidate, if any part may matter to it or below it; to leaves none does, they
  // are resolved.
  [[nodiscard]] std::optional<Candidate> child(NodeSpan node, const Candidate& parent) {
    if (node.size < 2) return std::nullopt;
    // A node without a box of its own has its parent's.
    const bool inherits = parent.node.size > 0 && !store_.has_box(node);
    const GridBox box = inherits ? parent.box : store_.box(node), reach = reach_below(box);
    Candidate candidate{node, box, static_cast<std::uint32_t>(pool_.size()), 0, false};
    for (std::uint32_t i = parent.pool_begin; i < parent.pool_end; ++i) {
      const std::uint32_t part = pool_[i];
      if (!region_[part].meets(reach)) continue;
      pool_.push_back(part);
      candidate.meets = candidate.meets || region_[part].asks_for(box);
    }
    candidate.pool_end = static_cast<std::uint32_t>(pool_.size());
    if (candidate.pool_begin == candidate.pool_end) return std::nullopt;
    if (candidate.pool_end - candidate.pool_begin == parent.pool_end - parent.pool_begin) {
      pool_.resize(candidate.pool_begin);  // the same as the parent's, which are kept
      candidate.pool_begin = parent.pool_begin;
      candidate.pool_end = parent.pool_end;
    }
    return candidate;
  }

 private:
  const SplitStore& store_;
  std::span<const RegionPart> region_;
  std::vector<std::uint32_t> pool_;
};

// Larger nodes first; ties go to the lower id.
bool is_smaller(const NodeSpan& a, const NodeSpan& b) {
  return a.size != b.size ? a.size < b.size : a.first > b.first;
}

// Makes an attach node known to the store, from its root down.
Status locate(const SplitStore& store, NodeSpan target,
              const std::function<Status(NodeSpan)>& require) {
  if (store.is_node(target)) return Status::ok();
  NodeSpan node = store.roots()[store.root_index(target.first)].node;
  while (node.size > target.size) {
    NEARMESH_RETURN_IF_ERROR(require(node));
    const VertexId split = store.split_of(node);
    if (!split.is_valid()) break;
    node = target.first < split ? node.left_of(split) : node.right_of(split);
  }
  if (node != target)
    return {StatusCode::kInvalidArgument, to_string(target) + " is not a node of the model"};
  return Status::ok();
}

}  // namespace

GridBox reach_below(const GridBox& box) {
  GridBox reach;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t lo = box.lo[k], hi = box.hi[k], more = (hi - lo) / 4 + 1;
    reach.lo[k] = static_cast<std::int32_t>(
        std::max<std::int64_t>(lo - more, std::numeric_limits<std::int32_t>::min()));
    reach.hi[k] = static_cast<std::int32_t>(
        std::min<std::int64_t>(hi + more, std::numeric_limits<std::int32_t>::max()));
  }
  return reach;
}

Status check_request(const SplitStore& store, const RegionRequest& request) {
  NEARMESH_RETURN_IF_ERROR(check_request(request));
  for (const NodeSpan& node : request.attach)
    if (std::uint64_t{node.begin()} + node.size > store.vertex_count())
      return {StatusCode::kInvalidArgument, "region request: " + to_string(node) +
                                                " is outside the model's " +
                                                std::to_string(store.vertex_count()) + " vertices"};
  return Status::ok();
}

struct Collector::Impl {
  const SplitStore& store;
  const RegionRequest request;
  const std::function<Status(NodeSpan)> require;
  const AttachRule rule;
  RegionFilter filter{store, request.region};
  static bool is_smaller_candidate(const Candidate& a, const Candidate& b) {
    return is_smaller(a.node, b.node);
  }
  std::priority_queue<Candidate, std::vector<Candidate>, decltype(&is_smaller_candidate)> queue{
      &is_smaller_candidate};
  std::size_t attached = 0;  // so many of the attach nodes
  Demand demand;

  void offer(NodeSpan node, const Candidate& parent, std::uint32_t place) {
    auto candidate = filter.child(node, parent);
    if (!candidate || !candidate->meets) return;
    candidate->parent = place;
    queue.push(*candidate);
  }
  Status attach(NodeSpan node) {
    if (require) NEARMESH_RETURN_IF_ERROR(locate(store, node, require));
    if (!store.is_node(node)) return Status::ok();
    if (rule == AttachRule::kAlways && node.size > 1) {
      queue.push(filter.everything(node));
    } else {
      offer(node, filter.everything({}), kNoParent);
    }
    return Status::ok();
  }
  Status visit(const Candidate& top) {
    if (require) NEARMESH_RETURN_IF_ERROR(require(top.node));
    const VertexId split = store.split_of(top.node);
    if (!split.is_valid()) {
      demand.missing.push_back(top.node);
      return Status::ok();
    }
    if (top.parent != kNoParent) {
      TreeletSplit& parent = demand.treelet[top.parent];
      (top.node.first == parent.node.first ? parent.left_included : parent.right_included) = true;
    }
    const auto place = static_cast<std::uint32_t>(demand.treelet.size());
    demand.treelet.push_back({top.node, split});
    offer(top.node.left_of(split), top, place);
    offer(top.node.right_of(split), top, place);
    return Status::ok();
  }
  [[nodiscard]] bool is_full() const { return demand.treelet.size() >= request.max_splits; }
  [[nodiscard]] bool is_done() const {
    return attached == request.attach.size() && (queue.empty() || is_full());
  }
};

Collector::Collector(const SplitStore& store, RegionRequest request,
                     std::function<Status(NodeSpan)> require, AttachRule rule)
    : impl_(new Impl{store, std::move(request), std::move(require), rule}) {}
Collector::~Collector() = default;
Collector::Collector(Collector&&) noexcept = default;

Result<bool> Collector::advance(std::size_t work) {
  Impl& impl = *impl_;
  for (std::size_t done = 0; done < work && !impl.is_done(); ++done) {
    const std::uint32_t known = impl.store.known_splits();
    if (impl.attached < impl.request.attach.size()) {
      NEARMESH_RETURN_IF_ERROR(impl.attach(impl.request.attach[impl.attached++]));
    } else {
      const Candidate top = impl.queue.top();
      impl.queue.pop();
      NEARMESH_RETURN_IF_ERROR(impl.visit(top));
    }
    if (impl.store.known_splits() != known) done += kBlockWork;
  }
  return impl.is_done();
}

Demand Collector::take() {
  Impl& impl = *impl_;
  impl.demand.truncated = impl.is_full() && !impl.queue.empty();
  std::sort(impl.demand.missing.begin(), impl.demand.missing.end());
  return std::move(impl.demand);
}

Result<Demand> collect(const SplitStore& store, const RegionRequest& request,
                       const std::function<Status(NodeSpan)>& require, AttachRule rule) {
  Collector collector(store, request, require, rule);
  const Result<bool> done = collector.advance(std::numeric_limits<std::size_t>::max());
  NEARMESH_RETURN_IF_ERROR(done);
  Demand demand = collector.take();
  std::sort(demand.treelet.begin(), demand.treelet.end(),
            [](const TreeletSplit& a, const TreeletSplit& b) { return a.node < b.node; });
  return demand;
}

std::vector<NodeSpan> unresolved_in(const SplitStore& store, std::span<const RegionPart> region,
                                    std::size_t limit) {
  RegionFilter filter(store, region);
  std::vector<NodeSpan> unresolved;
  std::vector<Candidate> stack;
  const auto offer = [&](NodeSpan node, const Candidate& parent) {
    if (const auto candidate = filter.child(node, parent)) stack.push_back(*candidate);
  };
  for (const BaseRoot& root : store.roots()) offer(root.node, filter.everything({}));
  while (!stack.empty()) {
    const Candidate top = stack.back();
    stack.pop_back();
    const VertexId split = store.split_of(top.node);
    if (!split.is_valid()) {
      if (top.meets) unresolved.push_back(top.node);
      continue;
    }
    offer(top.node.left_of(split), top);
    offer(top.node.right_of(split), top);
  }
  std::sort(unresolved.begin(), unresolved.end(),
            [](const NodeSpan& a, const NodeSpan& b) { return is_smaller(b, a); });
  unresolved.resize(std::min(unresolved.size(), limit));
  return unresolved;
}

}  // namespace nearmesh
