// SPDX-License-Identifier: Apache-2.0
// What `export` makes of a whole recording: read back by our own programs, and by readers of
// others.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "golden.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "publisher/replay/replay_index.hpp"

namespace nearmesh {
namespace {

using namespace test;

class ExportSession : public ::testing::Test {
 protected:
  std::string exported(const std::string& name, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words{"export", session_, "-o", folder_.file(name)};
    words.insert(words.end(), more.begin(), more.end());
    std::string out, err;
    EXPECT_EQ(run(folder_, "nearmesh-subscriber", words, &out, &err), 0) << err;
    EXPECT_NE(out.find(folder_.file(name)), std::string::npos) << out;
    return out;
  }
  std::string said(const std::string& verb, const std::string& session) {
    std::string out, err;
    EXPECT_EQ(run(folder_, "nearmesh-subscriber", {verb, session, "--json"}, &out, &err), 0) << err;
    return out;
  }

  const Folder folder_;
  const std::string session_ = golden_session(folder_);
};

TEST_F(ExportSession, InfoVerifyAndReplayReadMcapBack) {
  exported("s.mcap");
  const std::string mcap = folder_.file("s.mcap");
  EXPECT_EQ(said("info", mcap), said("info", session_));
  EXPECT_EQ(said("verify", mcap), said("verify", session_));
  const auto of = [](const std::string& path) {
    const auto recording = RecordingReader::open(path).value();
    const auto index = publisher::ReplayIndex::build(*recording, {}, {}).value();
    std::vector<std::vector<std::int64_t>> latched;
    for (std::int64_t end = 1; end <= recording->message_count() + 1; end += 50)
      latched.push_back(index->latched(end));
    return std::pair(index->streams().size(), latched);
  };
  EXPECT_EQ(of(mcap), of(session_));
}

TEST_F(ExportSession, TheSameRecordingGivesTheSameBytes) {
  for (const std::string ending : {".mcap", ".glb"}) {
    exported("one" + ending);
    exported("two" + ending);
    EXPECT_EQ(read_text(folder_.file("one" + ending)), read_text(folder_.file("two" + ending)));
  }
}

// @mcap/core, Foxglove's decoders of IDL and of ROS 2's messages, from npm.
TEST_F(ExportSession, DecodersOfOthersReadEveryMessage) {
  exported("s.mcap");
  const std::string sources =
      std::string(NEARMESH_SESSION_SOURCE) + "/tests/system/sessions/decoders";
  for (const char* name : {"decode.mjs", "package.json", "package-lock.json"})
    std::filesystem::copy_file(sources + "/" + name, folder_.file(name));
  const std::string log = folder_.file("npm.log");
  if (std::system(("cd '" + folder_.path() + "' && command -v node >'" + log +
                   "' 2>&1 && timeout 60 npm ci --no-audit --no-fund --prefer-offline "
                   "--fetch-retries=0 >'" +
                   log + "' 2>&1")
                      .c_str()) != 0)
    GTEST_SKIP() << "npm gives no decoders here (needs node, npm and a network, or its cache): "
                 << read_text(log);
  const std::string told = folder_.file("told.json"), err = folder_.file("decode.log");
  ASSERT_EQ(std::system(("cd '" + folder_.path() + "' && node decode.mjs s.mcap >'" + told +
                         "' 2>'" + err + "'")
                            .c_str()),
            0)
      << read_text(err);
  const auto seen = nlohmann::json::parse(read_text(told));

  // Against our own reading of the recording.
  const auto recording = RecordingReader::open(session_).value();
  const auto samples = wire::RecordedSamples::of(*recording).value();
  std::map<std::string, std::uint64_t> counts;
  std::map<std::string, std::vector<double>> clearances;
  std::map<std::string, Pose> last;
  std::map<std::pair<wire::SessionId, std::uint32_t>, std::string> names;
  std::uint64_t touching = 0;
  ASSERT_TRUE(
      recording
          ->read(1, recording->message_count() + 1,
                 [&](std::int64_t, const RecordedMessage& message) {
                   ++counts[recording->topics()[recording->writers()[message.writer].topic].name];
                   if (const auto r = samples.read<wire::ContactReport>(message)) {
                     clearances[r->body_a + "/" + r->body_b + "/clearance_m"].push_back(
                         r->clearance_m);
                     touching += r->asked && r->pair_count > 0 ? 1 : 0;
                   }
                   if (const auto told_bodies = samples.read<wire::BodyDirectory>(message))
                     for (const auto& body : told_bodies->bodies)
                       names[{told_bodies->peer, body.number}] = body.name;
                   if (const auto poses = samples.read<wire::BodyPoses>(message))
                     for (const auto& body : poses->bodies)
                       if (names.contains({poses->peer, body.number}))
                         last[names[{poses->peer, body.number}]] = body.motion.pose;
                   return true;
                 })
          .is_ok());
  for (const auto& [topic, count] : counts)
    EXPECT_EQ(seen["topics"].value(topic, 0U), count) << topic;
  ASSERT_FALSE(last.empty());
  for (const auto& [body, pose] : last) {
    const auto& frame = seen["frames"].at(body);
    const char* axes[] = {"x", "y", "z"};
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(frame.at(axes[k]).get<double>(), pose.translation_m[k]) << body;
    // The quaternion turns as the matrix does.
    const double x = frame["q"]["x"], y = frame["q"]["y"], z = frame["q"]["z"], w = frame["q"]["w"];
    const double rotation[] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
        2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    for (std::size_t i = 0; i < 9; ++i) EXPECT_NEAR(rotation[i], pose.rotation[i], 1e-9) << body;
  }
  for (const auto& [pair, values] : clearances) {
    std::vector<double> theirs;
    for (const auto& value : seen["numbers"].at(pair))
      theirs.push_back(value.is_null() ? std::numeric_limits<double>::infinity()
                                       : value.get<double>());
    // Peers take turns in the recording; each has its own topic there.
    std::vector<double> ours = values;
    for (double& x : ours)
      if (x == std::numeric_limits<double>::max()) x = std::numeric_limits<double>::infinity();
    std::sort(ours.begin(), ours.end());
    std::sort(theirs.begin(), theirs.end());
    EXPECT_EQ(theirs, ours) << pair;
  }
  ASSERT_GT(touching, 0U);
  EXPECT_GE(seen["markers"]["contacts"]["sent"].get<std::uint64_t>(), touching / 2);
  EXPECT_GT(seen["markers"]["contacts"]["points"].get<std::uint64_t>(), touching);
  EXPECT_GT(seen["markers"]["mesh"]["points"].get<std::uint64_t>(), 300U);
}

// ---- glTF ---------------------------------------------------------------------------------------

/// A binary glTF file, taken apart.
struct AnimatedGlb {
  nlohmann::json json;
  std::string binary;

