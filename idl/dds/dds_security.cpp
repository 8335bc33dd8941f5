// SPDX-License-Identifier: Apache-2.0
#include "dds_security.hpp"

#include <filesystem>

#include "idl/security/security.hpp"
#include "idl/security/security_folder.hpp"

namespace nearmesh::wire {

Status set_security(const TransportOptions& options,
                    eprosima::fastdds::dds::DomainParticipantQos& qos) {
  const std::vector<SecurityFault> faults =
      check_security(options.security, options.domain, options.prefix);
  if (!faults.empty())
    return {StatusCode::kInvalidArgument,
            faults.front().line() +
                (faults.size() == 1
                     ? ""
                     : " (and " + std::to_string(faults.size() - 1) + " more: check-security)")};
  const std::string folder = "file://" + std::filesystem::absolute(options.security).string() + "/";
  const std::string authentication = "dds.sec.auth.builtin.PKI-DH.",
                    access = "dds.sec.access.builtin.Access-Permissions.";
  auto& properties = qos.properties().properties();
  properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
  properties.emplace_back(authentication + "identity_ca", folder + kIdentityCa);
  properties.emplace_back(authentication + "identity_certificate", folder + kCertificate);
  properties.emplace_back(authentication + "private_key", folder + kPrivateKey);
  // Fast DDS reads it once, now; what it says later the door knows.
  if (std::filesystem::exists(std::filesystem::path(options.security) / kRevocations))
    properties.emplace_back(authentication + "identity_crl", folder + kRevocations);
  properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  properties.emplace_back(access + "permissions_ca", folder + kPermissionsCa);
  properties.emplace_back(access + "governance", folder + kGovernance);
  properties.emplace_back(access + "permissions", folder + kPermissions);
  properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  return Status::ok();
}

}  // namespace nearmesh::wire
