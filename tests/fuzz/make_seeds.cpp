// SPDX-License-Identifier: Apache-2.0
// Writes the binary seeds. Usage: fuzz_make_seeds FOLDER (tests/fuzz/seeds). The text seeds of
// import_mesh are by hand. To be run again, and its files checked in, when a format or a target's
// reading of its bytes changes.

#include <filesystem>
#include <fstream>
#include <limits>

#include "core/recording/mcap_recording.hpp"
#include "fuzz_models.hpp"
#include "idl/dds/codec.hpp"
#include "idl/dds/type_support.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#include "tests/support/rtps_message.hpp"
#include "tests/unit/idl/dds/samples.hpp"

using namespace nearmesh;

namespace {

using Bytes = std::vector<std::uint8_t>;
std::filesystem::path root;

void write(const std::string& name, std::uint8_t first, const Bytes& rest) {
  const std::filesystem::path path = root / name;
  std::filesystem::create_directories(path.parent_path());
  std::ofstream out(path, std::ios::binary);
  out.put(static_cast<char>(first));
  out.write(reinterpret_cast<const char*>(rest.data()), static_cast<std::streamsize>(rest.size()));
  FUZZ_CHECK(out.good());
}

Bytes random_bytes(std::uint64_t seed, std::size_t count) {
  Random random(seed);
  Bytes bytes(count);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.below(256));
  return bytes;
}

template <class Type, class Message>
void write_sample(const std::string& name, std::uint8_t choice, const Message& message) {
  Type type;
  typename Type::Data data;
  wire::encode(message, data);
  Bytes cdr = wire::to_cdr(type, data);
  FUZZ_CHECK(!cdr.empty());
  write("wire/" + name, choice, std::move(cdr));
}

