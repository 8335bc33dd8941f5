// SPDX-License-Identifier: Apache-2.0
// The numbers of a film: poses come back as they were, to the last place that is told.
#include "random_rotation.hpp"
#include "subscriber/recorded/film_stream.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using subscriber::FilmPose;
using subscriber::FilmStream;
using subscriber::FilmWay;

/// As player/film.js reads them.
class Reader {
 public:
  explicit Reader(const std::string& bytes) : bytes_(bytes) {}
  std::int64_t signed_number() {
    std::uint64_t x = 0;
    for (int shift = 0;; shift += 7) {
      const auto byte = static_cast<unsigned char>(bytes_[at_++]);
      x |= std::uint64_t{byte & 127U} << shift;
      if (byte < 128) break;
    }
    return static_cast<std::int64_t>(x >> 1) ^ -static_cast<std::int64_t>(x & 1);
  }
  [[nodiscard]] bool has_ended() const { return at_ == bytes_.size(); }

 private:
  const std::string& bytes_;
  std::size_t at_ = 0;
};

TEST(FilmWay, TellsEachPoseWhateverTheWay) {
  Random random(2);
  FilmWay way;
  FilmStream stream;
  std::vector<FilmPose> poses;
  for (int i = 0; i < 200; ++i) {
    Pose pose{.rotation = test::random_rotation(random)};
    for (double& x : pose.translation_m) x = random.between(-1e6, 1e6);
    poses.emplace_back(pose, i < 100 ? -10 : 0);  // the unit changes once
    way.tell(poses.back(), stream);
    EXPECT_TRUE(way.is_at(poses.back()));
  }
  Reader reader(stream.bytes);
  std::array<std::int64_t, 7> last{}, step{};
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const bool begins = i == 0 || i == 100;
    if (begins) last = step = {};
    for (std::size_t k = 0; k < 7; ++k) {
      const std::int64_t before = last[k];
      last[k] += step[k] + reader.signed_number();
      step[k] = k < 3 && !begins ? last[k] - before : 0;
    }
    ASSERT_EQ(last, poses[i].at) << i;
  }
  EXPECT_TRUE(reader.has_ended());
}

}  // namespace
}  // namespace nearmesh
