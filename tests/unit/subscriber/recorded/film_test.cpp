// SPDX-License-Identifier: Apache-2.0
// The numbers of a film: poses come back as they were, to the last place that is told. And whose
// film it is.
#include "subscriber/recorded/film.hpp"
#include "random_rotation.hpp"
#include "session_file.hpp"
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
  std::uint64_t number() {
    std::uint64_t x = 0;
    for (int shift = 0;; shift += 7) {
      const auto byte = static_cast<unsigned char>(bytes_[at_++]);
      x |= std::uint64_t{byte & 127U} << shift;
      if (byte < 128) return x;
    }
  }
  std::int64_t signed_number() {
    const std::uint64_t x = number();
    return static_cast<std::int64_t>(x >> 1) ^ -static_cast<std::int64_t>(x & 1);
  }
  void skip(std::size_t bytes) { at_ += bytes; }
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

std::string stream_of(const subscriber::Film& film, const std::string& name) {
  for (const auto& stream : film.streams)
    if (stream.name == name) return stream.bytes;
  return {};
}

// As it does when the recorder's machine is set.
TEST(Film, TimeStaysWhereTheRecordersClockGoesBack) {
  const test::TempFile file(".db3");
  test::SessionFile session(file.path());
  session.add(0, wire::BodyDirectory{.peer = 1, .bodies = {{0, "rover", "car"}}});
  for (const double time_s : {1.0, 5.0, 2.0, 6.0}) {
    wire::BodyPoses poses{.peer = 1, .bodies = {{.number = 0, .time_s = time_s}}};
    poses.bodies[0].motion.pose.translation_m[0] = time_s;
    session.add(time_s, poses);
  }
  session.close();
  const auto recording = RecordingReader::open(file.path()).value();
  const std::string world = stream_of(subscriber::make_film(*recording, {}).value(), "world");
  Reader reader(world);
  reader.skip(1);  // 'B'
  static_cast<void>(reader.number() + reader.number());
  static_cast<void>(reader.signed_number());
  reader.skip(reader.number());
  std::vector<std::uint64_t> steps_ms;
  while (!reader.has_ended()) {
    reader.skip(1);  // 'P'
    EXPECT_EQ(reader.number(), 0U);
    steps_ms.push_back(reader.number());
    for (int k = 0; k < 7; ++k) static_cast<void>(reader.signed_number());
  }
  EXPECT_EQ(steps_ms, (std::vector<std::uint64_t>{1000, 4000, 0, 1000}));
}

// Whoever writes batches names their partition, and in a page of HTML a peer's name stands within
// markup.
TEST(Film, PartitionOfNobodyIsNoPeer) {
  const test::TempFile file(".db3");
  const wire::TopicNames names("recorded");
  auto writer =
      RecordingWriter::create(file.path(), {1, 0, wire::kWireVersion, "recorded", "idl"}).value();
  const std::uint32_t topic =
      writer->add_topic({names.of<wire::SplitBatchMessage>(), "type"}).value();
  const std::vector<std::uint8_t> batch =
      wire::encode_payload(wire::SplitBatchMessage{.publisher = 0xa1, .request = 1, .sequence = 1});
  for (const std::string partition : {"00000000000000b1", "\"><script>alert(1)</script>", "*"}) {
    const std::uint32_t by = writer->add_writer({topic, {}, partition}).value();
    EXPECT_TRUE(writer->append({.writer = by, .cdr = batch}).is_ok());
  }
  ASSERT_TRUE(writer->close().is_ok());
  const auto recording = RecordingReader::open(file.path()).value();
  const auto film = subscriber::make_film(*recording, {});
  ASSERT_TRUE(film.is_ok()) << film.status().message();
  EXPECT_EQ(film.value().peers, std::vector<std::string>{"00000000000000b1"});
  for (const auto& stream : film.value().streams)
    EXPECT_EQ(stream.name.find_first_of("<>\"*"), std::string::npos) << stream.name;
}

}  // namespace
}  // namespace nearmesh
