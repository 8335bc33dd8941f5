// SPDX-License-Identifier: Apache-2.0
#pragma once
// The commands of nearmesh-subscriber: what each is told, and what it then does. Flags and help
// stand in main.cpp alone, so that no command compiles CLI11.

#include <optional>
#include <string>
#include <vector>

#include "core/command/outcome.hpp"
#include "idl/program/stop.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "subscriber/dds/dds_recorder.hpp"

namespace nearmesh::subscriber::program {

using wire::program::stop_requested;

/// What ROS 2's tools are shown, and where.
struct Ros2Showing {
  bool is_wanted = false;
  std::string frame = "world";
  std::optional<std::uint32_t> domain;  ///< none: that of the bus
};

struct RunOptions {
  std::string scene, answers;
  DdsChannelOptions channel;
  std::string metrics;
  bool json = false;
  std::optional<double> wait_recorder_s;  ///< for so long at most; 0: without end
  Ros2Showing ros2;
  /// Bodies that ROS 2 moves, as parse_ros2_body() takes them.
  std::vector<std::string> ros2_poses;
};
Outcome run(const RunOptions& options);

/// Of `record`.
Outcome run(const RecorderOptions& options);

struct InfoOptions {
  std::string path;
  bool json = false;
};
Status run(const InfoOptions& options);

struct VerifyOptions {
  std::string path, models;
  unsigned threads = 1;
  bool allow_unproved = false, json = false;
};
Outcome run(const VerifyOptions& options);

struct ExportOptions {
  std::string session, peer, body, other, out, models;
  std::optional<double> time_s;  ///< none: the whole session
};
Status run(const ExportOptions& options);

struct ReportOptions {
  std::string session, folder;
};
Status run(const ReportOptions& options);

struct WatchOptions {
  wire::TransportOptions transport;
  std::string http, models;
  std::uint64_t max_bytes = 256'000'000;  ///< of what was heard: then it begins anew
  Ros2Showing ros2;
};
Outcome run(const WatchOptions& options);

struct StatusOptions {
  wire::TransportOptions transport;
  double seconds = 3;
  bool watch = false, json = false, regions = false;
};
Outcome run(const StatusOptions& options);

struct DoctorOptions {
  wire::TransportOptions transport;
  double seconds = 10;
  bool json = false;
};
Outcome run(const DoctorOptions& options);

}  // namespace nearmesh::subscriber::program
