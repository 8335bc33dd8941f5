// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which splits does an answer need? The publisher's Server Collect VSplits (Liu, Georganas, Roth
// 2006, section 3.3) and what a peer finds unresolved are this one walk, so both sides agree by
// construction. Coverage is by face: a node's box encloses every original face that touches a
// vertex below it, so a large face that crosses the region without a vertex inside still brings its
// corners.

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

struct Demand {
  Treelet treelet;  ///< splits to send or apply, in preorder
  /// Nodes that meet the region and whose split the store does not know, ascending.
  std::vector<NodeSpan> missing;
  bool truncated = false;  ///< max_splits was reached; the largest nodes were taken
};

/// Checks a request from outside: check_request(request), and that its nodes lie in the model.
/// Errors: kInvalidArgument naming the limit or the node.
[[nodiscard]] Status check_request(const SplitStore& store, const RegionRequest& request);

/// What boxes below a node may reach. Quantised boxes do not nest: the faces below a child are also
/// below its parent, but an extent is rounded up by as much as a fifth. A part of a region that
/// misses this matters to no node below.
[[nodiscard]] GridBox reach_below(const GridBox& box);

/// Which attach nodes are split.
enum class AttachRule : std::uint8_t {
  kInRegion,  ///< those whose box meets the region
  /// All: a peer that named a node knows perhaps only an ancestor's box, since the batch that held
  /// its own was lost or dropped. It would find the node missing, and ask for it, for ever.
  kAlways,
};

/// Walks below request.attach, largest node first, into every node whose box meets the region.
/// `require` is called before a split is looked up, so that a file can decode the block; it may be
/// empty (peer). Attach nodes that are not nodes of the forest are skipped when `require` is empty,
/// else reported by `require`.
/// Deterministic. Cost: O(visited log visited).
[[nodiscard]] Result<Demand> collect(const SplitStore& store, const RegionRequest& request,
                                     const std::function<Status(NodeSpan)>& require,
                                     AttachRule rule = AttachRule::kInRegion);

/// The same walk a little at a time, so that who serves many is never held up by one. The store may
/// learn more between, by `require` or others; of a node it must not forget or change anything.
/// Threads: one at a time.
class Collector {
 public:
  /// The store must outlive it.
  Collector(const SplitStore& store, RegionRequest request, std::function<Status(NodeSpan)> require,
            AttachRule rule);
  ~Collector();
  Collector(Collector&&) noexcept;

  /// Looks at some `work` nodes more (a block that is decoded counts as several). Out: true when
  /// the walk is over.
  /// Errors: those of `require`; the walk is over then too.
  [[nodiscard]] Result<bool> advance(std::size_t work);
  /// What was found, the treelet not in preorder but in the order of the walk; once, when the walk
  /// is over.
  [[nodiscard]] Demand take();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The unresolved nodes that a region meets: their split is not known. Largest first (ties to the
/// lower id), at most `limit`. What a peer asks for next. Cost: O(known nodes that meet the
/// region).
[[nodiscard]] std::vector<NodeSpan> unresolved_in(const SplitStore& store,
                                                  std::span<const RegionPart> region,
                                                  std::size_t limit);

}  // namespace nearmesh
