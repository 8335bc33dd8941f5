// SPDX-License-Identifier: Apache-2.0
#pragma once
// Detail of a content that a peer keeps in a folder for the next time that it joins: the batches
// that it was sent, as they came. One file a content, named by its hash. Whoever can write there
// can lie to the peer as a publisher can.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh::subscriber {

using Batches = std::vector<std::vector<std::uint8_t>>;

/// Of one content; what came first is kept.
inline constexpr std::size_t kMaxCachedBytes = 8U << 20, kMaxCachedBatches = 16'384;

/// Nothing where there is no file. Errors, each naming the file: kIo; kCorrupt where it is damaged,
/// no such file, or of another content; kUnsupported for another version.
[[nodiscard]] Result<std::optional<Batches>> read_cached(const std::string& folder,
                                                         const ContentHash& content);
/// Replaces the file as a whole, so that processes may share a folder; of no batches, removes it.
/// Makes the folder. Errors: those of write_file().
[[nodiscard]] Status write_cached(const std::string& folder, const ContentHash& content,
                                  const Batches& batches);

}  // namespace nearmesh::subscriber
