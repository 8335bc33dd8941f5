// SPDX-License-Identifier: Apache-2.0
#include "digest.hpp"

#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <new>

#include "nearmesh/core/base/detail/assert.hpp"

namespace nearmesh {
namespace {

using Bytes = std::span<const std::uint8_t>;

// What a digest begins with says what it is of, so that no inner node is ever a leaf. A header needs none: it begins with
// its magic number.
constexpr std::uint8_t kLeaf = 0, kInner = 1;

struct FreeContext {
  void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
};
using Context = std::unique_ptr<EVP_MD_CTX, FreeContext>;

/// Looking the algorithm up takes longer than a digest, so each thread keeps a context with it.
ContentHash digest(std::initializer_list<Bytes> parts) {
  static const EVP_MD* const algorithm = EVP_MD_fetch(nullptr, "SHA256", nullptr);
  thread_local const Context context(EVP_MD_CTX_new());
  std::array<std::uint8_t, 32> out{};
  bool is_done = algorithm != nullptr && context != nullptr &&
                 EVP_DigestInit_ex2(context.get(), algorithm, nullptr) == 1;
  for (const Bytes part : parts)
    is_done = is_done && EVP_DigestUpdate(context.get(), part.data(), part.size()) == 1;
  // SHA-256 cannot fail but for want of memory.
  if (!is_done || EVP_DigestFinal_ex(context.get(), out.data(), nullptr) != 1)
    throw std::bad_alloc();
  const auto word = [&out](std::size_t at) {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < 8; ++i) value = value << 8 | out[at + i];
    return value;
  };
  return {word(0), word(8)};
}

template <class T>
Bytes bytes_of(std::span<const T> values) {
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size_bytes()};
}

}  // namespace

ContentHash digest_of(std::span<const std::uint8_t> bytes) { return digest({bytes}); }

ContentHash leaf_digest(std::uint32_t first, std::uint32_t size,
                        std::span<const std::uint8_t> bytes) {
  static_assert(std::endian::native == std::endian::little);
  const std::array<std::uint32_t, 2> place{first, size};
  return digest({{&kLeaf, 1}, bytes_of(std::span<const std::uint32_t>(place)), bytes});
}

ContentHash tree_root(std::vector<ContentHash> leaves) {
  NEARMESH_ASSERT(!leaves.empty());
  while (leaves.size() > 1) {
    std::size_t count = 0;
    for (std::size_t first = 0; first < leaves.size(); first += kTreeFanOut) {
      const auto children = std::span<const ContentHash>(leaves).subspan(
          first, std::min(kTreeFanOut, leaves.size() - first));
      leaves[count++] = digest({{&kInner, 1}, bytes_of(children)});
    }
    leaves.resize(count);
  }
  return leaves.front();
}

}  // namespace nearmesh
