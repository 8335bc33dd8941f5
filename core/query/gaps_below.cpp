// SPDX-License-Identifier: Apache-2.0
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/query/gaps_below.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "core/geometry/vectors.hpp"
#include "gaps_below.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

/// TreeEntry::is_coarse of the lanes from `lane` on.
HWY_INLINE Mask is_coarse(const TreeNode& node, std::size_t lane) {
  const Ints i;
  const hn::Rebind<std::int64_t, Doubles> wide;
  const auto at = [&i](TreeEntry::Kind kind) {
    return hn::Set(i, static_cast<std::int32_t>(kind));
  };
  const auto both =
      hn::BitCast(i, hn::LoadU(hn::Rebind<std::uint32_t, Doubles>(), node.kind_and_count + lane));
  const auto kind = hn::And(both, hn::Set(i, 3));
  const auto is = hn::Or(hn::VecFromMask(i, hn::Eq(kind, at(TreeEntry::Kind::kUnresolved))),
                         hn::And(hn::VecFromMask(i, hn::Eq(kind, at(TreeEntry::Kind::kInner))),
                                 hn::VecFromMask(i, hn::Ne(both, kind))));
  return hn::MaskFromVec(hn::BitCast(Doubles(), hn::PromoteTo(wide, is)));
}

std::uint32_t find_gaps_below_lanes(const TreeNode& node, const PartAbove& part,
                                    const BoxGaps& gaps, const double* along_way_m, double of_use_m,
                                    GapsBelow& below) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  const double* by_larger_m = part.is_node_larger ? gaps.on_own_m : gaps.on_other_m;
  std::uint32_t of_use = 0;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const Vec gap =
        hn::Max(hn::Max(at(part.above.gap), hn::LoadU(d, gaps.on_own_m + lane)),
                hn::Max(hn::LoadU(d, gaps.on_other_m + lane), hn::LoadU(d, along_way_m + lane)));
    const Vec lost =
        hn::Add(hn::Mul(load(node.size + lane), at(part.lost_per_size)), at(part.lost_m));
    const Vec by_larger =
        hn::Max(at(part.above.by_larger), hn::Sub(hn::LoadU(d, by_larger_m + lane), lost));
    const Vec told =
        part.is_coarse ? by_larger : hn::IfThenElse(is_coarse(node, lane), by_larger, gap);
    hn::StoreU(gap, d, below.gap + lane);
    hn::StoreU(told, d, below.by_larger + lane);
    std::uint8_t bits[8] = {};
    hn::StoreMaskBits(d, hn::Lt(gap, at(of_use_m)), bits);
    of_use |= std::uint32_t{bits[0]} << lane;
  }
  return of_use;
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(find_gaps_below_lanes);

std::uint32_t find_gaps_below(const TreeNode& node, const PartAbove& part, const BoxGaps& gaps,
                              const double (&along_way_m)[kLanes], double of_use_m,
                              GapsBelow& below) {
  return HWY_DYNAMIC_DISPATCH(find_gaps_below_lanes)(node, part, gaps, along_way_m, of_use_m,
                                                     below);
}

}  // namespace nearmesh
#endif
