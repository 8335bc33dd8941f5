// SPDX-License-Identifier: Apache-2.0
#pragma once
// A discovery server of Fast DDS: programs that name it (discovery_server) find each other through
// it alone.

#include <memory>
#include <string>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"

namespace eprosima::fastdds::dds {
class DomainParticipant;
}

namespace nearmesh::publisher {

/// Serves from create to destruction.
class DiscoveryServer {
 public:
  /// `listen`: "ADDRESS" or "ADDRESS:PORT" of this machine, where it is found. Of the options
  /// domain, lease and period of life signs count. Errors: kInvalidArgument naming the option; kIo
  /// when Fast DDS refuses, say because the port is taken.
  [[nodiscard]] static Result<std::unique_ptr<DiscoveryServer>> create(
      const wire::TransportOptions& options, const std::string& listen);
  ~DiscoveryServer();
  DiscoveryServer(const DiscoveryServer&) = delete;
  DiscoveryServer& operator=(const DiscoveryServer&) = delete;

 private:
  explicit DiscoveryServer(eprosima::fastdds::dds::DomainParticipant* participant)
      : participant_(participant) {}
  eprosima::fastdds::dds::DomainParticipant* const participant_;
};

}  // namespace nearmesh::publisher