  explicit AnimatedGlb(const std::string& bytes) {
    std::uint32_t length = 0;
    std::memcpy(&length, bytes.data() + 12, 4);
    json = nlohmann::json::parse(bytes.substr(20, length));
    binary = bytes.substr(20 + length + 8);
  }
  [[nodiscard]] std::vector<float> floats(std::size_t accessor) const {
    const auto& a = json["accessors"][accessor];
    const auto& view = json["bufferViews"][a["bufferView"].get<std::size_t>()];
    std::vector<float> values(view["byteLength"].get<std::size_t>() / sizeof(float));
    std::memcpy(values.data(), binary.data() + view["byteOffset"].get<std::size_t>(),
                values.size() * sizeof(float));
    return values;
  }
  /// Times and values of a node's property; both empty where it is not animated.
  [[nodiscard]] std::pair<std::vector<float>, std::vector<float>> track(
      std::size_t node, const std::string& path) const {
    for (const auto& channel : json["animations"][0]["channels"]) {
      if (channel["target"]["node"] != node || channel["target"]["path"] != path) continue;
      const auto& sampler =
          json["animations"][0]["samplers"][channel["sampler"].get<std::size_t>()];
      return {floats(sampler["input"]), floats(sampler["output"])};
    }
    return {};
  }
  /// Of a track of steps: whether the node is seen then.
  [[nodiscard]] bool is_seen(std::size_t node, float time_s) const {
    const auto [times, scales] = track(node, "scale");
    std::size_t i = 0;
    while (i + 1 < times.size() && times[i + 1] <= time_s) ++i;
    return scales.at(3 * i) != 0;
  }
};

TEST_F(ExportSession, GlbShowsOneMeshOfEachBodyAtATime) {
  exported("s.glb");
  const AnimatedGlb glb(read_text(folder_.file("s.glb")));
  std::size_t peers = 0, bodies = 0, changes = 0;
  float end_s = 0;
  for (const auto& peer : glb.json["nodes"]) {
    if (!peer["name"].get<std::string>().starts_with("peer ")) continue;
    ++peers;
    for (const std::size_t body : peer["children"]) {
      const auto& node = glb.json["nodes"][body];
      if (node["name"] == "contacts") continue;
      ++bodies;
      const auto [times, places] = glb.track(body, "translation");
      ASSERT_FALSE(times.empty());
      EXPECT_EQ(places.size(), 3 * times.size());
      EXPECT_TRUE(std::is_sorted(times.begin(), times.end()));
      EXPECT_EQ(glb.track(body, "rotation").first, times);
      end_s = std::max(end_s, times.back());
      changes += node["children"].size();
      for (float at = 0; at <= times.back(); at += times.back() / 37) {
        std::size_t seen = 0;
        for (const std::size_t mesh : node["children"]) seen += glb.is_seen(mesh, at) ? 1 : 0;
        EXPECT_EQ(seen, 1U) << node["name"] << " at " << at;
      }
    }
  }
  EXPECT_EQ(peers, 2U);
  EXPECT_EQ(bodies, 6U);
  EXPECT_GT(changes, bodies);
  EXPECT_GT(end_s, 1);
}

TEST_F(ExportSession, GlbMovesBodiesAsRecorded) {
  exported("s.glb");
  const AnimatedGlb glb(read_text(folder_.file("s.glb")));
  const auto& origin = glb.json["nodes"][1]["translation"];
  const auto recording = RecordingReader::open(session_).value();
  const auto samples = wire::RecordedSamples::of(*recording).value();
  std::size_t compared = 0;
  ASSERT_TRUE(
      recording
          ->read(1, recording->message_count() + 1,
                 [&](std::int64_t, const RecordedMessage& message) {
                   const auto report = samples.read<wire::ContactReport>(message);
                   if (!report || !report->asked) return true;
                   const float time_s = static_cast<float>(
                       1e-9 * static_cast<double>(message.received_ns - recording->begin_ns()));
                   for (const auto& peer : glb.json["nodes"]) {
                     if (peer["name"] != "peer " + wire::partition_of(report->peer)) continue;
                     for (const std::size_t body : peer["children"]) {
                       const auto& name = glb.json["nodes"][body]["name"];
                       if (name != report->body_a && name != report->body_b) continue;
                       const Pose& pose = name == report->body_a ? report->a.pose : report->b.pose;
                       const auto [times, places] = glb.track(body, "translation");
                       const auto at = std::lower_bound(times.begin(), times.end(), time_s);
                       if (at == times.end() || *at != time_s) continue;
                       const auto i = static_cast<std::size_t>(at - times.begin());
                       ++compared;
                       for (std::size_t k = 0; k < 3; ++k)
                         EXPECT_NEAR(origin[k].get<double>() + places[3 * i + k],
                                     pose.translation_m[k], 1e-3);
                     }
                   }
                   return true;
                 })
          .is_ok());
  EXPECT_GT(compared, 20U);
}

TEST_F(ExportSession, AMomentIsThatOfThePairInContact) {
  const auto recording = RecordingReader::open(session_).value();
  const auto samples = wire::RecordedSamples::of(*recording).value();
  // An answer without contact, recorded after one with: of the same instant, here.
  std::int64_t touched_ns = 0, after_ns = 0;
  ASSERT_TRUE(recording
                  ->read(1, recording->message_count() + 1,
                         [&](std::int64_t, const RecordedMessage& message) {
                           const auto report = samples.read<wire::ContactReport>(message);
                           if (!report || !report->asked) return true;
                           if (report->pair_count > 0) touched_ns = message.received_ns;
                           const std::int64_t since_ns = message.received_ns - touched_ns;
                           const bool is_soon = since_ns < 500'000'000;
                           if (report->pair_count == 0 && is_soon) after_ns = message.received_ns;
                           return true;
                         })
                  .is_ok());
  ASSERT_GT(after_ns, 0);
  const double time_s = 1e-6 + 1e-9 * static_cast<double>(after_ns - recording->begin_ns());
  const std::string said_of = exported("m.glb", {"--time", std::to_string(time_s)});
  EXPECT_NE(said_of.find("contact"), std::string::npos) << said_of;
  EXPECT_EQ(said_of.find(" 0 segments"), std::string::npos) << said_of;
}

TEST_F(ExportSession, AMeshFileNeedsAMoment) {
  std::string err;
  EXPECT_EQ(run(folder_, "nearmesh-subscriber", {"export", session_, "-o", folder_.file("s.ply")},
                nullptr, &err),
            2);
  EXPECT_NE(err.find("--time"), std::string::npos) << err;
}

}  // namespace
}  // namespace nearmesh
