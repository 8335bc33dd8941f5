// SPDX-License-Identifier: Apache-2.0
#pragma once
// The commands of nearmesh-publisher: what each is told, and what it then does. Flags and help
// stand in main.cpp alone, so that no command compiles CLI11.

#include <string>
#include <vector>

#include "core/command/outcome.hpp"
#include "idl/program/stop.hpp"
#include "idl/security/security.hpp"
#include "nearmesh/core/base/status.hpp"
#include "publisher/dds/dds_channel.hpp"
#include "publisher/dds/dds_replay.hpp"

namespace nearmesh::publisher::program {

using wire::program::stop_requested;

struct ServeOptions {
  std::vector<std::string> models, replaces;
  DdsChannelOptions channel;
  std::string metrics;
};
Outcome run(const ServeOptions& options);

struct ReplayOptions {
  std::string path, models;
  PlayheadOptions playhead;
  bool loop = false, json = false;
  std::vector<std::string> topics, remaps;
  wire::TransportOptions transport;
};
Outcome run(ReplayOptions options);

struct DiscoveryOptions {
  std::string listen;
  wire::TransportOptions transport;
};
Status run(const DiscoveryOptions& options);

struct MakeSecurityOptions {
  std::string folder;
  wire::SecurityPlan plan;
  std::vector<std::string> publishers, subscribers, recorders;
  std::vector<std::string> revoked;  ///< any: nothing is made
};
Status run(MakeSecurityOptions options);

struct CheckSecurityOptions {
  std::string folder;
  std::uint32_t domain = 0;
  std::string prefix = "nearmesh";
};
Status run(const CheckSecurityOptions& options);

}  // namespace nearmesh::publisher::program
