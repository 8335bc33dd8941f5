// SPDX-License-Identifier: Apache-2.0
#pragma once
// How a certificate request travels, lowest byte first:
//   horizon, margin   a float each
//   models, pairs     a byte each: how many follow
//   each model        its content's two words, the high one first; its state, a word; how many
//                     bytes say what is held (short_number.hpp); these
//   each pair         places of a and b, a byte each; flags: 1 a is solid, 2 b, 4 it moves; floats:
//                     rotation, translation and, where it moves, velocities

#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/core/spm/detail/certificate_request.hpp"

namespace nearmesh {

[[nodiscard]] std::vector<std::uint8_t> pack_certificate(const CertificateRequest& request);

/// Errors: kInvalidArgument where the bytes are not exactly one request. Whether it makes sense:
/// check_request().
[[nodiscard]] Result<CertificateRequest> unpack_certificate(std::span<const std::uint8_t> bytes);

}  // namespace nearmesh
