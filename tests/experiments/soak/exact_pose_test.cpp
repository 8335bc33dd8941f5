// SPDX-License-Identifier: Apache-2.0
// pose_point against the frame's affine image in exact rationals.
#include <gmpxx.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/base/random.hpp"
#include "nearmesh/core/geometry/pose.hpp"
#include "random_rotation.hpp"

namespace nearmesh::test {
namespace {

/// (rotation * p) / 2^shift + translation, of the frame's integers.
mpq_class exact_image(const PosedFrame& frame, const GridPoint& p, std::size_t axis) {
  mpz_class n = 0;
  for (std::size_t j = 0; j < 3; ++j) n += mpz_class(frame.rotation[3 * axis + j]) * p.v[j];
  mpq_class image = n;
  const auto bits = static_cast<mp_bitcnt_t>(std::abs(frame.shift));
  if (frame.shift >= 0)
    mpq_div_2exp(image.get_mpq_t(), image.get_mpq_t(), bits);
  else
    mpq_mul_2exp(image.get_mpq_t(), image.get_mpq_t(), bits);
  return image + mpz_class(frame.translation[axis]);
}

/// A grid of cells of 1 m on a lattice from the finest that is allowed to the coarsest, one of
/// 2^100 m.
PosedFrame random_frame(Random& random) {
  const int bits = kMinGridBits + static_cast<int>(random.below(kMaxGridBits - kMinGridBits + 1));
  const int finest = bits - 38;
  int exponent = finest;
  switch (random.below(4)) {
    case 0:
      break;
    case 1:
      exponent = 30 + static_cast<int>(random.below(6));
      break;  // shift 60 to 65
    case 2:
      exponent += static_cast<int>(random.below(40));
      break;
    default:
      exponent += static_cast<int>(random.below(static_cast<std::uint32_t>(101 - finest)));
  }
  Pose pose;
  if (random.below(3)) pose.rotation = random_rotation(random);
  if (random.below(4) == 0)  // the longest sums: a row along a diagonal of the grid
    pose.rotation = {std::sqrt(1.0 / 3), std::sqrt(1.0 / 3), std::sqrt(1.0 / 3),
                     std::sqrt(0.5),     -std::sqrt(0.5),    0,
                     std::sqrt(1.0 / 6), std::sqrt(1.0 / 6), -std::sqrt(2.0 / 3)};
  for (double& t : pose.translation_m) {
    const double share = random.between(-1, 1);
    t = std::ldexp(share, exponent + static_cast<int>(random.below(62)));
  }
  const Result<PosedFrame> frame = make_posed_frame({{}, 0, bits}, pose, exponent);
  EXPECT_TRUE(frame.is_ok()) << frame.status().message();
  return frame.is_ok() ? frame.value() : PosedFrame{};
}

/// In the grid or, where the frame allows, anywhere.
GridPoint random_point(Random& random, const PosedFrame& frame) {
  const bool anywhere = frame.shift >= 0 && random.below(2);
  const std::int64_t lo = anywhere ? std::numeric_limits<std::int32_t>::min() : 0;
  const std::int64_t hi = anywhere ? std::numeric_limits<std::int32_t>::max()
                                   : (std::int64_t{1} << frame.grid.bits) - 1;
  const bool at_ends = random.below(4) == 0;
  GridPoint p;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t x = at_ends
                               ? (random.below(2) ? lo : hi)
                               : lo + static_cast<std::int64_t>(
                                          random.next() % static_cast<std::uint64_t>(hi - lo + 1));
    p[k] = static_cast<std::int32_t>(x);
  }
  return p;
}

TEST(PosePoint, RoundsTheExactImageToTheNearestCellHalvesUp) {
  Random random(11);
  const mpq_class half(1, 2);
  int ties = 0, smallest = 1000, greatest = -1000;
  for (int i = 0; i < 60000; ++i) {
    const PosedFrame frame = random_frame(random);
    const GridPoint p = random_point(random, frame);
    const LatticePoint posed = pose_point(frame, p);
    smallest = std::min(smallest, frame.shift);
    greatest = std::max(greatest, frame.shift);
    for (std::size_t k = 0; k < 3; ++k) {
      const mpq_class error = mpz_class(posed.v[k]) - exact_image(frame, p, k);
      ties += error == half;
      ASSERT_TRUE(-half < error && error <= half)
          << "shift " << frame.shift << " axis " << k << " point " << p[0] << ' ' << p[1] << ' '
          << p[2] << " error " << error;
    }
  }
  EXPECT_EQ(smallest, -4);
  EXPECT_EQ(greatest, 130);
  EXPECT_GT(ties, 100);
}

}  // namespace
}  // namespace nearmesh::test
