// SPDX-License-Identifier: Apache-2.0
// What is not in a recording is told apart: sent before the recorder came, or missing since.
#include "subscriber/recorded/survey.hpp"

#include "nearmesh/idl/dds/payload.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

TEST(Survey, TellsWhatWasBeforeFromWhatIsMissing) {
  const test::TempFile file(".db3");
  const wire::TopicNames names("prefix");
  auto writer =
      RecordingWriter::create(file.path(), {1, 0, wire::kWireVersion, "prefix", "idl"}).value();
  const auto add_writer = [&](const std::string& topic, const std::string& partition) {
    return writer->add_writer({writer->add_topic({topic, "type"}).value(), {}, partition}).value();
  };
  const std::uint32_t poses = add_writer(names.of<wire::BodyPoses>(), ""),
                      batches = add_writer(names.of<wire::SplitBatchMessage>(), "00000000000000b1");
  constexpr std::int64_t kBegin_ns = 1'700'000'000'000'000'000;
  const auto append = [&](std::uint32_t by, std::uint64_t sequence, std::int64_t sent_ns,
                          std::vector<std::uint8_t> cdr) {
    EXPECT_TRUE(writer
                    ->append({.writer = by,
                              .sequence = sequence,
                              .received_ns = kBegin_ns + std::max<std::int64_t>(0, sent_ns),
                              .source_ns = kBegin_ns + sent_ns,
                              .cdr = std::move(cdr)})
                    .is_ok());
  };
  const auto poses_of = [](std::uint32_t part) {
    return wire::encode_payload(wire::BodyPoses{.peer = 0xb1, .part = part});
  };
  // Latched: the last poses of bodies at rest, then those of some that move.
  EXPECT_TRUE(writer->add_gap({poses, 1, 9, kBegin_ns}).is_ok());
  append(poses, 10, -5'000'000'000, poses_of(0));
  EXPECT_TRUE(writer->add_gap({poses, 11, 989, kBegin_ns}).is_ok());
  append(poses, 1000, -1'000'000, poses_of(1));
  append(poses, 1001, 1'000'000, poses_of(1));
  EXPECT_TRUE(writer->add_gap({poses, 1002, 3, kBegin_ns}).is_ok());
  append(poses, 1005, 9'000'000, poses_of(1));
  EXPECT_TRUE(writer->add_gap({batches, 1, 56, kBegin_ns}).is_ok());
  append(batches, 57, 2'000'000,
         wire::encode_payload(
             wire::SplitBatchMessage{.publisher = 0xa1, .request = 1, .sequence = 57}));
  ASSERT_TRUE(writer->close().is_ok());

  const auto recording = RecordingReader::open(file.path()).value();
  const auto found = subscriber::survey(*recording);
  ASSERT_TRUE(found.is_ok()) << found.status().message();
  const subscriber::Survey& survey = found.value();
  EXPECT_EQ(survey.topics[0].before, 998U);
  EXPECT_EQ(survey.topics[0].missing, 3U);
  EXPECT_EQ(survey.topics[1].before, 56U);
  EXPECT_EQ(survey.topics[1].missing, 0U);
  ASSERT_EQ(survey.late.size(), 2U);
  EXPECT_EQ(survey.late[0].who, "00000000000000b1");
  EXPECT_EQ(survey.late[0].first_sequence, 10U);
  EXPECT_EQ(survey.late[1].who, "00000000000000a1 to 00000000000000b1");
  EXPECT_EQ(survey.late[1].first_sequence, 57U);
}

TEST(Survey, TellsWhatProcessesCalledThemselves) {
  const test::TempFile file(".db3");
  const wire::TopicNames names("prefix");
  auto writer =
      RecordingWriter::create(file.path(), {1, 0, wire::kWireVersion, "prefix", "idl"}).value();
  const auto append = [&]<class Message>(const Message& message) {
    const std::uint32_t topic = writer->add_topic({names.of<Message>(), "type"}).value();
    const std::uint32_t by = writer->add_writer({topic, {}, ""}).value();
    EXPECT_TRUE(writer->append({.writer = by, .cdr = wire::encode_payload(message)}).is_ok());
  };
  append(wire::Hello{.publisher = 0xa1, .name = "terrain server"});
  append(wire::Hello{.publisher = 0xa2});
  for (const auto& [session, name] : {std::pair{0xb1, "cockpit"}, std::pair{0xb2, ""}}) {
    wire::ProcessStatus status;
    status.session = static_cast<wire::SessionId>(session);
    status.name = name;
    status.host = "rig";
    append(status);
  }
  ASSERT_TRUE(writer->close().is_ok());
  const auto recording = RecordingReader::open(file.path()).value();
  const auto found = subscriber::survey(*recording);
  ASSERT_TRUE(found.is_ok()) << found.status().message();
  EXPECT_EQ(found.value().names,
            (std::map<wire::SessionId, std::string>{{0xa1, "terrain server"}, {0xb1, "cockpit"}}));
}

}  // namespace
}  // namespace nearmesh
