// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/certificate_request.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

namespace nearmesh {
namespace {

constexpr double kMaxHorizon_s = 3600;
constexpr float kFar = 1e9F;

Status invalid(std::string message) { return {StatusCode::kInvalidArgument, std::move(message)}; }

template <std::size_t N>
bool is_within(const std::array<float, N>& values, float limit) {
  return std::all_of(values.begin(), values.end(),
                     [limit](float value) { return std::abs(value) <= limit; });
}

}  // namespace

Status check_request(const CertificateRequest& request) {
  if (request.pairs.empty()) return invalid("certificate request: no pairs");
  if (request.models.size() > kMaxAskedModels || request.pairs.size() > kMaxAskedPairs)
    return invalid("certificate request: expected at most " + std::to_string(kMaxAskedModels) +
                   " models and " + std::to_string(kMaxAskedPairs) + " pairs, found " +
                   std::to_string(request.models.size()) + " and " +
                   std::to_string(request.pairs.size()));
  if (!(request.horizon_s >= 0 && request.horizon_s <= kMaxHorizon_s))
    return invalid("certificate request: expected a horizon of 0 to 3600 s");
  if (!(request.margin_m >= 0 && request.margin_m <= kFar))
    return invalid("certificate request: expected a margin of 0 to 1e9 m");
  for (auto at = request.models.begin(); at != request.models.end(); ++at)
    if (std::any_of(request.models.begin(), at,
                    [&](const auto& before) { return before.content == at->content; }))
      return invalid("certificate request: content " + to_hex(at->content) + " twice");
  for (const CertificateRequest::Pair& pair : request.pairs) {
    if (pair.a >= request.models.size() || pair.b >= request.models.size())
      return invalid("certificate request: a pair names a model that is not in it");
    double square = 0;
    for (const float q : pair.rotation) square += double{q} * double{q};
    if (!(std::abs(square - 1) <= 1e-3))
      return invalid("certificate request: a rotation is no unit quaternion");
    if (!is_within(pair.translation_m, kFar) || !is_within(pair.linear_velocity_mps, kFar) ||
        !is_within(pair.angular_velocity_radps, kFar))
      return invalid("certificate request: a pose or velocity is not within 1e9");
  }
  return Status::ok();
}

}  // namespace nearmesh