void write_model_file_seeds() {
  const fuzz::FullModel face =
      fuzz::make_model({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}, 8);
  const fuzz::FullModel& soup = fuzz::models().back();
  for (const auto& [name, model] : {std::pair("one_face", &face), std::pair("soup", &soup)}) {
    const std::filesystem::path path = root / "model_file.spm";
    const BakedModel& baked = model->baked;
    FUZZ_CHECK(write_model_file(baked.header, baked.store, baked.numbers, path.string()).is_ok());
    std::ifstream in(path, std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    std::filesystem::remove(path);
    write("model_file/" + std::string(name) + ".spm", 1, {text.begin(), text.end()});
    write("model_file/" + std::string(name) + ".header", 3, encode_header(baked.header));
  }
  write("model_file/unchanged", 2, {});
  for (std::uint64_t seed = 0; seed < 4; ++seed)
    write("model_file/changed_" + std::to_string(seed), 2, random_bytes(seed, 6));
}

/// The header is the target's.
void write_rtps(const std::string& name, const test::Rtps& message) {
  write("rtps/" + name, 1, {message.bytes.begin() + 20, message.bytes.end()});
}

void write_rtps_seeds() {
  const auto message = [] { return test::Rtps({1, 15, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1}); };
  const test::Rtps::Key other = test::key_of(2);
  write("rtps/deadly", 0, test::deadly_packet());
  write_rtps("announcement", message().timestamp().announcement().statistics());
  write_rtps("token", message()
                          .begin_announcement()
                          .begin_parameter(0x1001)
                          .text("DDS:Auth:PKI-DH:1.0")
                          .u32(1)
                          .text("dds.cert.sn")
                          .text("x")
                          .u32(1)
                          .text("c.id")
                          .u32(4)
                          .u32(7)
                          .end_parameter()
                          .finish_announcement());
  write_rtps("farewell", message().farewell());
  write_rtps("repair", message().to(other).heartbeat(1, 9).ack_nack(4, 33).gap(3, 5, 8));
  write_rtps("data", message()
                         .begin_data(0, 0x103, 1, 6)
                         .begin_parameter(0x70)
                         .guid(0x103)
                         .end_parameter()
                         .sentinel()
                         .encapsulation(1)
                         .u32(7)
                         .end());
  write_rtps("fragment", message().fragments(1, 1, 8, 20, 8));
  write_rtps("fragments_of_other_sizes",
             message().fragments(1, 2, 100, 350, 200).fragments(3, 1, 99, 201, 3));
  write_rtps("fragments_too_short", message().fragments(1, 2, 3, 9, 6));
  write_rtps("fragments_of_a_key", message().fragments(1, 1, 8, 20, 8, 0x103, 4));
  write_rtps("types", message()
                          .announcement()
                          .begin_endpoint(true, "topic", "type")
                          .malformed_type()
                          .finish_announcement());
  write_rtps("long_gap", message().gap(5, 1 << 20, 8));
  write_rtps("far_heartbeat", message().heartbeat(1 << 30, 1 << 30));
  write_rtps("speakers", message().announcement().speaker(other).announcement());
  write_rtps("handshake", message()
                              .begin_data(0x000201c4, test::kHandshakeWriter, 1, 4)
                              .encapsulation(1)
                              .zeros(2 * 24 + 3 * 16)
                              .text("dds.sec.auth")
                              .u32(1)
                              .text("DDS:Auth")
                              .u32(0)
                              .u32(1)
                              .text("c.id")
                              .u32(4)
                              .u32(9)
                              .end());
}

void write_batch_seeds() {
  const fuzz::FullModel& model = fuzz::models().front();
  ActiveMesh mesh(model.store());
  RefineDelta delta;
  for (const VertexId u : global_order(model.store(), 20)) FUZZ_CHECK(mesh.split(u, delta));
  const Treelet treelet = active_treelet(mesh);
  std::vector<NodeHalfSpace> half_spaces;
  for (const TreeletSplit& split : treelet) {
    const NodeSpan right = split.node.right_of(split.split);
    if (right.size > 1 && !split.right_included)
      half_spaces.push_back({right, {static_cast<std::uint16_t>(right.begin()), 200}});
  }
  std::sort(half_spaces.begin(), half_spaces.end());
  for (const int flags : {0, 1, int{kWithHalfSpaces}}) {
    const BoxPolicy policy = flags == 1 ? BoxPolicy::kAllNodes : BoxPolicy::kCutNodes;
    Bytes program;
    for (const Bytes& batch :
         encode_batches(model.header(), model.store(), treelet, policy, 100,
                        flags == kWithHalfSpaces ? half_spaces : std::vector<NodeHalfSpace>())) {
      FUZZ_CHECK(batch.size() < 256);
      program.insert(program.end(), {0, static_cast<std::uint8_t>(batch.size())});
      program.insert(program.end(), batch.begin(), batch.end());
      program.insert(program.end(), {3, 1});
    }
    write("batch/raw_" + std::to_string(flags), 0, program);
  }
}

/// A recording in an MCAP file, without checksums: a changed byte shall come further than to them.
void write_recording() {
  const std::filesystem::path folder = root / "recording";
  std::filesystem::create_directories(folder);
  const std::string recorded = (folder / "s.db3").string(), packed = (folder / "s.mcap").string();
  {
    const auto writer =
        RecordingWriter::create(recorded, {0xab, 0, 9, "near", "module m {};"}).value();
    FUZZ_CHECK(writer->add_topic({"near/a", "m::A"}).is_ok());
    FUZZ_CHECK(writer->add_topic({"near/b", "m::B"}).is_ok());
    for (std::uint8_t i = 0; i < 2; ++i)
      FUZZ_CHECK(writer->add_writer({i, EndpointGuid{i}, i == 0 ? "" : "peer"}).is_ok());
    for (std::uint32_t i = 0; i < 6; ++i)
      FUZZ_CHECK(
          writer
              ->append({i % 2, i, 10 * i, 10 * i, random_bytes(i, 5 * i)}, i % 3 == 0 ? "key" : "")
              .is_ok());
    FUZZ_CHECK(writer->add_gap({1, 2, 3, 4}).is_ok());
    FUZZ_CHECK(writer->add_model({{1, 2}, "hull", 1}).is_ok());
    FUZZ_CHECK(writer->close().is_ok());
  }
  {
    const auto reader = RecordingReader::open(recorded).value();
    const auto file = mcap::Writer::create(packed, "seed").value();
    const auto channels = begin_mcap_recording(*reader, *file).value();
    FUZZ_CHECK(
        reader
            ->read(1, reader->message_count() + 1,
                   [&](std::int64_t, const RecordedMessage& m) {
                     return file->append({.channel = channels[m.writer], .data = m.cdr}).is_ok();
                   })
            .is_ok());
    FUZZ_CHECK(file->close().is_ok());
  }
  std::ifstream in(packed, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  constexpr std::size_t kMagic = 8, kHead = 9, kBeforeSum = 24;
  constexpr char kChunk = 6, kAttachment = 9, kDataEnd = 15;
  for (std::size_t at = kMagic; bytes.at(at) != kDataEnd;) {
    std::uint64_t length = 0;
    std::memcpy(&length, &bytes.at(at + 1), sizeof length);
    if (bytes[at] == kChunk) bytes.replace(at + kHead + kBeforeSum, 4, 4, '\0');
    if (bytes[at] == kAttachment) bytes.replace(at + kHead + length - 4, 4, 4, '\0');
    at += kHead + length;
  }
  std::ofstream(folder / "whole", std::ios::binary) << bytes;
  std::filesystem::remove(recorded);
  std::filesystem::remove(packed);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 1;
  root = argv[1];
  write_model_file_seeds();
  write_batch_seeds();
  write_rtps_seeds();
  write_recording();
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const auto name = "/program_" + std::to_string(seed);
    write("batch" + name, static_cast<std::uint8_t>(seed), random_bytes(10 + seed, 60));
    write("session" + name, static_cast<std::uint8_t>(seed * 41), random_bytes(20 + seed, 60));
    write("predicates" + name, static_cast<std::uint8_t>(seed), random_bytes(30 + seed, 90));
  }
  // Two quarter turns and their grids, then corners near each other.
  write("predicates/touching", 1,
        {0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 6, 1, 0, 0,
         0, 0, 0, 0, 0, 6, 1, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 9, 8, 7, 3, 1, 2, 9, 9, 9});
  using namespace wire;
  write_sample<TypeOf<Hello>>("hello", 0, wire::test::valid_hello());
  write_sample<TypeOf<MeshHeader>>("mesh_header", 1, wire::test::valid_header());
  write_sample<TypeOf<RegionSubscription>>("region_subscription", 2,
                                           wire::test::valid_subscription());
  write_sample<TypeOf<RegionSubscription>>("certificate_subscription", 2,
                                           wire::test::valid_certificate_subscription());
  write_sample<TypeOf<SplitBatchMessage>>("split_batch", 3, wire::test::valid_batch());
  write_sample<TypeOf<SplitBatchMessage>>("joined_batches", 3, wire::test::valid_joined_batches());
  write_sample<TypeOf<BodyPoses>>("body_poses", 4, wire::test::valid_poses());
  write_sample<TypeOf<ContactReport>>("contact_report", 5, wire::test::valid_report());
  write_sample<TypeOf<ProcessStatus>>("process_status", 6, wire::test::valid_status());
  write_sample<TypeOf<Echo>>("echo", 7, wire::test::valid_echo());
  write_sample<TypeOf<HeldDetail>>("held_detail", 8, wire::test::valid_held());
  BodyPoses skewed = wire::test::valid_poses();
  skewed.bodies[0].motion.pose.rotation[1] = 0.5;
  write_sample<TypeOf<BodyPoses>>("refused_body_poses", 4, skewed);
  write_sample<TypeOf<BodyDirectory>>("body_directory", 9, wire::test::valid_directory());
  write_sample<TypeOf<WatchedBodies>>("watched_bodies", 10, wire::test::valid_watched());
  WatchedBodies twice = wire::test::valid_watched();
  twice.runs[1].mover = twice.runs[0].mover;
  twice.runs[1].first = twice.runs[0].first;
  write_sample<TypeOf<WatchedBodies>>("refused_watched_bodies", 10, twice);
  WatchedBodies too_many = wire::test::valid_watched();
  too_many.runs[0].count = 0xffffffffU;
  write_sample<TypeOf<WatchedBodies>>("uncounted_watched_bodies", 10, too_many);
  write_sample<TypeOf<BoundsReport>>("bounds_report", 11, wire::test::valid_bounds());
  BoundsReport empty = wire::test::valid_bounds();
  empty.pairs = 0;
  write_sample<TypeOf<BoundsReport>>("refused_bounds_report", 11, empty);
  write_sample<TypeOf<BodyPromises>>("body_promises", 12, wire::test::valid_promises());
  BodyPromises late = wire::test::valid_promises();
  late.from_s = std::numeric_limits<double>::quiet_NaN();
  write_sample<TypeOf<BodyPromises>>("refused_body_promises", 12, late);
  write_sample<TypeOf<WantedPoses>>("wanted_poses", 13, wire::test::valid_wanted());
}
