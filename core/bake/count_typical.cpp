// SPDX-License-Identifier: Apache-2.0
#include "count_typical.hpp"

#include <algorithm>

#include "core/base/random.hpp"
#include "core/demand/collect.hpp"
#include "core/spm/blocks.hpp"

namespace nearmesh {

// Typical requests: cubes of many sizes around random vertices. Every eighth stored block of a
// large model is enough to learn what blocks look like, and keeps requests from being drowned.
TrainingCounts count_typical(const SpmHeader& header, const SplitStore& store) {
  TrainingCounts counts(static_cast<std::size_t>(coding_context_count()));
  std::size_t splits = 0;
  std::size_t number = 0;
  for (const NodeSpan& root : block_roots(store))
    if (number++ % 8 == 0 || splits < 4096) {
      const Treelet treelet = block_treelet(store, root);
      count_treelet(header, store, treelet, BoxPolicy::kAllNodes, counts);
      splits += treelet.size();
    }
  Random random(1);
  const std::int64_t extent = store.grid_max();
  for (int i = 0; i < 256; ++i) {
    RegionRequest request{.max_splits = 2048};
    for (const BaseRoot& root : header.roots)
      if (root.node.size > 1) request.attach.push_back(root.node);
    const GridPoint& at = store.position({random.below(header.vertex_count)});
    const std::int64_t radius = std::max<std::int64_t>(1, extent >> (4 + random.below(8)));
    GridBox box;
    for (int k = 0; k < 3; ++k) {
      box.lo[k] = static_cast<std::int32_t>(std::max<std::int64_t>(0, at[k] - radius));
      box.hi[k] = static_cast<std::int32_t>(std::min<std::int64_t>(extent, at[k] + radius));
    }
    request.region.push_back(box);
    if (request.attach.empty()) break;
    const Result<Demand> demand = collect(store, request, nullptr);
    count_treelet(header, store, demand.value().treelet, BoxPolicy::kCutNodes, counts);
  }
  return counts;
}

}  // namespace nearmesh
