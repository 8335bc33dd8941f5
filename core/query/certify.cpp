// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/certify.hpp"

#include <string>

#include "core/base/float_guard.hpp"
#include "core/base/stopwatch.hpp"
#include "find_missing.hpp"

namespace nearmesh {
namespace {

Status split_nodes(LocalModel& model, const std::vector<NodeSpan>& nodes, const Require& require,
                   RefineDelta& delta) {
  for (const NodeSpan& node : nodes) {
    NEARMESH_RETURN_IF_ERROR(require(node));
    const VertexId split = model.mesh.store().split_of(node);
    if (!split.is_valid() || !model.mesh.split(split, delta))
      return {StatusCode::kNotFound, "the split of node [" + std::to_string(node.begin()) + ", " +
                                         std::to_string(node.end()) + ") is not to be had"};
  }
  return Status::ok();
}

}  // namespace

Status split_missing(LocalModel& model, const std::vector<NodeSpan>& nodes,
                     const Require& require) {
  RefineDelta delta;
  NEARMESH_RETURN_IF_ERROR(split_nodes(model, nodes, require, delta));
  model.tree.update(delta);
  if (const NodeSpan slot = model.tree.contradiction(); slot.size != 0)
    return {StatusCode::kCorrupt, to_string(slot) + ": a face lies outside its box"};
  return Status::ok();
}

Result<Answer> certify(LocalModel& a, const PosedFrame& frame_a, const Require& require_a,
                       LocalModel& b, const PosedFrame& frame_b, const Require& require_b,
                       const QueryOptions& options, CertifyTimes* times) {
  const FloatGuard guard;
  CertifyTimes spent;
  Stopwatch watch;
  // Else the round only looks for what is missing: its pairs would be listed in vain.
  bool is_asked = true;
  while (true) {
    Answer answer = is_asked
                        ? query(a.view(), frame_a, b.view(), frame_b, options)
                        : find_missing(a.view(), frame_a, b.view(), frame_b, options.max_tests);
    spent.query_s += watch.lap();
    const bool is_to_be_asked =
        answer.exhausted || (answer.missing_a.empty() && answer.missing_b.empty());
    if (!is_asked && is_to_be_asked) {
      is_asked = true;
      continue;
    }
    ++spent.rounds;
    if (is_certified(answer.status) || is_beyond_detail(answer) || answer.exhausted) {
      if (times != nullptr) *times = spent;
      return answer;
    }
    is_asked = options.any;  // it may end before all is there
    RefineDelta delta_a, delta_b;
    NEARMESH_RETURN_IF_ERROR(split_nodes(a, answer.missing_a, require_a, delta_a));
    NEARMESH_RETURN_IF_ERROR(split_nodes(b, answer.missing_b, require_b, delta_b));
    spent.refine_s += watch.lap();
    a.tree.update(delta_a);
    b.tree.update(delta_b);
    for (const LocalModel* model : {&a, &b})
      if (const NodeSpan slot = model->tree.contradiction(); slot.size != 0)
        return Status{StatusCode::kCorrupt, to_string(slot) + ": a face lies outside its box"};
    spent.tree_s += watch.lap();
  }
}

}  // namespace nearmesh
