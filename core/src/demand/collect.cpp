// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/demand/collect.hpp"

#include <algorithm>
#include <queue>
#include <string>

namespace nearmesh {
namespace {

std::string name(const NodeSpan& node) {
  return "node [" + std::to_string(node.begin()) + ", " + std::to_string(node.end()) + ")";
}

// The region boxes that a node still meets, as a range of one shared pool: children only look at
// what their parent met.
struct Candidate {
  NodeSpan node;
  std::uint32_t pool_begin = 0, pool_end = 0;
};

class Walk {
 public:
  Walk(const SplitStore& store, const RegionRequest& request,
       const std::function<Status(NodeSpan)>& require)
      : store_(store), request_(request), require_(require) {
    for (std::uint32_t i = 0; i < request.region.size(); ++i) pool_.push_back(i);
    region_end_ = static_cast<std::uint32_t>(pool_.size());
  }

  // Makes an attach node known to the store, from its root down.
  Status locate(NodeSpan target) {
    if (!require_ || store_.is_node(target)) return Status::ok();
    NodeSpan node = store_.roots()[store_.root_index(target.first)].node;
    while (node != target && node.size > 1 && node.size > target.size) {
      NEARMESH_RETURN_IF_ERROR(require_(node));
      const VertexId split = store_.split_of(node);
      if (!split.is_valid()) break;
      node = target.first < split ? NodeSpan{node.first, split.value - node.begin()}
                                  : NodeSpan{split, node.end() - split.value};
    }
    if (node != target)
      return {StatusCode::kInvalidArgument, name(target) + " is not a node of the model"};
    return Status::ok();
  }

  // Queues the node if its box meets what its parent met.
  void offer(NodeSpan node, std::uint32_t begin, std::uint32_t end) {
    if (node.size < 2) return;
    const GridBox box = store_.box(node);
    const auto first = static_cast<std::uint32_t>(pool_.size());
    for (std::uint32_t i = begin; i < end; ++i)
      if (box.meets(request_.region[pool_[i]])) pool_.push_back(pool_[i]);
    const auto last = static_cast<std::uint32_t>(pool_.size());
    if (first != last) queue_.push({node, first, last});
  }

  Result<Demand> run() {
    for (const NodeSpan& node : request_.attach) {
      NEARMESH_RETURN_IF_ERROR(locate(node));
      if (store_.is_node(node)) offer(node, 0, region_end_);
    }
    Demand demand;
    while (!queue_.empty()) {
      const Candidate top = queue_.top();
      if (demand.treelet.size() >= request_.max_splits) {
        demand.truncated = true;
        break;
      }
      queue_.pop();
      if (require_) NEARMESH_RETURN_IF_ERROR(require_(top.node));
      const VertexId split = store_.split_of(top.node);
      if (!split.is_valid()) {
        demand.missing.push_back(top.node);
        continue;
      }
      demand.treelet.push_back({top.node, split});
      offer({top.node.first, split.value - top.node.begin()}, top.pool_begin, top.pool_end);
      offer({split, top.node.end() - split.value}, top.pool_begin, top.pool_end);
    }
    finish(demand);
    return demand;
  }

 private:
  // Largest first; ties go to the lower id.
  struct Smaller {
    bool operator()(const Candidate& a, const Candidate& b) const {
      return a.node.size != b.node.size ? a.node.size < b.node.size : a.node.first > b.node.first;
    }
  };

  static void finish(Demand& demand) {
    std::sort(demand.missing.begin(), demand.missing.end());
    Treelet& treelet = demand.treelet;
    const auto preorder = [](const TreeletSplit& a, const TreeletSplit& b) { return a.node < b.node; };
    std::sort(treelet.begin(), treelet.end(), preorder);
    for (TreeletSplit& split : treelet) {
      const auto has = [&](NodeSpan child) {
        const auto at = std::lower_bound(treelet.begin(), treelet.end(), TreeletSplit{child, {}}, preorder);
        return at != treelet.end() && at->node == child;
      };
      split.left_included = has({split.node.first, split.split.value - split.node.begin()});
      split.right_included = has({split.split, split.node.end() - split.split.value});
    }
  }

  const SplitStore& store_;
  const RegionRequest& request_;
  const std::function<Status(NodeSpan)>& require_;
  std::vector<std::uint32_t> pool_;
  std::uint32_t region_end_ = 0;
  std::priority_queue<Candidate, std::vector<Candidate>, Smaller> queue_;
};

}  // namespace

Status check_request(const SplitStore& store, const RegionRequest& request) {
  const auto refuse = [](const std::string& why) {
    return Status{StatusCode::kInvalidArgument, "region request: " + why};
  };
  if (request.attach.empty()) return refuse("no attach node");
  if (request.attach.size() > kMaxAttachNodes)
    return refuse("at most " + std::to_string(kMaxAttachNodes) + " attach nodes, found " +
                  std::to_string(request.attach.size()));
  if (request.region.empty()) return refuse("no region box");
  if (request.region.size() > kMaxRegionBoxes)
    return refuse("at most " + std::to_string(kMaxRegionBoxes) + " region boxes, found " +
                  std::to_string(request.region.size()));
  if (request.max_splits < 1 || request.max_splits > kMaxRequestSplits)
    return refuse("max_splits must be in [1, " + std::to_string(kMaxRequestSplits) + "], found " +
                  std::to_string(request.max_splits));
  for (const GridBox& box : request.region)
    for (int k = 0; k < 3; ++k)
      if (box.lo[k] > box.hi[k]) return refuse("an empty region box");
  std::uint64_t next = 0;
  for (const NodeSpan& node : request.attach) {
    if (node.size < 2 || std::uint64_t{node.begin()} + node.size > store.vertex_count())
      return refuse(name(node) + " is outside the model's " +
                    std::to_string(store.vertex_count()) + " vertices or a leaf");
    if (node.begin() < next) return refuse("attach nodes must ascend and not overlap");
    next = node.end();
  }
  return Status::ok();
}

Result<Demand> collect(const SplitStore& store, const RegionRequest& request,
                       const std::function<Status(NodeSpan)>& require) {
  return Walk(store, request, require).run();
}

}  // namespace nearmesh
