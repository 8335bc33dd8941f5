// SPDX-License-Identifier: Apache-2.0
#include "idl/messages/ros2_messages.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "core/base/random.hpp"

namespace nearmesh::ros2 {
namespace {

constexpr std::int64_t kStamp_ns = 1'700'000'000'123'456'789;

Pose some_pose(Random& random) {
  std::array<double, 4> wxyz{};
  double square = 0;
  for (double& x : wxyz) {
    x = random.between(-1, 1);
    square += x * x;
  }
  for (double& x : wxyz) x /= std::sqrt(square);
  Pose pose{.rotation = rotation_of_quaternion(wxyz, "some").value()};
  for (double& x : pose.translation_m) x = random.between(-1e6, 1e6);
  return pose;
}

/// A PoseStamped, of which no writer is here: a transform without the child's frame.
Bytes pose_stamped(const std::string& frame, const std::array<double, 7>& numbers) {
  Bytes cdr{0, 1, 0, 0};
  const auto put = [&](const auto& value) {
    cdr.resize(4 + (cdr.size() - 4 + sizeof value - 1) / sizeof value * sizeof value);
    const std::size_t at = cdr.size();
    cdr.resize(at + sizeof value);
    std::memcpy(&cdr[at], &value, sizeof value);
  };
  put(std::int32_t{5});
  put(std::uint32_t{7});
  put(static_cast<std::uint32_t>(frame.size() + 1));
  cdr.insert(cdr.end(), frame.begin(), frame.end());
  cdr.push_back(0);
  for (const double x : numbers) put(x);
  return cdr;
}

TEST(Ros2Messages, TransformsAreReadAsTheyWereWritten) {
  Random random(24);
  for (int round = 0; round < 50; ++round) {
    std::vector<Transform> written;
    for (int i = round % 5; i > 0; --i)
      written.push_back({std::string(static_cast<std::size_t>(round % 9), 'x'), some_pose(random)});
    const auto read = read_tf_message(tf_message(kStamp_ns, written, "map"));
    ASSERT_TRUE(read.is_ok()) << read.status().message();
    ASSERT_EQ(read.value().size(), written.size());
    for (std::size_t i = 0; i < written.size(); ++i) {
      const SaidPose& said = read.value()[i];
      EXPECT_EQ(said.stamp_ns, kStamp_ns);
      EXPECT_EQ(said.frame, "map");
      EXPECT_EQ(said.child_frame, written[i].child_frame);
      const auto pose = to_pose(said, "body");
      ASSERT_TRUE(pose.is_ok()) << pose.status().message();
      EXPECT_EQ(pose.value().translation_m, written[i].pose.translation_m);
      for (std::size_t k = 0; k < 9; ++k)
        EXPECT_NEAR(pose.value().rotation[k], written[i].pose.rotation[k], 1e-14);
    }
  }
}

TEST(Ros2Messages, StampsBeforeTheEpochAreReadAsTheyWereWritten) {
  for (const std::int64_t stamp_ns : {-1LL, -1'500'000'000LL, -2'000'000'000LL, 0LL})
    EXPECT_EQ(read_tf_message(tf_message(stamp_ns, {{"rover", {}}})).value()[0].stamp_ns, stamp_ns);
}

TEST(Ros2Messages, PosesAreReadInEitherByteOrder) {
  const Bytes little = pose_stamped("world", {1, 2, 3, 0, 0, 0, 1});
  Bytes big = little;
  big[1] = 0;
  for (const auto& [at, size] : {std::pair(4, 4), {8, 4}, {12, 4}})
    std::reverse(big.begin() + at, big.begin() + at + size);
  // Six bytes of text end at 22, numbers begin at a multiple of eight behind the encapsulation.
  for (std::ptrdiff_t at = 28; at < 28 + 7 * 8; at += 8)
    std::reverse(big.begin() + at, big.begin() + at + 8);
  ASSERT_EQ(little.size(), 28U + 7 * 8);
  for (const Bytes& bytes : {little, big}) {
    const auto said = read_pose_stamped(bytes);
    ASSERT_TRUE(said.is_ok()) << said.status().message();
    EXPECT_EQ(said.value().stamp_ns, 5'000'000'007);
    EXPECT_EQ(said.value().frame, "world");
    EXPECT_EQ(said.value().translation_m, (std::array<double, 3>{1, 2, 3}));
    EXPECT_EQ(said.value().wxyz, (std::array<double, 4>{1, 0, 0, 0}));
  }
}

TEST(Ros2Messages, EveryPrefixAndWhatIsBehindIsRefused) {
  const Bytes pose = pose_stamped("world", {1, 2, 3, 0, 0, 0, 1});
  const Bytes tf = tf_message(kStamp_ns, {{"drone", {}}, {"rover", {}}});
  for (std::size_t size = 0; size < tf.size(); ++size)
    EXPECT_FALSE(read_tf_message(std::span(tf).first(size)).is_ok()) << size;
  for (std::size_t size = 0; size < pose.size(); ++size)
    EXPECT_FALSE(read_pose_stamped(std::span(pose).first(size)).is_ok()) << size;
  for (std::size_t more = 0; more < 6; ++more) {
    Bytes longer = pose;
    longer.resize(pose.size() + more);
    EXPECT_EQ(read_pose_stamped(longer).is_ok(), more < 4) << more;  // padding
  }
  Bytes other = pose;
  other[1] = 3;  // a list of parameters
  EXPECT_FALSE(read_pose_stamped(other).is_ok());
}

TEST(Ros2Messages, NoCountIsTrustedAndNothingIsReadBeyondTheEnd) {
  const Bytes tf = tf_message(kStamp_ns, {{"drone", {}}, {"rover", {}}});
  Random random(7);
  for (int round = 0; round < 20'000; ++round) {
    Bytes bad = tf;
    for (int i = 0; i < 3; ++i)
      bad[random.below(static_cast<std::uint32_t>(bad.size()))] =
          static_cast<std::uint8_t>(random.below(256));
    bad.resize(random.below(static_cast<std::uint32_t>(bad.size() + 1)));
    // On the heap, with nothing behind: a sanitizer sees who reads there.
    const Bytes exact(bad.begin(), bad.end());
    if (const auto read = read_tf_message(exact); read.is_ok()) {
      EXPECT_LE(read.value().size(), 2U);
    }
    static_cast<void>(read_pose_stamped(exact));
  }
  Bytes many = tf;
  std::fill_n(many.begin() + 4, 4, std::uint8_t{0xff});
  EXPECT_FALSE(read_tf_message(many).is_ok());
}

TEST(Ros2Messages, WhatIsNoPoseIsRefusedByName) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  for (const std::array<double, 7>& bad :
       std::vector<std::array<double, 7>>{{kNan, 0, 0, 0, 0, 0, 1},
                                          {0, kInf, 0, 0, 0, 0, 1},
                                          {0, 0, 2e9, 0, 0, 0, 1},
                                          {0, 0, 0, kNan, 0, 0, 1},
                                          {0, 0, 0, 0, 0, 0, 0},
                                          {0, 0, 0, 0, 0, 0, 2}}) {
    const auto said = read_pose_stamped(pose_stamped("world", bad));
    ASSERT_TRUE(said.is_ok());
    const auto pose = to_pose(said.value(), "drone");
    ASSERT_FALSE(pose.is_ok());
    EXPECT_NE(pose.status().message().find("drone"), std::string::npos) << pose.status().message();
  }
}

}  // namespace
}  // namespace nearmesh::ros2
