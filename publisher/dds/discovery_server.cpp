// SPDX-License-Identifier: Apache-2.0
#include "discovery_server.hpp"

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>

#include "idl/dds/dds_transport.hpp"
#include "nearmesh/idl/dds/door.hpp"

namespace nearmesh::publisher {

namespace fdds = wire::fdds;

Result<std::unique_ptr<DiscoveryServer>> DiscoveryServer::create(
    const wire::TransportOptions& options, const std::string& listen) {
  fdds::DomainParticipantQos qos;
  qos.name("nearmesh discovery");
  wire::speak_as_2_9(qos);
  NEARMESH_RETURN_IF_ERROR(wire::set_server_transport(options, listen, qos));
  wire::add_door(qos);
  fdds::DomainParticipant* const participant =
      fdds::DomainParticipantFactory::get_instance()->create_participant(
          options.domain, qos, nullptr, fdds::StatusMask::none());
  if (participant == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not make a discovery server at " + listen +
                                       ": is its port taken?"};
  return std::unique_ptr<DiscoveryServer>(new DiscoveryServer(participant));
}

DiscoveryServer::~DiscoveryServer() {
  fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
}

}  // namespace nearmesh::publisher
