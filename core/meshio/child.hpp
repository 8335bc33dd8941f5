// SPDX-License-Identifier: Apache-2.0
#pragma once
// Runs a reader in a forked child under limits, and takes its mesh over a pipe: a crash, a hang or
// a hunger for memory inside a third-party reader becomes a Status here.

#include <chrono>
#include <cstdint>
#include <functional>

#include "scene_mesh.hpp"

namespace nearmesh::meshio {

struct ChildLimits {
  std::uint64_t memory_bytes = 0;    ///< address space beyond what this process holds already; not
                                     ///< enforced under AddressSanitizer, which reserves terabytes
  std::chrono::seconds wall_time{};  ///< then the child is killed
};

/// Runs `reader` in a child and returns what it returns.
/// Errors, besides the reader's own: kIo (no pipe, no process), kCorrupt (crashed, took too long,
/// or threw). Threads: may be called from several at once; the child holds only the calling thread.
[[nodiscard]] Result<SceneMesh> run_in_child(const std::function<Result<SceneMesh>()>& reader,
                                             const ChildLimits& limits);

}  // namespace nearmesh::meshio
