// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/base/hash.hpp"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace nearmesh {

std::uint64_t hash_bytes(std::span<const std::uint8_t> bytes, std::uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

}  // namespace nearmesh
