// SPDX-License-Identifier: Apache-2.0
#pragma once
// Independent pieces of work on several threads. What a piece does may depend on its index alone,
// never on the thread or the order, so that results are the same for every number of threads.

#include <cstddef>
#include <functional>

namespace nearmesh {

/// Calls work(0) to work(count - 1), each once, on at most `threads` threads (0: one for each
/// core), the caller's among them, and returns when all are done. Throws what the first of them to
/// throw threw; some may not have been called then.
void for_each_index(std::size_t count, unsigned threads,
                    const std::function<void(std::size_t)>& work);

}  // namespace nearmesh
