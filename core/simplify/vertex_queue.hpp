// SPDX-License-Identifier: Apache-2.0
#pragma once
// Priority queue with one entry a vertex: a four-ary heap of 64-bit keys that end in the vertex's
// number, so keys never tie and an entry can be changed in place.

#include <cstdint>
#include <vector>

namespace nearmesh {

class VertexQueue {
 public:
  static constexpr std::uint32_t kAbsent = 0xffffffffU;

  explicit VertexQueue(std::uint32_t vertices) : place_(vertices, kAbsent) {
    heap_.reserve(vertices);
  }

  [[nodiscard]] bool is_empty() const { return heap_.empty(); }
  [[nodiscard]] std::uint64_t top() const { return heap_.front(); }
  [[nodiscard]] bool contains(std::uint32_t vertex) const { return place_[vertex] != kAbsent; }
  /// Key of a vertex that is in the queue.
  [[nodiscard]] std::uint64_t key(std::uint32_t vertex) const { return heap_[place_[vertex]]; }

  /// Inserts, or changes the key of, the vertex in the key's low half.
  void set(std::uint64_t key) {
    const auto vertex = static_cast<std::uint32_t>(key);
    std::uint32_t at = place_[vertex];
    if (at == kAbsent) {
      at = static_cast<std::uint32_t>(heap_.size());
      heap_.push_back(key);
      rise(at, key);
    } else if (key < heap_[at]) {
      rise(at, key);
    } else if (key > heap_[at]) {
      sink(at, key);
    }
  }
  void remove(std::uint32_t vertex) {
    const std::uint32_t at = place_[vertex];
    if (at == kAbsent) return;
    place_[vertex] = kAbsent;
    const std::uint64_t old = heap_[at], last = heap_.back();
    heap_.pop_back();
    if (at == heap_.size()) return;
    if (last < old)
      rise(at, last);
    else
      sink(at, last);
  }

 private:
  void put(std::uint32_t at, std::uint64_t key) {
    heap_[at] = key;
    place_[static_cast<std::uint32_t>(key)] = at;
  }
  void rise(std::uint32_t at, std::uint64_t key) {
    while (at > 0) {
      const std::uint32_t parent = (at - 1) / 4;
      if (heap_[parent] < key) break;
      put(at, heap_[parent]);
      at = parent;
    }
    put(at, key);
  }
  void sink(std::uint32_t at, std::uint64_t key) {
    const std::size_t size = heap_.size();
    for (;;) {
      const std::size_t first = std::size_t{4} * at + 1;
      if (first >= size) break;
      std::size_t least = first;
      const std::size_t end = first + 4 < size ? first + 4 : size;
      for (std::size_t child = first + 1; child < end; ++child)
        if (heap_[child] < heap_[least]) least = child;
      if (key < heap_[least]) break;
      put(at, heap_[least]);
      at = static_cast<std::uint32_t>(least);
    }
    put(at, key);
  }

  std::vector<std::uint64_t> heap_;
  std::vector<std::uint32_t> place_;
};

}  // namespace nearmesh
