// SPDX-License-Identifier: Apache-2.0
#pragma once
// A zero-initialised array over all ids of a model whose memory is only what is touched: pages come
// from the kernel on first use. Ids are depth-first ranks, so what is touched together lies
// together.

#include <sys/mman.h>

#include <cstddef>
#include <cstdint>
#include <new>
#include <type_traits>
#include <utility>

#include "nearmesh/core/base/detail/assert.hpp"

namespace nearmesh {

/// T must be valid as all-zero bytes. Throws std::bad_alloc when the address space is exhausted.
template <class T>
class LazyArray {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  LazyArray() = default;
  explicit LazyArray(std::size_t size) : size_(size) {
    if (size == 0) return;
    void* p = ::mmap(nullptr, size * sizeof(T), PROT_READ | PROT_WRITE,
                     MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (p == MAP_FAILED) throw std::bad_alloc();
    data_ = static_cast<T*>(p);
  }
  LazyArray(LazyArray&& o) noexcept
      : data_(std::exchange(o.data_, nullptr)), size_(std::exchange(o.size_, 0)) {}
  LazyArray& operator=(LazyArray&& o) noexcept {
    std::swap(data_, o.data_);
    std::swap(size_, o.size_);
    return *this;
  }
  ~LazyArray() {
    if (data_ != nullptr) ::munmap(data_, size_ * sizeof(T));
  }

  /// Room for more, all zero. Pages move, nothing is copied; references to elements become invalid.
  void grow(std::size_t size) {
    NEARMESH_ASSERT(size >= size_);
    if (size_ == 0) {
      *this = LazyArray(size);
      return;
    }
    void* p = ::mremap(data_, size_ * sizeof(T), size * sizeof(T), MREMAP_MAYMOVE);
    if (p == MAP_FAILED) throw std::bad_alloc();
    data_ = static_cast<T*>(p);
    size_ = size;
  }

  /// Asks the kernel for the pages of [first, first + count) at once, which costs half of what it
  /// costs one by one where they are touched. No other effect.
  void prepare(std::size_t first, std::size_t count) {
    NEARMESH_ASSERT(first + count <= size_);
    constexpr std::uintptr_t kPage = 4096;
    auto* begin = reinterpret_cast<char*>(data_ + first);
    const auto* end = reinterpret_cast<char*>(data_ + first + count);
    begin -= reinterpret_cast<std::uintptr_t>(begin) % kPage;
    static_cast<void>(::madvise(begin, static_cast<std::size_t>(end - begin), MADV_POPULATE_WRITE));
  }

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] const T* data() const { return data_; }
  T& operator[](std::size_t i) {
    NEARMESH_ASSERT(i < size_);
    return data_[i];
  }
  const T& operator[](std::size_t i) const {
    NEARMESH_ASSERT(i < size_);
    return data_[i];
  }

 private:
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace nearmesh
