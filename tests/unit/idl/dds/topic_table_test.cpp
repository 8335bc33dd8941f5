// SPDX-License-Identifier: Apache-2.0
// The table of topics, walked: what one entry says holds everywhere.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "idl/dds/qos.hpp"
#include "idl/dds/type_support.hpp"
#include "idl/security/security_documents.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "samples.hpp"
#include "tests/support/test_models.hpp"

namespace nearmesh::wire {
namespace {

using test::valid;
const std::string kPrefix = "site/x";

TEST(TopicTable, NamesAreUniqueAndTypesAreTheGeneratedOnes) {
  std::set<std::string_view> names;
  for_each_topic([&]<class Message>(const Topic<Message>& topic) {
    EXPECT_TRUE(names.insert(topic.name).second) << topic.name;
    EXPECT_EQ(fdds::TypeSupport(new TypeOf<Message>).get_type_name(), topic.type);
    EXPECT_EQ(&topic, &topic_of<Message>()) << topic.name;
    EXPECT_EQ(TopicNames(kPrefix).find(TopicNames(kPrefix).of<Message>()), place_of<Message>());
  });
  EXPECT_EQ(names.size(), kTopicCount);
}

TEST(TopicTable, EveryTopicHasACodecWhoseMessagesPassTheirCheck) {
  for_each_topic([]<class Message>(const Topic<Message>& topic) {
    const Message sent = valid<Message>();
    ASSERT_TRUE(check(sent).is_ok()) << topic.name;
    const std::vector<std::uint8_t> cdr = encode_payload(sent);
    const Result<Message> came = decode_payload<Message>(cdr);
    ASSERT_TRUE(came.is_ok()) << topic.name << ": " << came.status().message();
    EXPECT_TRUE(check(came.value()).is_ok()) << topic.name;
    EXPECT_EQ(encode_payload(came.value()), cdr) << topic.name;
    Message other = sent;
    ++other.wire_version;
    EXPECT_FALSE(decode_payload<Message>(encode_payload(other)).is_ok()) << topic.name;
  });
}

TEST(TopicTable, EndpointsOfATopicPromiseWhatTheTableSays) {
  for_each_topic([](const auto& topic) {
    const fdds::DataReaderQos reader = reader_qos(topic.delivery);
    const fdds::DataWriterQos writer = writer_qos(topic.delivery, 0.1);
    EXPECT_EQ(reader.reliability().kind, reliability_of(topic.delivery)) << topic.name;
    EXPECT_EQ(writer.reliability().kind, reliability_of(topic.delivery)) << topic.name;
    EXPECT_EQ(reader.durability().kind, durability_of(topic.delivery)) << topic.name;
    EXPECT_EQ(writer.durability().kind, durability_of(topic.delivery)) << topic.name;
    EXPECT_EQ(writer.history().depth, topic.delivery.depth) << topic.name;
    EXPECT_EQ(writer.publish_mode().kind == fdds::ASYNCHRONOUS_PUBLISH_MODE,
              topic.delivery.is_paced)
        << topic.name;
  });
}

TEST(TopicTable, SecurityDocumentsGrantWhatTheTableSaysAndNothingElse) {
  SecurityPlan plan;
  plan.prefix = kPrefix;
  const TopicNames names(kPrefix, "*");
  for (const Role role : {Role::kPublisher, Role::kSubscriber, Role::kRecorder}) {
    const std::string text = permissions_text(plan, {"name", role}, 1'700'000'000);
    for (TopicPlace place = 0; place < kTopicCount; ++place) {
      const TopicFacts& topic = kTopicFacts[place];
      const auto grants = [&](const std::string& what) {
        const std::string named = "<topic>" + names.at(place) + "</topic>";
        for (std::size_t at = text.find("<" + what + ">"); at != std::string::npos;
             at = text.find("<" + what + ">", at + 1))
          if (text.substr(at, text.find("</" + what + ">", at) - at).find(named) !=
              std::string::npos)
            return true;
        return false;
      };
      EXPECT_EQ(grants("publish"), topic.writers.has(role)) << topic.name << to_string(role);
      EXPECT_EQ(grants("subscribe"), topic.readers.has(role) || topic.listeners.has(role))
          << topic.name << to_string(role);
      EXPECT_FALSE(topic.readers.has(role) && topic.listeners.has(role)) << topic.name;
      // Who records a topic may hear it.
      EXPECT_TRUE(role != Role::kRecorder || !topic.is_recorded || grants("subscribe"))
          << topic.name;
    }
  }
  const std::string governance = governance_text(0, kPrefix);
  for (TopicPlace place = 0; place < kTopicCount; ++place)
    EXPECT_EQ(governance.find("<topic_expression>" + names.at(place) + "</topic_expression>") !=
                  std::string::npos,
              kTopicFacts[place].signs_for_each)
        << names.at(place);
  EXPECT_EQ(judge_governance(governance, 0, kPrefix), "");
}

TEST(TopicTable, RecordedTopicsAreFoundAgainUnderTheirKeys) {
  const nearmesh::test::TempFile file(".db3");
  auto writer = RecordingWriter::create(file.path(), {1, 0, kWireVersion, kPrefix, "idl"}).value();
  const TopicNames names(kPrefix);
  std::size_t recorded = 0;
  for_each_topic([&]<class Message>(const Topic<Message>& topic) {
    const std::vector<std::string> all = recorded_topics();
    EXPECT_EQ(std::find(all.begin(), all.end(), topic.name) != all.end(), topic.is_recorded);
    if (!topic.is_recorded) return;
    ++recorded;
    const std::vector<std::uint8_t> cdr = encode_payload(valid<Message>());
    const std::string key = record_key(place_of<Message>(), cdr);
    EXPECT_EQ(key, topic.key == nullptr ? "" : topic.key(valid<Message>())) << topic.name;
    EXPECT_EQ(record_key(place_of<Message>(), {cdr.data(), 5}), "") << topic.name;
    const std::uint32_t at =
        writer->add_topic({names.of<Message>(), std::string(topic.type)}).value();
    const std::uint32_t by = writer->add_writer({at, {}, ""}).value();
    EXPECT_TRUE(writer->append({.writer = by, .cdr = cdr}, key).is_ok());
  });
  ASSERT_TRUE(writer->close().is_ok());
  const auto recording = RecordingReader::open(file.path()).value();
  const auto samples = RecordedSamples::of(*recording);
  ASSERT_TRUE(samples.is_ok()) << samples.status().message();
  std::size_t read = 0;
  const auto take = [&](std::int64_t, const RecordedMessage& sample) {
    for_each_topic([&]<class Message>(const Topic<Message>&) {
      const auto message = samples.value().read<Message>(sample);
      EXPECT_EQ(message.has_value(), samples.value().is<Message>(sample));
      if (!message) return;
      ++read;
      EXPECT_EQ(encode_payload(*message), sample.cdr);
    });
    return true;
  };
  ASSERT_TRUE(recording->read(1, recording->message_count() + 1, take).is_ok());
  EXPECT_EQ(read, recorded);
  EXPECT_GE(recorded, 6U);
}

}  // namespace
}  // namespace nearmesh::wire
