// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/dds/identity.hpp"

#include <filesystem>

#include "door_watch.hpp"
#include "fastdds_api.hpp"
#include "idl/security/security.hpp"
#include "idl/security/security_folder.hpp"

namespace nearmesh::wire {
namespace {

constexpr const char* kPlugin = "dds.sec.auth.plugin";

Status check_qos(const fdds::DomainParticipantQos& qos) {
  if (rtps::PropertyPolicyHelper::find_property(qos.properties(), kPlugin) != nullptr)
    return {StatusCode::kConflict, "the participant's QoS has an identity already"};
  if (door_watch_of(qos) != nullptr)
    return {StatusCode::kConflict,
            "the participant's QoS has a door already, which must know of the identity: expected "
            "add_identity before add_door"};
  // Fast DDS would hear of others, and never get through a handshake.
  for (const auto& transport : qos.transport().user_transports)
    if (transport->max_message_size() < kSecuredDatagramBytes)
      return {StatusCode::kInvalidArgument,
              "a transport's max_message_size is " + std::to_string(transport->max_message_size()) +
                  ": a secured participant needs " + std::to_string(kSecuredDatagramBytes) +
                  ", for its handshake goes in one message"};
  return Status::ok();
}

}  // namespace

Status add_identity(fdds::DomainParticipantQos& qos, const std::string& folder,
                    std::uint32_t domain, const std::string& prefix) {
  NEARMESH_RETURN_IF_ERROR(check_qos(qos));
  // Fast DDS says "refused", and no more.
  const std::vector<SecurityFault> faults = check_security(folder, domain, prefix);
  if (!faults.empty())
    return {StatusCode::kInvalidArgument,
            faults.front().line() +
                (faults.size() == 1
                     ? ""
                     : " (and " + std::to_string(faults.size() - 1) + " more: check-security)")};
  const std::string path = "file://" + std::filesystem::absolute(folder).string() + "/";
  const std::string authentication = "dds.sec.auth.builtin.PKI-DH.",
                    access = "dds.sec.access.builtin.Access-Permissions.";
  auto& properties = qos.properties().properties();
  properties.emplace_back(kPlugin, "builtin.PKI-DH");
  properties.emplace_back(authentication + "identity_ca", path + kIdentityCa);
  properties.emplace_back(authentication + "identity_certificate", path + kCertificate);
  properties.emplace_back(authentication + "private_key", path + kPrivateKey);
  // Fast DDS reads it once, now; what it says later the door knows.
  if (std::filesystem::exists(std::filesystem::path(folder) / kRevocations))
    properties.emplace_back(authentication + "identity_crl", path + kRevocations);
  properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  properties.emplace_back(access + "permissions_ca", path + kPermissionsCa);
  properties.emplace_back(access + "governance", path + kGovernance);
  properties.emplace_back(access + "permissions", path + kPermissions);
  properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  return Status::ok();
}

}  // namespace nearmesh::wire
