// SPDX-License-Identifier: Apache-2.0
#include "packed_certificate.hpp"

#include <algorithm>
#include <bit>
#include <optional>
#include <string>
#include <utility>

#include "core/base/packed_bytes.hpp"

namespace nearmesh {
namespace {

constexpr std::uint8_t kFlagSolidA = 1, kFlagSolidB = 2, kFlagMoves = 4;

/// To the bit: what is packed is what comes back.
bool moves(const CertificateRequest::Pair& pair) {
  const auto is_not_zero = [](float v) { return std::bit_cast<std::uint32_t>(v) != 0; };
  return std::ranges::any_of(pair.linear_velocity_mps, is_not_zero) ||
         std::ranges::any_of(pair.angular_velocity_radps, is_not_zero);
}

}  // namespace

std::vector<std::uint8_t> pack_certificate(const CertificateRequest& request) {
  Packer out;
  out.put(request.horizon_s);
  out.put(request.margin_m);
  out.put(static_cast<std::uint8_t>(request.models.size()));
  out.put(static_cast<std::uint8_t>(request.pairs.size()));
  for (const CertificateRequest::Model& model : request.models) {
    out.put(model.content.high);
    out.put(model.content.low);
    out.put(model.state);
    append_number(model.held.size(), out.bytes);
    out.bytes.insert(out.bytes.end(), model.held.begin(), model.held.end());
  }
  for (const CertificateRequest::Pair& pair : request.pairs) {
    const bool is_moving = moves(pair);
    out.put(pair.a);
    out.put(pair.b);
    out.put(static_cast<std::uint8_t>((pair.solid_a ? kFlagSolidA : 0) |
                                      (pair.solid_b ? kFlagSolidB : 0) |
                                      (is_moving ? kFlagMoves : 0)));
    out.put(pair.rotation);
    out.put(pair.translation_m);
    if (!is_moving) continue;
    out.put(pair.linear_velocity_mps);
    out.put(pair.angular_velocity_radps);
  }
  return std::move(out.bytes);
}

Result<CertificateRequest> unpack_certificate(std::span<const std::uint8_t> bytes) {
  Unpacker in(bytes);
  CertificateRequest request;
  std::uint8_t models = 0, pairs = 0, flags = 0;
  bool is_known = true;
  in.get(request.horizon_s);
  in.get(request.margin_m);
  in.get(models);
  in.get(pairs);
  for (int i = 0; i < models && !in.has_failed(); ++i) {
    CertificateRequest::Model& model = request.models.emplace_back();
    std::uint64_t held = 0;
    in.get(model.content.high);
    in.get(model.content.low);
    in.get(model.state);
    in.get_number(held);
    const std::span<const std::uint8_t> nodes = in.take(held);
    model.held.assign(nodes.begin(), nodes.end());
  }
  for (int i = 0; i < pairs && !in.has_failed(); ++i) {
    CertificateRequest::Pair& pair = request.pairs.emplace_back();
    in.get(pair.a);
    in.get(pair.b);
    in.get(flags);
    pair.solid_a = (flags & kFlagSolidA) != 0;
    pair.solid_b = (flags & kFlagSolidB) != 0;
    is_known &= (flags & ~(kFlagSolidA | kFlagSolidB | kFlagMoves)) == 0;
    in.get(pair.rotation);
    in.get(pair.translation_m);
    if ((flags & kFlagMoves) == 0) continue;
    in.get(pair.linear_velocity_mps);
    in.get(pair.angular_velocity_radps);
    is_known &= moves(pair);
  }
  if (in.is_whole() && is_known) return request;
  return Status{
      StatusCode::kInvalidArgument,
      "certificate request: " + std::to_string(bytes.size()) + " bytes are not one whole request"};
}

}  // namespace nearmesh
