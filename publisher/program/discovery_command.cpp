// SPDX-License-Identifier: Apache-2.0
// discovery: where the others of a large exercise find each other.

#include <spdlog/spdlog.h>

#include <chrono>
#include <thread>

#include "commands.hpp"
#include "idl/program/logging.hpp"
#include "publisher/dds/discovery_server.hpp"

namespace nearmesh::publisher::program {

Status run(const DiscoveryOptions& options) {
  wire::program::log_fastdds();
  auto server = DiscoveryServer::create(options.transport, options.listen);
  NEARMESH_RETURN_IF_ERROR(server);
  spdlog::info("ready: a discovery server at {}; others name it with --discovery-server",
               options.listen);
  while (stop_requested == 0) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  return Status::ok();
}

}  // namespace nearmesh::publisher::program
