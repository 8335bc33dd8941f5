// SPDX-License-Identifier: Apache-2.0
#include "discovery_server.hpp"

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>

#include "idl/dds/dds_security.hpp"
#include "idl/dds/dds_transport.hpp"
#include "nearmesh/idl/dds/door.hpp"

namespace nearmesh::publisher {

namespace fdds = eprosima::fastdds::dds;

class DiscoveryServer::Impl {
 public:
  explicit Impl(fdds::DomainParticipant* participant) : participant_(participant) {}
  ~Impl() { fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

 private:
  fdds::DomainParticipant* const participant_;
};

Result<std::unique_ptr<DiscoveryServer>> DiscoveryServer::create(
    const wire::TransportOptions& options, const std::string& listen) {
  fdds::DomainParticipantQos qos;
  qos.name("nearmesh discovery");
  NEARMESH_RETURN_IF_ERROR(wire::set_server_transport(options, listen, qos));
  if (!options.security.empty()) NEARMESH_RETURN_IF_ERROR(wire::set_security(options, qos));
  wire::add_door(qos);
  fdds::DomainParticipant* const participant =
      fdds::DomainParticipantFactory::get_instance()->create_participant(
          options.domain, qos, nullptr, fdds::StatusMask::none());
  if (participant == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not make a discovery server at " + listen +
                                       ": is its port taken?"};
  std::unique_ptr<DiscoveryServer> server(new DiscoveryServer);
  server->impl_ = std::make_unique<Impl>(participant);
  return server;
}

DiscoveryServer::~DiscoveryServer() = default;

}  // namespace nearmesh::publisher
