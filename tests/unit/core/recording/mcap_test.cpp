// SPDX-License-Identifier: Apache-2.0
// Recordings in MCAP files: what goes in comes out, and damaged files are refused.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>

#include "core/base/random.hpp"
#include "core/recording/mcap_recording.hpp"
#include "tests/support/folder.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;

/// Everything that a reader tells.
struct Told {
  RecordingFacts facts;
  std::vector<std::pair<std::string, std::string>> topics;
  std::vector<std::tuple<std::uint32_t, EndpointGuid, std::string>> writers;
  std::vector<std::tuple<std::uint32_t, std::uint64_t, std::uint64_t, std::int64_t>> gaps;
  std::vector<std::tuple<ContentHash, std::string, std::int64_t>> models;
  std::map<std::pair<std::uint32_t, std::string>, std::vector<std::int64_t>> keys;
  std::vector<std::tuple<std::uint32_t, std::uint64_t, std::int64_t, std::int64_t,
                         std::vector<std::uint8_t>>>
      messages;
};

Told told_by(RecordingReader& reader) {
  Told told{.facts = reader.facts()};
  for (const RecordedTopic& t : reader.topics()) told.topics.emplace_back(t.name, t.type);
  for (const RecordedWriter& w : reader.writers())
    told.writers.emplace_back(w.topic, w.guid, w.partition);
  for (const RecordingGap& g : reader.gaps())
    told.gaps.emplace_back(g.writer, g.first_sequence, g.count, g.noticed_ns);
  for (const RecordedModel& m : reader.models())
    told.models.emplace_back(m.content_hash, m.name, m.message);
  for (std::uint32_t i = 0; i < reader.keys().size(); ++i)
    told.keys[{reader.keys()[i].writer, reader.keys()[i].name}] = reader.ids_of(i).value();
  EXPECT_TRUE(reader
                  .read(1, reader.message_count() + 1,
                        [&](std::int64_t id, const RecordedMessage& m) {
                          EXPECT_EQ(id, static_cast<std::int64_t>(told.messages.size()) + 1);
                          told.messages.emplace_back(m.writer, m.sequence, m.received_ns,
                                                     m.source_ns, m.cdr);
                          return true;
                        })
                  .is_ok());
  return told;
}

class McapRecording : public ::testing::Test {
 protected:
  [[nodiscard]] std::string path(const std::string& name) const {
    return (folder_ / name).string();
  }

