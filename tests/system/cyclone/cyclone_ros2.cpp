// SPDX-License-Identifier: Apache-2.0
// nearmesh-cyclone-ros2 DOMAIN SAYINGS: a program of ROS 2 as its tools and simulators are, made
// with Eclipse Cyclone DDS (which ROS 2 has as one of its own) from ros2.idl. Reads /tf,
// /tf_static, /nearmesh/contacts and /nearmesh/mesh with ROS 2's QoS, and prints a line a transform
// and marker:
//   tf FRAME CHILD X Y Z QX QY QZ QW     (or static)
//   contacts FRAME NS ID TYPE ACTION LIFETIME POINTS LEAST_Z MOST_Z     (or mesh)
// names in quotes. Twenty times a second it says what the file SAYINGS has, line by line:
//   tf FRAME CHILD X Y Z W     pose TOPIC FRAME X Y Z W     bad TOPIC
// where W is the rotation's, the rest of that is 0, and bad is another type under the name of a
// pose. Until it is killed.

#include <dds/dds.h>

#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <thread>

#include "ros2.h"

namespace {

using TfMessage = tf2_msgs_msg_dds__TFMessage_;
using Transform = geometry_msgs_msg_dds__TransformStamped_;
using PoseStamped = geometry_msgs_msg_dds__PoseStamped_;
using MarkerArray = visualization_msgs_msg_dds__MarkerArray_;

constexpr std::chrono::milliseconds kPeriod{50};

dds_entity_t made(dds_entity_t entity, const char* what) {
  if (entity >= 0) return entity;
  std::fprintf(stderr, "nearmesh-cyclone-ros2: %s: %s\n", what, dds_strretcode(-entity));
  std::exit(1);
}

/// Reliable; latched as /tf_static is.
dds_qos_t* ros_qos(bool is_latched, int depth) {
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_qset_durability(qos, is_latched ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, depth);
  return qos;
}

dds_entity_t reader(dds_entity_t participant, const dds_topic_descriptor_t& type, const char* name,
                    bool is_latched, int depth) {
  dds_qos_t* const qos = ros_qos(is_latched, depth);
  const dds_entity_t topic =
      made(dds_create_topic(participant, &type, name, nullptr, nullptr), name);
  const dds_entity_t reader = made(dds_create_reader(participant, topic, qos, nullptr), name);
  dds_delete_qos(qos);
  return reader;
}

template <class Sample, class OnSample>
void take(dds_entity_t reader, OnSample on_sample) {
  void* samples[1] = {nullptr};
  dds_sample_info_t info[1];
  while (dds_take(reader, samples, info, 1, 1) > 0) {
    if (info[0].valid_data) on_sample(*static_cast<const Sample*>(samples[0]));
    dds_return_loan(reader, samples, 1);
  }
}

void print(const char* kind, const TfMessage& message) {
  for (std::uint32_t i = 0; i < message.transforms._length; ++i) {
    const Transform& one = message.transforms._buffer[i];
    const auto& at = one.transform.translation;
    const auto& turned = one.transform.rotation;
    std::printf("%s '%s' '%s' %.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", kind, one.header.frame_id,
                one.child_frame_id, at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w);
  }
}

void print(const char* kind, const MarkerArray& message) {
  for (std::uint32_t i = 0; i < message.markers._length; ++i) {
    const visualization_msgs_msg_dds__Marker_& one = message.markers._buffer[i];
    double least = 1e300, most = -1e300;
    for (std::uint32_t k = 0; k < one.points._length; ++k) {
      least = std::min(least, one.points._buffer[k].z);
      most = std::max(most, one.points._buffer[k].z);
    }
    std::printf("%s '%s' '%s' %d %d %d %d %u %.9g %.9g\n", kind, one.header.frame_id, one.ns,
                one.id, one.type, one.action, one.lifetime.sec, one.points._length, least, most);
  }
}

class Sayings {
 public:
  Sayings(dds_entity_t participant, const char* path) : participant_(participant), path_(path) {}

