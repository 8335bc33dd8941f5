// SPDX-License-Identifier: Apache-2.0
// From message to bytes and back through the very code that Fast DDS calls.
#include "idl/dds/type_support.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "core/spm/packed_region.hpp"
#include "idl/dds/codec.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "samples.hpp"

namespace nearmesh::wire {
namespace {

using namespace test;
using Key = Handle;
using Bytes = std::vector<std::uint8_t>;

template <class Type, class Message>
Bytes to_bytes(const Message& message) {
  Type type;
  typename Type::Data data;
  encode(message, data);
  Bytes bytes = to_cdr(type, data);
  EXPECT_FALSE(bytes.empty());
  return bytes;
}

/// What a reader would make of the bytes.
template <class Type>
auto from_bytes(const Bytes& bytes, std::string* fault = nullptr)
    -> decltype(decode(std::declval<typename Type::Sample>())) {
  Type type;
  void* data = type.make_data();
  Payload payload(static_cast<std::uint32_t>(bytes.size()));
  std::copy(bytes.begin(), bytes.end(), payload.data);
  payload.length = static_cast<std::uint32_t>(bytes.size());
  EXPECT_TRUE(type.read(payload, data));  // a fault is delivered, never swallowed
  auto& sample = static_cast<typename Type::Data&>(*static_cast<typename Type::Sample*>(data));
  const std::string found = sample.fault;
  auto decoded = decode(sample);
  type.delete_made(data);
  if (fault != nullptr) *fault = found;
  if (!found.empty()) return Status{StatusCode::kCorrupt, found};
  return decoded;
}

template <class Type, class Message>
void expect_same_bytes_after_round_trip(const Message& message) {
  const Bytes bytes = to_bytes<Type>(message);
  const auto back = from_bytes<Type>(bytes);
  ASSERT_TRUE(back.is_ok()) << back.status().message();
  EXPECT_EQ((to_bytes<Type>(back.value())), bytes);
}

TEST(TypeSupport, RoundTripKeepsEveryField) {
  for_each_valid([]<class Message>(const Message& message) {
    expect_same_bytes_after_round_trip<TypeOf<Message>>(message);
  });
}

TEST(TypeSupport, RoundTripKeepsValues) {
  const auto subscription = from_bytes<TypeOf<RegionSubscription>>(
      to_bytes<TypeOf<RegionSubscription>>(valid_subscription()));
  ASSERT_TRUE(subscription.is_ok());
  EXPECT_EQ(subscription.value().region.attach, valid_subscription().region.attach);
  EXPECT_EQ(subscription.value().region.region,
            unpack_region(pack_region(valid_subscription().region.region)).value());
  EXPECT_EQ(subscription.value().request, 7U);
  EXPECT_EQ(subscription.value().publisher, 8U);
  EXPECT_EQ(subscription.value().acknowledged_sequence, 17U);
  EXPECT_EQ(subscription.value().priority, 1);
  const auto report =
      from_bytes<TypeOf<ContactReport>>(to_bytes<TypeOf<ContactReport>>(valid_report()));
  ASSERT_TRUE(report.is_ok());
  EXPECT_EQ(report.value().pairs, valid_report().pairs);
  EXPECT_EQ(report.value().body_b, "wall");
  const auto hello = from_bytes<TypeOf<Hello>>(to_bytes<TypeOf<Hello>>(valid_hello()));
  ASSERT_TRUE(hello.is_ok());
  EXPECT_EQ(hello.value().models[1].name, "terrain 512");
  EXPECT_EQ(hello.value().models[1].content_hash, (ContentHash{2, 22}));
  EXPECT_EQ(hello.value().models[1].mesh_bytes, 200U);
  EXPECT_EQ(hello.value().models[1].replaces, (ContentHash{3, 33}));
  EXPECT_EQ(hello.value().models[0].epoch, Epoch{});
  EXPECT_EQ(hello.value().models[1].epoch, (Epoch{4, 120.5}));
  const auto batch =
      from_bytes<TypeOf<SplitBatchMessage>>(to_bytes<TypeOf<SplitBatchMessage>>(valid_batch()));
  ASSERT_TRUE(batch.is_ok());
  EXPECT_TRUE(batch.value().last);
  EXPECT_FALSE(batch.value().refused);
  EXPECT_EQ(batch.value().sequence, 3U);
  const auto poses = from_bytes<TypeOf<BodyPoses>>(to_bytes<TypeOf<BodyPoses>>(valid_poses()));
  ASSERT_TRUE(poses.is_ok()) << poses.status().message();
  ASSERT_EQ(poses.value().bodies.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    const BodyPoses::Body &found = poses.value().bodies[i], sent = valid_poses().bodies[i];
    EXPECT_EQ(found.number, sent.number);
    EXPECT_EQ(found.time_s, sent.time_s);
    EXPECT_EQ(found.motion.pose.rotation, sent.motion.pose.rotation);
    EXPECT_EQ(found.motion.pose.translation_m, sent.motion.pose.translation_m);
    EXPECT_EQ(found.motion.linear_velocity_mps, sent.motion.linear_velocity_mps);
    EXPECT_EQ(found.motion.angular_velocity_radps, sent.motion.angular_velocity_radps);
  }
  const auto directory =
      from_bytes<TypeOf<BodyDirectory>>(to_bytes<TypeOf<BodyDirectory>>(valid_directory()));
  ASSERT_TRUE(directory.is_ok()) << directory.status().message();
  EXPECT_EQ(directory.value().bodies, valid_directory().bodies);
}

TEST(TypeSupport, WatchedBodiesAndBoundsComeAsTheyWere) {
  const WatchedBodies sent = valid_watched();
  const auto came = from_bytes<TypeOf<WatchedBodies>>(to_bytes<TypeOf<WatchedBodies>>(sent));
  ASSERT_TRUE(came.is_ok()) << came.status().message();
  const WatchedBodies& found = came.value();
  EXPECT_EQ(std::tuple(found.peer, found.part, found.edition, found.horizon_s, found.margin_m),
            std::tuple(sent.peer, sent.part, sent.edition, sent.horizon_s, sent.margin_m));
  EXPECT_EQ(found.runs, sent.runs);
  EXPECT_TRUE(found.only_own);
  ASSERT_EQ(found.placed.size(), sent.placed.size());
  for (std::size_t i = 0; i < sent.placed.size(); ++i) {
    const WatchedBodies::Placed &one = found.placed[i], &other = sent.placed[i];
    EXPECT_EQ(std::tuple(one.name, one.content, one.group, one.mask, one.own),
              std::tuple(other.name, other.content, other.group, other.mask, other.own));
    EXPECT_EQ(one.pose.rotation, other.pose.rotation);
    EXPECT_EQ(one.pose.translation_m, other.pose.translation_m);
  }
  const BoundsReport said = valid_bounds();
  const auto bounds = from_bytes<TypeOf<BoundsReport>>(to_bytes<TypeOf<BoundsReport>>(said));
  ASSERT_TRUE(bounds.is_ok()) << bounds.status().message();
  const auto all_of = [](const BoundsReport& m) {
    return std::tuple(m.peer, m.edition, m.frame, m.time_s, m.places_digest, m.pairs, m.clearance_m,
                      m.horizon_s, m.rests_on_more, m.heard);
  };
  EXPECT_EQ(all_of(bounds.value()), all_of(said));
  const BodyPoses poses = valid_poses();
  EXPECT_EQ(from_bytes<TypeOf<BodyPoses>>(to_bytes<TypeOf<BodyPoses>>(poses)).value().sequence,
            poses.sequence);
}

TEST(TypeSupport, PosesThatDoNotAddUpAreRefused) {
  wire_types::BodyPosesSample sample;
  const auto refusal = [&] { return decode(sample).status().message(); };
  encode(valid_poses(), sample);
  EXPECT_EQ(refusal(), "");
  sample.places(0x82);
  EXPECT_EQ(refusal(), "places: found unknown bits, 130");
  sample.places(0x40);
  EXPECT_EQ(refusal(), "motions: 38 numbers of 1 bodies");
  encode(valid_poses(), sample);
  sample.part(0xffffffff);
  EXPECT_EQ(refusal(), "part: expected at most 16777216, found 4294967295");
}

TEST(TypeSupport, DirectoriesThatDoNotAddUpAreRefused) {
  wire_types::BodyDirectorySample sample;
  const auto refusal_after = [&](const auto& change) {
    encode(valid_directory(), sample);
    change();
    return decode(sample).status().message();
  };
  EXPECT_EQ(refusal_after([] {}), "");
  EXPECT_EQ(refusal_after([&] { sample.solids(2); }), "solids: found 2");
  EXPECT_EQ(refusal_after([&] { sample.places(0xff); }), "places: found unknown bits, 255");
  EXPECT_EQ(
      refusal_after([&] { sample.places(1); }),
      "bodies: 1 places, 4 words of contents, 4 of groups and masks, 2 speeds, 0 words of links, "
      "26 bytes of names");
  EXPECT_EQ(
      refusal_after([&] { sample.companies().pop_back(); }),
      "bodies: 2 places, 4 words of contents, 3 of groups and masks, 2 speeds, 0 words of links, "
      "26 bytes of names");
  EXPECT_EQ(refusal_after([&] { sample.names().pop_back(); }),
            "names of bodies: fewer whole ones than 4");
  EXPECT_EQ(refusal_after([&] { sample.names()[0] = 0x07; }),
            "body: expected 1 to 63 bytes of printable ASCII, found byte 0x07 at place 1");
}

TEST(TypeSupport, PromisesKeepTheirPlaces) {
  const auto promises =
      from_bytes<TypeOf<BodyPromises>>(to_bytes<TypeOf<BodyPromises>>(valid_promises()));
  ASSERT_TRUE(promises.is_ok()) << promises.status().message();
  EXPECT_EQ(promises.value().bodies, valid_promises().bodies);
  EXPECT_EQ(promises.value().quantum, valid_promises().quantum);
  EXPECT_EQ(promises.value().until_s(), 9.5);
  const auto wanted =
      from_bytes<TypeOf<WantedPoses>>(to_bytes<TypeOf<WantedPoses>>(valid_wanted()));
  ASSERT_TRUE(wanted.is_ok()) << wanted.status().message();
  EXPECT_EQ(wanted.value().parts, valid_wanted().parts);
}

TEST(TypeSupport, PromisesThatDoNotAddUpAreRefused) {
  wire_types::BodyPromisesSample sample;
  const auto refusal_after = [&](const auto& change) {
    encode(valid_promises(), sample);
    change();
    return decode(sample).status().message();
  };
  EXPECT_EQ(refusal_after([] {}), "");
  const std::string short_of = "promises: bytes that end too soon, or a number of too many";
  encode(valid_promises(), sample);
  const std::size_t whole = sample.bytes().size();
  for (std::size_t size = 0; size < whole; ++size)
    EXPECT_EQ(refusal_after([&] { sample.bytes().resize(size); }), short_of) << size;
  EXPECT_EQ(refusal_after([&] { sample.bytes().push_back(0); }), "promises: 1 bytes too many");
  EXPECT_EQ(refusal_after([&] { sample.places(sample.places() | 2); }), short_of);
  EXPECT_EQ(refusal_after([&] { sample.bytes().assign(9, 0x80); }), short_of);
  EXPECT_EQ(refusal_after([&] {
              sample.places(1);
              sample.bytes() = {0x80, 0x00, 0, 0};  // a longer way to say 0
            }),
            short_of);
  EXPECT_EQ(refusal_after([&] {
              sample.places(1);
              sample.bytes() = {0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f, 0, 0};
            }),
            "promises: a place that is too far");
  EXPECT_EQ(refusal_after([&] { sample.quantum(255); }),
            "promises of peer 000000000000002a: quantum of 2^127 m");
}

TEST(TypeSupport, OverheadIsAsDocumented) {
  BodyPromises promises{.peer = 1, .steps = 2048, .quantum = 4};
  for (std::uint32_t i = 0; i < kBodiesPerPromise; ++i)
    promises.bodies.push_back({i, {i % 2 == 0 ? 3000 : -3000, 3000, 60}});
  EXPECT_LE(to_bytes<TypeOf<BodyPromises>>(promises).size(), 48 + kBodiesPerPromise * 4U);
  for (BodyPromises::Body& body : promises.bodies)
    for (std::int64_t& quanta : body.place)
      quanta = body.number % 2 == 0 ? test::kFarQuanta : -test::kFarQuanta;
  promises.quantum = -3;
  EXPECT_LE(to_bytes<TypeOf<BodyPromises>>(promises).size(), 48 + 768U);
  SplitBatchMessage batch = valid_batch();
  batch.bytes.resize(kMaxSealedBytes);
  EXPECT_EQ(to_bytes<TypeOf<SplitBatchMessage>>(batch).size(), kMaxSealedBytes + 44);
  BodyPoses poses = valid_poses();
  poses.bodies.resize(kBodiesPerPart);
  for (std::uint32_t i = 0; i < kBodiesPerPart; ++i) poses.bodies[i].number = 21 + i;
  EXPECT_EQ(to_bytes<TypeOf<BodyPoses>>(poses).size(), 36 + kBodiesPerPart * 152U);
  EXPECT_LE(to_bytes<TypeOf<BodyPoses>>(poses).size(), kMaxSealedBytes);  // one datagram
  BodyDirectory longest{.peer = 1};
  for (std::uint32_t i = 0; i < kBodiesPerPart; ++i)
    longest.bodies.push_back({i, std::string(kMaxNameBytes - 1, 'a') + std::to_string(i),
                              std::string(kMaxNameBytes, 'm')});
  EXPECT_LE(to_bytes<TypeOf<BodyDirectory>>(longest).size(), kMaxSealedBytes);
  BoundsReport bounds = valid_bounds();
  bounds.heard = {{.poses = 1'000'000, .promises = 0, .near = 0, .posed = {}}};
  EXPECT_EQ(to_bytes<TypeOf<BoundsReport>>(bounds).size(), 60U);
  RegionSubscription credit = valid_subscription();
  credit.region = {};
  EXPECT_EQ(to_bytes<TypeOf<RegionSubscription>>(credit).size(), 84U);
  // 8 bytes for each node and 17 for each part, filled up to a multiple of four.
  EXPECT_EQ(to_bytes<TypeOf<RegionSubscription>>(valid_subscription()).size(),
            84U + 3 * 8 + 2 * 17 + 2);
  // Of one pair of bodies: 91 bytes where they rest, 115 where one moves.
  RegionSubscription certificate = valid_certificate_subscription();
  EXPECT_EQ(to_bytes<TypeOf<RegionSubscription>>(certificate).size(), 84U + 91);
  certificate.certificate->pairs[0].linear_velocity_mps = {1, 0, 0};
  EXPECT_EQ(to_bytes<TypeOf<RegionSubscription>>(certificate).size(), 84U + 115);
}

TEST(TypeSupport, JoinedBatchesComeBack) {
  const SplitBatchMessage sent = valid_joined_batches();
  const Bytes bytes = to_bytes<TypeOf<SplitBatchMessage>>(sent);
  EXPECT_EQ(bytes.size(), 44 + sample_bytes(sent));
  const auto back = from_bytes<TypeOf<SplitBatchMessage>>(bytes);
  ASSERT_TRUE(back.is_ok()) << back.status().message();
  EXPECT_EQ(back.value().bytes, sent.bytes);
  EXPECT_EQ(back.value().content_hash, sent.content_hash);
  ASSERT_EQ(back.value().joined.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(back.value().joined[i].content_hash, sent.joined[i].content_hash);
    EXPECT_EQ(back.value().joined[i].bytes, sent.joined[i].bytes);
  }
}

// Sizes that lead out of the bytes, and a second batch that is not there.
TEST(TypeSupport, JoinedBatchesThatEndEarlyAreRefused) {
  const auto fault_of = [](const std::vector<std::uint8_t>& bytes) {
    wire_types::SplitBatchSample sample;
    encode(valid_joined_batches(), sample);
    sample.bytes(bytes);
    const auto decoded = decode(sample);
    return decoded.is_ok() ? "" : decoded.status().message();
  };
  wire_types::SplitBatchSample sample;
  encode(valid_joined_batches(), sample);
  const std::vector<std::uint8_t> whole = sample.bytes();
  EXPECT_EQ(fault_of(whole), "");
  const std::set<std::size_t> ends{whole.size(), whole.size() - kJoinBytes - 1};
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::vector<std::uint8_t> cut(whole.begin(),
                                        whole.begin() + static_cast<std::ptrdiff_t>(size));
    if (ends.contains(size))
      EXPECT_EQ(fault_of(cut), "") << "between two batches";
    else
      EXPECT_NE(fault_of(cut).find("joined batches"), std::string::npos) << size;
  }
  std::vector<std::uint8_t> longer = whole;
  longer.push_back(0);
  EXPECT_NE(fault_of(longer).find("joined batches"), std::string::npos);
}

/// Measured with Fast DDS 2.9 and datagrams of 1,400 bytes: what is serialized to more than 1,224
/// is cut in two.
TEST(TypeSupport, LargestBatchFitsOneDatagram) {
  constexpr std::size_t kLargestWhole = 1400 - 176;
  SplitBatchMessage batch = valid_batch();
  batch.bytes.resize(kMaxSealedBytes);
  EXPECT_LE(to_bytes<TypeOf<SplitBatchMessage>>(batch).size(), kLargestWhole);
}

template <class Type, class Message>
void expect_every_prefix_refused(const Message& message) {
  const Bytes whole = to_bytes<Type>(message);
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_FALSE(from_bytes<Type>(Bytes(whole.begin(), whole.begin() + size)).is_ok()) << size;
}

TEST(TypeSupport, RefusesEveryPrefix) {
  for_each_valid([]<class Message>(const Message& message) {
    expect_every_prefix_refused<TypeOf<Message>>(message);
  });
  expect_every_prefix_refused<TypeOf<RegionSubscription>>(valid_certificate_subscription());
}

/// Whatever a byte is changed to: no crash, no exception, and what is accepted passes check().
template <class Type, class Message>
void expect_survives_changed_bytes(const Message& message) {
  const Bytes whole = to_bytes<Type>(message);
  for (std::size_t at = 0; at < whole.size(); ++at)
    for (const int value : {0x00, 0x01, 0x7f, 0x80, 0xff}) {
      Bytes changed = whole;
      changed[at] = static_cast<std::uint8_t>(value);
      const auto decoded = from_bytes<Type>(changed);
      if (decoded.is_ok()) {
        EXPECT_TRUE(check(decoded.value()).is_ok()) << at;
      }
    }
}

TEST(TypeSupport, SurvivesChangedBytes) {
  for_each_valid([]<class Message>(const Message& message) {
    expect_survives_changed_bytes<TypeOf<Message>>(message);
  });
  expect_survives_changed_bytes<TypeOf<RegionSubscription>>(valid_certificate_subscription());
}

TEST(TypeSupport, RecognisesAnotherVersionWhateverFollows) {
  std::string fault;
  (void)from_bytes<TypeOf<Hello>>({0, 1, 0, 0, 4, 0, 0xff, 0xff, 0xff, 0xff}, &fault);
  EXPECT_EQ(fault, "wire version 4, this build speaks 15");
  (void)from_bytes<TypeOf<Hello>>({0, 0, 0, 0, 1, 2, 0xff, 0xff}, &fault);  // big endian
  EXPECT_EQ(fault, "wire version 258, this build speaks 15");
  (void)from_bytes<TypeOf<Hello>>({0, 3, 0, 0, 2, 0, 0xff, 0xff}, &fault);
  EXPECT_EQ(fault, "encapsulation 3, expected plain CDR");
}

TEST(TypeSupport, NameThatWasCutIsRefused) {
  // Encapsulation, version, content hash; then a name of 200 bytes, and no header bytes.
  Bytes longer = to_bytes<TypeOf<MeshHeader>>(valid_header());
  longer.resize(20);
  longer.resize(24 + 200 + 4, 'x');
  longer[20] = 200;
  std::fill(longer.begin() + 21, longer.begin() + 24, 0);
  std::fill(longer.begin() + 223, longer.end(), 0);
  EXPECT_FALSE(from_bytes<TypeOf<MeshHeader>>(longer).is_ok());
}

TEST(TypeSupport, FailureLeavesNoKeyOfTheSampleBefore) {
  TypeOf<Hello> type;
  void* data = type.make_data();
  const auto load = [&](const Bytes& bytes) {
    Payload payload(static_cast<std::uint32_t>(bytes.size()));
    std::copy(bytes.begin(), bytes.end(), payload.data);
    payload.length = static_cast<std::uint32_t>(bytes.size());
    EXPECT_TRUE(type.read(payload, data));
    Key key;
    EXPECT_TRUE(type.key_of(data, key, false));
    return key;
  };
  const Bytes good = to_bytes<TypeOf<Hello>>(valid_hello());
  const Key of_good = load(good);
  const Key of_bad = load(Bytes(good.begin(), good.begin() + 30));
  EXPECT_TRUE(of_good.isDefined());
  EXPECT_FALSE(of_bad == of_good);
  type.delete_made(data);
}

TEST(TypeSupport, GivenBytesGoOutAsTheyAre) {
  Bytes bytes = to_bytes<TypeOf<BodyPoses>>(valid_poses());
  bytes.insert(bytes.end(), {0, 0, 0});  // padding, as it comes from the wire
  RawTypeOf<BodyPoses> raw;
  void* data = raw.make_data();
  Payload in(static_cast<std::uint32_t>(bytes.size()));
  std::copy(bytes.begin(), bytes.end(), in.data);
  in.length = static_cast<std::uint32_t>(bytes.size());
  ASSERT_TRUE(raw.read(in, data));
  // What was read is written again, whatever the fields say.
  auto& sample =
      static_cast<TypeOf<BodyPoses>::Data&>(*static_cast<TypeOf<BodyPoses>::Sample*>(data));
  EXPECT_EQ(sample.cdr, bytes);
  sample.frame(99);
  TypeOf<BodyPoses> type;
  ASSERT_EQ(type.size_of(data), bytes.size());
  Payload out(static_cast<std::uint32_t>(bytes.size()));
  ASSERT_TRUE(type.write(data, out));
  EXPECT_EQ(Bytes(out.data, out.data + out.length), bytes);
  Payload small(static_cast<std::uint32_t>(bytes.size() - 1));
  EXPECT_FALSE(type.write(data, small));
  raw.delete_made(data);
}

/// The same with every Fast DDS: numbers as they are, what may be longer than 16 bytes hashed, both
/// big-endian.
TEST(TypeSupport, KeysAreOnesOwnBytes) {
  const auto key_of = []<class Message>(const Message& message) {
    TypeOf<Message> type;
    typename TypeOf<Message>::Data data;
    encode(message, data);
    Key key;
    EXPECT_TRUE(type.key_of(static_cast<typename TypeOf<Message>::Sample*>(&data), key, false));
    return Bytes(&key.value[0], &key.value[0] + 16);
  };
  EXPECT_EQ(key_of(valid_hello()),
            (Bytes{0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88, 0, 0, 0, 0, 0, 0, 0, 0}));
  const ContactReport report = valid_report();
  ASSERT_EQ(report.peer, 42U);
  Bytes names{0, 0, 0, 0, 0, 0, 0, 42};
  for (const std::string& name : {report.body_a, report.body_b}) {
    names.resize((names.size() + 3) / 4 * 4);
    names.insert(names.end(), {0, 0, 0, static_cast<std::uint8_t>(name.size() + 1)});
    names.insert(names.end(), name.begin(), name.end());
    names.push_back(0);
  }
  Md5 digest;
  digest.init();
  digest.update(names.data(), static_cast<unsigned int>(names.size()));
  digest.finalize();
  EXPECT_EQ(key_of(report), Bytes(digest.digest, digest.digest + 16));
}

/// Fast CDR 2 counts bytes that would align the numbers of an empty list, and does not write them.
TEST(TypeSupport, EmptyListsAreWrittenWithoutPadding) {
  Hello hello;
  hello.publisher = 1;
  hello.name = "p";
  const Bytes bytes = to_bytes<TypeOf<Hello>>(hello);
  EXPECT_EQ(bytes.size(), 4U + 48);
  std::string fault;
  static_cast<void>(from_bytes<TypeOf<Hello>>(bytes, &fault));
  EXPECT_EQ(fault, "");
}

TEST(TypeSupport, KeysComputedByTwoThreadsAreRight) {
  TypeOf<ContactReport> type;  // its key is hashed, the longest way
  const auto key_of = [&type](std::uint64_t peer) {
    ContactReport report = valid_report();
    report.peer = peer;
    TypeOf<ContactReport>::Data data;
    encode(report, data);
    Key key;
    EXPECT_TRUE(type.key_of(static_cast<TypeOf<ContactReport>::Sample*>(&data), key, false));
    return key;
  };
  const Key expected[2] = {key_of(1), key_of(2)};
  EXPECT_FALSE(expected[0] == expected[1]);
  std::atomic<int> wrong = 0;
  const auto hammer = [&](std::uint64_t which) {
    for (int i = 0; i < 100'000; ++i)
      if (!(key_of(which + 1) == expected[which])) ++wrong;
  };
  std::thread other(hammer, 1);
  hammer(0);
  other.join();
  EXPECT_EQ(wrong, 0);
}

}  // namespace
}  // namespace nearmesh::wire