  /// Two parts; sequences that leap, also over 2^32; messages with keys and without.
  void record(int messages) const {
    Random random(7);
    for (std::uint32_t part = 0; part < 2; ++part) {
      const auto writer =
          RecordingWriter::create(part_path(path("s.db3"), part),
                                  {0xfedcba9876543210, part, 9, "near/mesh", "module m { };\n"})
              .value();
      ASSERT_TRUE(writer->add_topic({"near/mesh/b", "m::B"}).is_ok());
      ASSERT_TRUE(writer->add_topic({"near/mesh/a", "m::A"}).is_ok());
      for (std::uint8_t w = 0; w < 3; ++w)
        ASSERT_TRUE(
            writer->add_writer({w % 2U, EndpointGuid{w, 255, 7}, w == 0 ? "" : "peer"}).is_ok());
      std::uint64_t sequence = 0xfffffff0U + (std::uint64_t{part} << 40);
      for (int i = 0; i < messages; ++i) {
        sequence += random.below(100);
        RecordedMessage message{.writer = static_cast<std::uint32_t>(random.below(3)),
                                .sequence = sequence,
                                .received_ns = 1'700'000'000'000'000'000 + i,
                                .source_ns = 1'699'999'999'000'000'000 - i};
        message.cdr.resize(random.below(3000));
        for (std::uint8_t& byte : message.cdr) byte = static_cast<std::uint8_t>(random.below(256));
        const std::string key = i % 3 == 0 ? std::string() : "body " + std::to_string(i % 7);
        ASSERT_TRUE(writer->append(message, key).is_ok());
      }
      ASSERT_TRUE(writer->add_gap({1, 5, 6, 77}).is_ok());
      ASSERT_TRUE(writer->add_model({{1, part + 1}, "hull", 1}).is_ok());
      ASSERT_TRUE(writer->close().is_ok());
    }
  }
  void pack(const std::string& to) const {
    const auto reader = RecordingReader::open(path("s.db3")).value();
    const auto file = mcap::Writer::create(path(to), "test").value();
    const auto channels = begin_mcap_recording(*reader, *file).value();
    const auto foreign = file->add_channel({.topic = "/tf", .message_encoding = "cdr"}).value();
    ASSERT_TRUE(reader
                    ->read(1, reader->message_count() + 1,
                           [&](std::int64_t, const RecordedMessage& m) {
                             const std::uint8_t other[]{1, 2, 3};
                             EXPECT_TRUE(file->append({.channel = foreign, .data = other}).is_ok());
                             return file
                                 ->append({channels[m.writer],
                                           static_cast<std::uint32_t>(m.sequence),
                                           static_cast<std::uint64_t>(m.received_ns),
                                           static_cast<std::uint64_t>(m.source_ns), m.cdr})
                                 .is_ok();
                           })
                    .is_ok());
    ASSERT_TRUE(file->close().is_ok());
  }
  [[nodiscard]] std::string bytes_of(const std::string& name) const {
    std::ifstream in(path(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(path(name), std::ios::binary) << bytes;
  }

  const test::Folder scratch_;
  const fs::path folder_ = scratch_.path();
};

TEST_F(McapRecording, WhatGoesInComesOut) {
  record(1500);  // several chunks
  pack("s.mcap");
  const auto before = RecordingReader::open(path("s.db3")).value();
  const auto after = RecordingReader::open(path("s.mcap")).value();
  const Told was = told_by(*before), is = told_by(*after);
  EXPECT_EQ(is.facts.session, was.facts.session);
  EXPECT_EQ(is.facts.part, 0U);
  EXPECT_EQ(is.facts.wire_version, was.facts.wire_version);
  EXPECT_EQ(is.facts.prefix, was.facts.prefix);
  EXPECT_EQ(is.facts.idl, was.facts.idl);
  EXPECT_EQ(is.topics, was.topics);
  EXPECT_EQ(is.writers, was.writers);
  EXPECT_EQ(is.gaps, was.gaps);
  EXPECT_EQ(is.models, was.models);
  EXPECT_EQ(is.keys, was.keys);
  EXPECT_EQ(was.messages.size(), 3000U);
  EXPECT_EQ(is.messages, was.messages);
}

TEST_F(McapRecording, LeavesNoTemporaryFiles) {
  record(10);
  pack("s.mcap");
  ::setenv("TMPDIR", folder_.c_str(), 1);
  const std::size_t before = static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  {
    const auto reader = RecordingReader::open(path("s.mcap"));
    EXPECT_TRUE(reader.is_ok());
    write("cut.mcap", bytes_of("s.mcap").substr(0, 3000));
    EXPECT_FALSE(RecordingReader::open(path("cut.mcap")).is_ok());
  }
  ::unsetenv("TMPDIR");
  EXPECT_EQ(static_cast<std::size_t>(
                std::distance(fs::directory_iterator(folder_), fs::directory_iterator())),
            before + 1);
}

TEST_F(McapRecording, AFileThatIsCutIsRefused) {
  record(3);
  pack("s.mcap");
  const std::string whole = bytes_of("s.mcap");
  std::size_t refused = 0;
  for (std::size_t size = 8; size + 1 < whole.size(); size += 151) {
    write("cut.mcap", whole.substr(0, size));
    const auto opened = RecordingReader::open(path("cut.mcap"));
    // What follows the data is not needed.
    if (opened.is_ok()) continue;
    ++refused;
    EXPECT_EQ(opened.status().code(), StatusCode::kCorrupt) << size;
    EXPECT_NE(opened.status().message().find("cut.mcap"), std::string::npos);
  }
  EXPECT_GT(refused, whole.size() / 151 / 2);
}

TEST_F(McapRecording, AChangedByteIsNoticedOrChangesNothing) {
  record(4);
  pack("s.mcap");
  const Told was = told_by(*RecordingReader::open(path("s.db3")).value());
  std::string bytes = bytes_of("s.mcap");
  std::size_t noticed = 0;
  // From behind the metadata, which have no checksum in this format, to the end of the chunk of
  // messages.
  const std::size_t begin = bytes.find("nearmesh tables");
  const std::size_t end = std::min(bytes.size(), begin + 6'000);
  for (std::size_t at = begin; at < end; at += 97) {
    bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
    write("changed.mcap", bytes);
    bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
    const auto opened = RecordingReader::open(path("changed.mcap"));
    if (!opened.is_ok()) {
      ++noticed;
      continue;
    }
    EXPECT_EQ(told_by(*opened.value()).messages, was.messages) << at;
  }
  EXPECT_GT(noticed, 30U);
}

TEST_F(McapRecording, FilesOfOthersAreRefusedWithAReason) {
  const auto file = mcap::Writer::create(path("theirs.mcap"), "test").value();
  const auto channel = file->add_channel({.topic = "/tf", .message_encoding = "cdr"}).value();
  ASSERT_TRUE(file->append({.channel = channel}).is_ok());
  ASSERT_TRUE(file->close().is_ok());
  const auto opened = RecordingReader::open(path("theirs.mcap"));
  EXPECT_EQ(opened.status().code(), StatusCode::kCorrupt);
  EXPECT_NE(opened.status().message().find("no recorded session"), std::string::npos);

  std::string bytes = bytes_of("theirs.mcap");
  // The chunk: kind, length, times, sizes and checksum, then the length of the compression's name.
  const std::size_t chunk = bytes.find('\x06', 8 + 9 + 8 + 4);
  const std::size_t compression = chunk + 9 + 24 + 4;
  ASSERT_EQ(bytes.substr(compression, 4), std::string(4, '\0'));
  bytes.replace(compression, 4, std::string("\x03\0\0\0lz4", 7));
  const auto length = static_cast<unsigned char>(bytes[chunk + 1]) + 3;
  ASSERT_LT(length, 256);
  bytes[chunk + 1] = static_cast<char>(length);
  write("packed.mcap", bytes);
  const auto packed = RecordingReader::open(path("packed.mcap"));
  EXPECT_EQ(packed.status().code(), StatusCode::kUnsupported) << packed.status().message();
  EXPECT_NE(packed.status().message().find("lz4"), std::string::npos);
}

TEST_F(McapRecording, TheWriterTakesNoFileOfAnotherKind) {
  write("mesh.mcap", "ply\n");
  EXPECT_EQ(mcap::Writer::create(path("mesh.mcap"), "test").status().code(), StatusCode::kConflict);
  EXPECT_EQ(bytes_of("mesh.mcap"), "ply\n");
}

}  // namespace
}  // namespace nearmesh
