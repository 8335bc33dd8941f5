// SPDX-License-Identifier: Apache-2.0
#pragma once
// The cryptographic hash behind a model's name, and the tree that lets parts of a model be checked
// one by one.

#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"

namespace nearmesh {

/// The first 128 bits of SHA-256.
[[nodiscard]] ContentHash digest_of(std::span<const std::uint8_t> bytes);

/// A leaf of a tree: a digest of its place's two numbers and its bytes. Never equal to an inner
/// node, whatever the bytes.
[[nodiscard]] ContentHash leaf_digest(std::uint32_t first, std::uint32_t size,
                                      std::span<const std::uint8_t> bytes);
/// An inner node has kTreeFanOut children, the last of a level perhaps fewer; the root of one leaf
/// is that leaf.
inline constexpr std::size_t kTreeFanOut = 8;
/// In: at least one leaf. Cost: a digest for each inner node.
[[nodiscard]] ContentHash tree_root(std::vector<ContentHash> leaves);

/// All levels of a tree, the leaves first.
using DigestTree = std::vector<std::vector<ContentHash>>;
[[nodiscard]] DigestTree grow_tree(std::vector<ContentHash> leaves);
/// What shows that a leaf is of a tree: the children of each node above it, from below.
using TreePath = std::vector<std::vector<ContentHash>>;
[[nodiscard]] TreePath path_of(const DigestTree& tree, std::size_t leaf);
[[nodiscard]] bool leads_to(const TreePath& path, const ContentHash& leaf, const ContentHash& root);

}  // namespace nearmesh
