// SPDX-License-Identifier: Apache-2.0
#pragma once
// Bytes of triangles by an ideal entropy coder with tables trained on the very mesh, for which
// nothing is charged; vertices by parallelogram over the gate, triangles by gates.

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <map>
#include <vector>

#include "nearmesh/core/abtree/detail/tree.hpp"

namespace nearmesh::chart {

// What a symbol costs by its frequency in its context.
class SymbolCosts {
 public:
  void count(int context, int symbol) {
    auto& counts = counts_[context];
    ++counts[symbol];
    ++totals_[context];
  }
  [[nodiscard]] double bits(int context, int symbol) const {
    const auto total = totals_.find(context);
    if (total == totals_.end()) return 8;
    const auto& counts = counts_.at(context);
    const auto at = counts.find(symbol);
    const double times = at == counts.end() ? 0.5 : at->second;
    return -std::log2(times / total->second);
  }

 private:
  std::map<int, std::map<int, double>> counts_;
  std::map<int, double> totals_;
};

inline int bit_length(std::int64_t x) {
  int length = 0;
  for (std::uint64_t rest = static_cast<std::uint64_t>(std::abs(x)); rest != 0; rest >>= 1)
    ++length;
  return length;
}

enum Context : int {
  kGate,
  kKnownRank,
  kSeedAxis,
  kGateAxis = kSeedAxis + 3,
  kBoxAxis = kGateAxis + 3
};
enum Gate : int { kEnd, kNew, kKnown, kSeed };

// Calls symbol(context, symbol, raw bits) for all that coding the faces as one piece would emit.
// Corners that earlier pieces had are sent again.
template <class Emit>
void code_faces(const std::vector<TreeFace>& faces, const std::array<std::uint8_t, 3>& shift,
                const GridPoint& from, const Emit& emit) {
  std::map<GridPoint, int> numbers;
  std::vector<GridPoint> points;
  std::vector<int> recent;  // most recent last
  std::vector<std::array<int, 3>> corners;
  std::map<std::pair<int, int>, std::vector<std::size_t>> by_edge;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    corners.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [at, is_new] =
          numbers.try_emplace(faces[f].corners[k], static_cast<int>(points.size()));
      if (is_new) points.push_back(faces[f].corners[k]);
      corners[f][k] = at->second;
    }
    for (std::size_t k = 0; k < 3; ++k)
      by_edge[std::minmax(corners[f][k], corners[f][(k + 1) % 3])].push_back(f);
  }
  std::vector<bool> sent(points.size()), done(faces.size());
  GridPoint last = from;
  const auto emit_offset = [&](int context, const GridPoint& p,
                               const std::array<std::int64_t, 3>& guess) {
    for (int k = 0; k < 3; ++k) {
      const std::int64_t off =
          (p[k] - guess[static_cast<std::size_t>(k)]) >> shift[static_cast<std::size_t>(k)];
      const int length = bit_length(off);
      emit(context + k, length, length);  // sign, and what is below the leading bit
    }
  };
  const auto touch = [&](int v) {
    const auto at = std::find(recent.rbegin(), recent.rend(), v);
    const int rank = static_cast<int>(at - recent.rbegin());
    if (at != recent.rend()) recent.erase(std::next(at).base());
    recent.push_back(v);
    return rank;
  };
  struct Edge {
    int u, v, opposite;
  };
  for (std::size_t seed = 0; seed < faces.size(); ++seed) {
    if (done[seed]) continue;
    done[seed] = true;
    emit(kGate, kSeed, 0);
    for (const int v : corners[seed]) {
      emit(kGate, sent[static_cast<std::size_t>(v)] ? kKnown : kNew, 0);
      const int rank = touch(v);
      if (sent[static_cast<std::size_t>(v)]) {
        emit(kKnownRank, std::min(rank, 63), 0);
      } else {
        const GridPoint& p = points[static_cast<std::size_t>(v)];
        emit_offset(kSeedAxis, p, {last[0], last[1], last[2]});
        last = p;
        sent[static_cast<std::size_t>(v)] = true;
      }
    }
    std::deque<Edge> gates;
    for (std::size_t k = 0; k < 3; ++k)
      gates.push_back({corners[seed][k], corners[seed][(k + 1) % 3], corners[seed][(k + 2) % 3]});
    while (!gates.empty()) {
      const Edge gate = gates.front();
      gates.pop_front();
      const auto& beside = by_edge[std::minmax(gate.u, gate.v)];
      const auto next =
          std::find_if(beside.begin(), beside.end(), [&](std::size_t f) { return !done[f]; });
      // A gate whose other side has come is known to both ends.
      if (next == beside.end()) {
        if (beside.size() < 2) emit(kGate, kEnd, 0);
        continue;
      }
      done[*next] = true;
      const auto& at = corners[*next];
      const int third =
          *std::find_if(at.begin(), at.end(), [&](int v) { return v != gate.u && v != gate.v; });
      const auto i = static_cast<std::size_t>(third);
      emit(kGate, sent[i] ? kKnown : kNew, 0);
      const int rank = touch(third);
      if (sent[i]) {
        emit(kKnownRank, std::min(rank, 63), 0);
      } else {
        const GridPoint &u = points[static_cast<std::size_t>(gate.u)],
                        &v = points[static_cast<std::size_t>(gate.v)],
                        &w = points[static_cast<std::size_t>(gate.opposite)];
        std::array<std::int64_t, 3> guess;
        for (int k = 0; k < 3; ++k)
          guess[static_cast<std::size_t>(k)] = std::int64_t{u[k]} + v[k] - w[k];
        emit_offset(kGateAxis, points[i], guess);
        last = points[i];
        sent[i] = true;
      }
      gates.push_back({gate.u, third, gate.v});
      gates.push_back({third, gate.v, gate.u});
    }
  }
}

}  // namespace nearmesh::chart
