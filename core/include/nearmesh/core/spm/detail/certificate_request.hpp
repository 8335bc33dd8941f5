// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer says of its bodies and of what it holds, so that a publisher chooses the detail that
// certifies its answers.

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// Which pairs are to be certified, and for how long.
struct CertificateRequest {
  struct Model {
    ContentHash content;
    std::uint64_t state = 0;  ///< digest of the set of splits that the peer has done
    /// These splits (replica/held_nodes.hpp), if it was asked for them.
    std::vector<std::uint8_t> held;
  };
  /// Body b as seen from body a, whose pose is the identity and which rests.
  struct Pair {
    std::uint8_t a = 0, b = 0;  ///< places in `models`
    bool solid_a = false, solid_b = false;
    std::array<float, 4> rotation{1, 0, 0, 0};  ///< unit quaternion: w, x, y, z
    std::array<float, 3> translation_m{}, linear_velocity_mps{}, angular_velocity_radps{};
  };
  float horizon_s = 0;  ///< so far ahead
  float margin_m = 0;   ///< so much around
  std::vector<Model> models;
  std::vector<Pair> pairs;
};

inline constexpr std::size_t kMaxAskedModels = 16, kMaxAskedPairs = 64;

/// Checks a request from outside; none of its content. Errors: kInvalidArgument naming what is out
/// of range.
[[nodiscard]] Status check_request(const CertificateRequest& request);

}  // namespace nearmesh
