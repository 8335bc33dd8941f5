// SPDX-License-Identifier: Apache-2.0
#pragma once
// A zero-initialised array over all ids of a model, of which few are set: a peer holds a hundred
// splits of a tile of half a million vertices. They lie apart, each on a page of its own, so a
// LazyArray of them takes forty times their size. Here they lie together in a hash table until
// there are many; from then on it is a LazyArray, which is read faster.

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include "nearmesh/core/base/detail/lazy_array.hpp"

namespace nearmesh {

/// T must be valid as all-zero bytes. Throws std::bad_alloc when the address space is exhausted.
template <class T>
class SparseArray {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  explicit SparseArray(std::size_t size) : is_array_(size <= kSmall), all_(size) {
    NEARMESH_ASSERT(size <= UINT32_MAX);
    if (!is_array_) make_room();
  }

  /// Of memory; of the array that many elements are kept in, all that it may come to.
  [[nodiscard]] std::size_t bytes() const {
    if (is_array_) return all_.size() * sizeof(T);
    return table_.capacity() * sizeof(Cell) + set_.capacity() * sizeof(T);
  }
  /// All zero where it was never set. Valid until set() is called.
  const T& operator[](std::size_t i) const {
    NEARMESH_ASSERT(i < all_.size());
    return is_array_ ? all_[i] : apart(i);
  }
  /// To be written. References to other elements become invalid.
  T& set(std::size_t i) {
    NEARMESH_ASSERT(i < all_.size());
    return is_array_ ? all_[i] : set_apart(i);
  }
  /// All zero again. No reference becomes invalid.
  void unset(std::size_t i) {
    NEARMESH_ASSERT(i < all_.size());
    if (is_array_) {
      all_[i] = T{};
    } else if (const std::uint32_t place = table_[find(i)].place; place != 0) {
      set_[place] = T{};
    }
  }
  /// Tells the processor that the element will be needed soon. No other effect, also where there is
  /// none.
  void prefetch(std::size_t i) const {
    if (i >= all_.size()) return;
    if (is_array_) {
      __builtin_prefetch(&all_[i], 1);
    } else {
      __builtin_prefetch(&table_[home(i)], 1);
    }
  }

 private:
  // Up to kSmall are an array from the start, others once more than one in kDense are set. One in
  // 16 costs who loads a whole model another 7 %.
  static constexpr std::size_t kSmall = 256, kDense = 64, kFirstRoom = 64;
  struct Cell {
    std::uint32_t id, place;  // in set_; 0: a free cell
  };

  [[nodiscard]] std::size_t home(std::size_t i) const {
    return (static_cast<std::uint32_t>(i) * 0x9e3779b1U) >> shift_;
  }
  // Its cell, or the free one where it would stand.
  [[nodiscard]] std::size_t find(std::size_t i) const {
    std::size_t at = home(i);
    while (table_[at].place != 0 && table_[at].id != i) at = (at + 1) & (table_.size() - 1);
    return at;
  }
  // Not inlined, so that reads of an array stay short.
  [[gnu::noinline]] const T& apart(std::size_t i) const { return set_[table_[find(i)].place]; }
  [[gnu::noinline]] T& set_apart(std::size_t i) {
    std::size_t at = find(i);
    if (table_[at].place == 0) {
      if (2 * set_.size() >= table_.size()) {
        make_room();
        if (is_array_) return all_[i];
        at = find(i);
      }
      table_[at] = {static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(set_.size())};
      set_.emplace_back();
    }
    return set_[table_[at].place];
  }
  // Without what was unset; in the array where enough is left. Where there is no memory nothing has
  // changed.
  void make_room() {
    std::vector<Cell> kept;
    for (const Cell& cell : table_) {
      constexpr T kUnset{};
      if (cell.place != 0 && std::memcmp(&set_[cell.place], &kUnset, sizeof(T)) != 0)
        kept.push_back(cell);
    }
    if (kept.size() > all_.size() / kDense) {
      is_array_ = true;
      for (const Cell& cell : kept) all_[cell.id] = set_[cell.place];
      table_ = {};
      set_ = {};
      return;
    }
    std::vector<Cell> table(std::max(kFirstRoom, std::bit_ceil(4 * kept.size())));
    std::vector<T> set(1);  // what unset elements are read as
    set.reserve(table.size() / 2);
    table_.swap(table);
    set_.swap(set);
    shift_ = 32 - std::countr_zero(table_.size());
    for (const Cell& cell : kept) {
      table_[find(cell.id)] = {cell.id, static_cast<std::uint32_t>(set_.size())};
      set_.push_back(set[cell.place]);
    }
  }

  bool is_array_;
  int shift_ = 0;
  std::vector<Cell> table_;  // at least half of it free
  std::vector<T> set_;
  // Its addresses are there from the start, so that who has none left is told at once; its pages
  // when it holds the elements, instead of the two above.
  LazyArray<T> all_;
};

}  // namespace nearmesh
