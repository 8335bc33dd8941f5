// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/coding_tables.hpp"

#include <algorithm>
#include <queue>

#include "contexts.hpp"

namespace nearmesh {
namespace {

// Code lengths of an unrestricted Huffman code; ties go to the lower symbol, then the older node.
std::array<std::uint8_t, kSymbolLimit + 1> huffman_lengths(
    const std::array<std::uint64_t, kSymbolLimit + 1>& counts) {
  struct Node {
    std::uint64_t weight;
    int order, left, right;
  };
  std::vector<Node> nodes;
  const auto later = [&nodes](int a, int b) {
    const Node &x = nodes[a], &y = nodes[b];
    return x.weight != y.weight ? x.weight > y.weight : x.order > y.order;
  };
  std::priority_queue<int, std::vector<int>, decltype(later)> queue(later);
  for (int symbol = 0; symbol <= kSymbolLimit; ++symbol) {
    nodes.push_back({counts[symbol], symbol, -1, -1});
    if (counts[symbol] > 0) queue.push(symbol);
  }
  while (queue.size() > 1) {
    const int a = queue.top();
    queue.pop();
    const int b = queue.top();
    queue.pop();
    nodes.push_back({nodes[a].weight + nodes[b].weight, static_cast<int>(nodes.size()), a, b});
    queue.push(static_cast<int>(nodes.size()) - 1);
  }
  std::array<std::uint8_t, kSymbolLimit + 1> lengths{};
  std::vector<std::pair<int, std::uint8_t>> stack{{queue.top(), 0}};
  while (!stack.empty()) {
    const auto [node, depth] = stack.back();
    stack.pop_back();
    if (nodes[node].left < 0) {
      lengths[node] = depth;
    } else {
      stack.emplace_back(nodes[node].left, static_cast<std::uint8_t>(depth + 1));
      stack.emplace_back(nodes[node].right, static_cast<std::uint8_t>(depth + 1));
    }
  }
  return lengths;
}

std::vector<HuffmanTable::Decoded> fast_table(std::span<const HuffmanTable> contexts) {
  std::vector<HuffmanTable::Decoded> fast;
  fast.reserve(contexts.size() << kFastCodeBits);
  for (std::size_t context = 0; context < contexts.size(); ++context) {
    const HuffmanTable& table = contexts[context];
    for (std::size_t next = 0; next < std::size_t{1} << kFastCodeBits; ++next) {
      const int more = table.decode_bits - kFastCodeBits;
      HuffmanTable::Decoded found = table.decode[more > 0 ? next << more : next >> -more];
      if (found.length > kFastCodeBits || found.symbol == kEscape) {
        found = {};
      } else {
        found.length +=
            static_cast<std::uint8_t>(record::tail_bits(static_cast<int>(context), found.symbol));
      }
      fast.push_back(found);
    }
  }
  return fast;
}

}  // namespace

HuffmanTable HuffmanTable::from_counts(std::span<const std::uint64_t> counts,
                                       std::uint64_t escapes) {
  std::array<std::uint64_t, kSymbolLimit + 1> weights{};
  std::copy(counts.begin(), counts.end(), weights.begin());
  weights[kEscape] = escapes + 1;
  HuffmanTable table;
  table.lengths = huffman_lengths(weights);
  // Flatten the rarest until no code is too long; three or four rounds at most in practice, and
  // each round halves the spread, so it ends.
  while (*std::max_element(table.lengths.begin(), table.lengths.end()) > kMaxCodeBits) {
    for (std::uint64_t& w : weights) w = (w + 1) / 2;
    table.lengths = huffman_lengths(weights);
  }
  static_cast<void>(table.derive());
  return table;
}

bool HuffmanTable::derive() {
  codes = {};
  decode_bits = *std::max_element(lengths.begin(), lengths.end());
  if (decode_bits > kMaxCodeBits) return false;
  decode.assign(std::size_t{1} << decode_bits, {});
  std::uint32_t next = 0;  // canonical: by length, then symbol; left-aligned to decode_bits
  for (int length = 1; length <= decode_bits; ++length) {
    for (std::size_t symbol = 0; symbol < lengths.size(); ++symbol) {
      if (lengths[symbol] != length) continue;
      const std::uint32_t step = 1U << (decode_bits - length);
      if (next + step > decode.size()) return false;
      codes[symbol] = {static_cast<std::uint16_t>(next >> (decode_bits - length)),
                       static_cast<std::uint8_t>(length)};
      std::fill_n(decode.begin() + next, step,
                  Decoded{static_cast<std::uint8_t>(symbol), static_cast<std::uint8_t>(length)});
      next += step;
    }
  }
  // Complete, or no code at all (then the escape is implied).
  if (next != decode.size() && decode_bits != 0) return false;
  return true;
}

CodingTables::CodingTables(std::vector<HuffmanTable> contexts, CodingSet set) {
  std::vector<HuffmanTable::Decoded> fast = fast_table(contexts);
  tables_ = std::make_shared<const Tables>(Tables{std::move(contexts), std::move(fast), set});
}

}  // namespace nearmesh
