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

// What a digest begins with says what it is of, so that no inner node is ever a leaf. A header
// needs none: it begins with its magic number.
constexpr std::uint8_t kLeaf = 0, kInner = 1;

struct FreeContext {
  void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
};
using Context = std::unique_ptr<EVP_MD_CTX, FreeContext>;

/// Looks the algorithm up each time, a microsecond, as a host's process shall hold no state of
/// ours.
ContentHash digest(std::initializer_list<Bytes> parts) {
  const Context context(EVP_MD_CTX_new());
  std::array<std::uint8_t, 32> out{};
  bool is_done =
      context != nullptr && EVP_DigestInit_ex2(context.get(), EVP_sha256(), nullptr) == 1;
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

namespace {

ContentHash inner_digest(std::span<const ContentHash> children) {
  return digest({{&kInner, 1}, bytes_of(children)});
}

std::span<const ContentHash> children_of(const std::vector<ContentHash>& level, std::size_t node) {
  const std::size_t first = node * kTreeFanOut;
  return std::span(level).subspan(first, std::min(kTreeFanOut, level.size() - first));
}

}  // namespace

ContentHash tree_root(std::vector<ContentHash> leaves) {
  return grow_tree(std::move(leaves)).back().front();
}

DigestTree grow_tree(std::vector<ContentHash> leaves) {
  NEARMESH_ASSERT(!leaves.empty());
  DigestTree tree{std::move(leaves)};
  while (tree.back().size() > 1) {
    const std::vector<ContentHash>& below = tree.back();
    std::vector<ContentHash> level((below.size() + kTreeFanOut - 1) / kTreeFanOut);
    for (std::size_t i = 0; i < level.size(); ++i) level[i] = inner_digest(children_of(below, i));
    tree.push_back(std::move(level));
  }
  return tree;
}

TreePath path_of(const DigestTree& tree, std::size_t leaf) {
  TreePath path;
  for (std::size_t level = 0; level + 1 < tree.size(); ++level) {
    leaf /= kTreeFanOut;
    const auto children = children_of(tree[level], leaf);
    path.emplace_back(children.begin(), children.end());
  }
  return path;
}

bool leads_to(const TreePath& path, const ContentHash& leaf, const ContentHash& root) {
  ContentHash at = leaf;
  for (const std::vector<ContentHash>& children : path) {
    if (std::find(children.begin(), children.end(), at) == children.end()) return false;
    at = inner_digest(children);
  }
  return at == root;
}

}  // namespace nearmesh
