// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/peer/readiness.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/float_guard.hpp"
#include "core/base/stopwatch.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "region_readiness.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr auto kPause = std::chrono::milliseconds(2);  ///< about what an answer takes on a LAN

/// The box's cells, rounded outward by one more: the division by a power of two is exact, the
/// subtraction is not.
GridBox cells_around(const Grid& grid, const std::array<double, 3>& lo_m,
                     const std::array<double, 3>& hi_m) {
  // Far beyond any box of a model, and still an integer.
  constexpr double kFar = 0x1p31 - 1;
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    const auto cells = [&](double at_m) {
      return std::ldexp(at_m - grid.origin_m[axis], -grid.exponent);
    };
    box.lo[k] =
        static_cast<std::int32_t>(std::clamp(std::floor(cells(lo_m[axis])) - 1, -kFar, kFar));
    box.hi[k] =
        static_cast<std::int32_t>(std::clamp(std::ceil(cells(hi_m[axis])) + 1, -kFar, kFar));
  }
  return box;
}

/// Whether a half-space of an unresolved node keeps it clear of the box: exact.
bool stays_behind(const TreeView& tree, VertexId first, const GridBox& box) {
  if (tree.half_spaces == nullptr) return false;
  for (const HalfSpace& half_space : tree.half_spaces->of(first)) {
    GridPoint nearest;
    for (int k = 0; k < 3; ++k) {
      const bool ascends =
          half_space_normal(half_space.direction)[static_cast<std::size_t>(k)] >= 0;
      nearest[k] = ascends ? box.lo[k] : box.hi[k];
    }
    if (!contains(half_space, tree.store->position(first), nearest)) return true;
  }
  return false;
}

}  // namespace

const char* to_string(ReadyStage stage) {
  switch (stage) {
    case ReadyStage::kWaiting:
      return "waiting";
    case ReadyStage::kAnswering:
      return "answering";
    case ReadyStage::kCertified:
      return "certified";
  }
  return "?";
}

RegionReadiness lacks_in_box(const TreeView& tree, const std::array<double, 3>& lo_m,
                             const std::array<double, 3>& hi_m) {
  NEARMESH_ASSERT(tree.store != nullptr);
  const GridBox box = cells_around(*tree.grid, lo_m, hi_m);
  RegionReadiness lacks;
  double bound_cells = 0;
  std::vector<TreeEntry> open{tree.root()};
  while (!open.empty()) {
    const TreeEntry entry = open.back();
    open.pop_back();
    if (entry.kind() == TreeEntry::Kind::kEmpty || !entry.box.meets(box)) continue;
    if (entry.kind() == TreeEntry::Kind::kInner) {
      tree.for_each_child(entry, [&](const TreeEntry& child) { open.push_back(child); });
    } else if (entry.kind() == TreeEntry::Kind::kUnresolved) {
      const NodeSpan node = entry.unresolved_node();
      if (stays_behind(tree, node.first, box)) continue;
      ++lacks.unresolved_nodes;
      lacks.missing_vertices += node.size - 1;
      bound_cells = std::max(bound_cells, node_bound(*tree.store, node));
    }
  }
  lacks.uncertainty_m = std::ldexp(bound_cells, tree.grid->exponent);
  lacks.resolved = lacks.unresolved_nodes == 0;
  if (!lacks.resolved)
    lacks.reason =
        std::to_string(lacks.unresolved_nodes) + " nodes are not refined there, at most " +
        std::to_string(lacks.missing_vertices) + " vertices below them, known to within " +
        std::to_string(lacks.uncertainty_m) + " m";
  return lacks;
}

Result<Waited> wait_ready(Session& session, BodyId body, double timeout_s,
                          std::vector<Session::OwnMotion> motions, std::uint64_t frame,
                          double time_s) {
  const FloatGuard guard;
  if (!(timeout_s >= 0))  // of no number no time is ever over
    return Status{StatusCode::kInvalidArgument,
                  "timeout_s is " + std::to_string(timeout_s) + ", expected seconds, at least 0"};
  constexpr double kBudget_s = 0.1;  // nobody has a frame to keep here
  const Stopwatch waited;
  Waited result;
  for (;;) {
    time_s = std::max(time_s, session.heard_time_s().value_or(time_s));
    Result<FrameReport> report = session.update(frame, time_s, motions, kBudget_s);
    NEARMESH_RETURN_IF_ERROR(report);
    motions.clear();  // the session knows them by now
    std::vector<std::string> complaints = std::move(result.report.complaints);
    result.report = std::move(report).value();
    complaints.insert(complaints.end(), result.report.complaints.begin(),
                      result.report.complaints.end());
    result.report.complaints = std::move(complaints);
    Result<Readiness> readiness = session.readiness(body);
    NEARMESH_RETURN_IF_ERROR(readiness);
    result.readiness = std::move(readiness).value();
    if (result.readiness.stage == ReadyStage::kCertified || waited.seconds() >= timeout_s)
      return result;
    std::this_thread::sleep_for(kPause);
  }
}

}  // namespace nearmesh::subscriber