  void say() {
    std::ifstream in(path_);
    for (std::string line; std::getline(in, line);) {
      std::istringstream words(line);
      std::string kind, first, second;
      words >> kind >> first;
      if (kind == "bad") {
        // Of another length than a pose has.
        static dds_topic_descriptor_t as_pose = strange_msg_dds__Short__desc;
        as_pose.m_typename = geometry_msgs_msg_dds__PoseStamped__desc.m_typename;
        strange_msg_dds__Short_ sample{77};
        dds_write(writer(as_pose, first, line), &sample);
        continue;
      }
      words >> second;
      double x = 0, y = 0, z = 0, w = 1;
      for (double* number : {&x, &y, &z, &w}) {
        std::string word;
        words >> word;
        *number = std::strtod(word.c_str(), nullptr);  // "nan" too
      }
      const auto now = std::chrono::system_clock::now().time_since_epoch();
      const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
      const builtin_interfaces_msg_dds__Time_ stamp{static_cast<std::int32_t>(ns / 1'000'000'000),
                                                    static_cast<std::uint32_t>(ns % 1'000'000'000)};
      if (kind == "tf") {
        Transform one{{stamp, first.data()}, second.data(), {{x, y, z}, {0, 0, 0, w}}};
        TfMessage message{};
        message.transforms._length = message.transforms._maximum = 1;
        message.transforms._buffer = &one;
        dds_write(writer(tf2_msgs_msg_dds__TFMessage__desc, "/tf", kind), &message);
      } else {
        const PoseStamped message{{stamp, second.data()}, {{x, y, z}, {0, 0, 0, w}}};
        dds_write(writer(geometry_msgs_msg_dds__PoseStamped__desc, first, first), &message);
      }
    }
  }

 private:
  dds_entity_t writer(const dds_topic_descriptor_t& type, const std::string& topic,
                      const std::string& key) {
    if (const auto known = writers_.find(key); known != writers_.end()) return known->second;
    dds_qos_t* const qos = ros_qos(false, 10);
    const dds_entity_t of = made(
        dds_create_topic(participant_, &type, ("rt" + topic).c_str(), nullptr, nullptr), "topic");
    const dds_entity_t writer = made(dds_create_writer(participant_, of, qos, nullptr), "writer");
    dds_delete_qos(qos);
    return writers_[key] = writer;
  }

  const dds_entity_t participant_;
  const char* const path_;
  std::map<std::string, dds_entity_t> writers_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: nearmesh-cyclone-ros2 DOMAIN SAYINGS\n");
    return 2;
  }
  const dds_entity_t participant = made(
      dds_create_participant(static_cast<dds_domainid_t>(std::atoi(argv[1])), nullptr, nullptr),
      "participant");
  const dds_entity_t tf =
      reader(participant, tf2_msgs_msg_dds__TFMessage__desc, "rt/tf", false, 100);
  const dds_entity_t tf_static =
      reader(participant, tf2_msgs_msg_dds__TFMessage__desc, "rt/tf_static", true, 1);
  const dds_entity_t contacts = reader(participant, visualization_msgs_msg_dds__MarkerArray__desc,
                                       "rt/nearmesh/contacts", false, 10);
  const dds_entity_t mesh = reader(participant, visualization_msgs_msg_dds__MarkerArray__desc,
                                   "rt/nearmesh/mesh", false, 10);
  Sayings sayings(participant, argv[2]);
  for (;;) {
    sayings.say();
    take<TfMessage>(tf, [](const TfMessage& message) { print("tf", message); });
    take<TfMessage>(tf_static, [](const TfMessage& message) { print("static", message); });
    take<MarkerArray>(contacts, [](const MarkerArray& message) { print("contacts", message); });
    take<MarkerArray>(mesh, [](const MarkerArray& message) { print("mesh", message); });
    std::fflush(stdout);
    std::this_thread::sleep_for(kPeriod);
  }
}
