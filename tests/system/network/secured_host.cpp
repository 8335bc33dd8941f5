// SPDX-License-Identifier: Apache-2.0
#include "secured_host.hpp"

#include <fstream>
#include <stdexcept>
#include <utility>
#include <vector>

#include "idl/security/security_crypto.hpp"
#include "idl/security/security_folder.hpp"
#include "tests/system/integration/process.hpp"

namespace nearmesh::test {
namespace {

namespace crypto = wire::crypto;

template <class T>
T require(Result<T> result) {
  if (!result.is_ok()) throw std::runtime_error(result.status().message());
  return std::move(result).value();
}

/// In front of `mark`, which is there once or more: each of them.
std::string with(std::string text, const std::string& mark, const std::string& added) {
  std::size_t at = text.find(mark);
  if (at == std::string::npos) throw std::runtime_error("no " + mark);
  for (; at != std::string::npos; at = text.find(mark, at + added.size() + mark.size()))
    text.insert(at, added);
  return text;
}

}  // namespace

void permit_topic(const std::string& set, const std::string& identity, const std::string& topic) {
  const std::string authority = set + "/private/permissions_ca", folder = set + "/" + identity;
  const crypto::Issuer issuer{require(crypto::read_key(authority + ".key.pem")),
                              require(crypto::read_certificate(authority + ".cert.pem"))};
  const auto change = [&](const char* document, const std::string& mark, const std::string& added) {
    const std::string path = folder + "/" + document;
    const std::string text = require(crypto::verify_signed(path, *issuer.certificate));
    std::ofstream(path) << require(crypto::sign(with(text, mark, added), issuer));
  };
  std::string rights;
  for (const char* what : {"publish", "subscribe"})
    rights +=
        std::string("<") + what + "><topics><topic>" + topic + "</topic></topics></" + what + ">\n";
  change(wire::kPermissions, "      </allow_rule>", rights);
  change(wire::kGovernance, "      </topic_access_rules>",
         "<topic_rule><topic_expression>" + topic +
             "</topic_expression>\n"
             "<enable_discovery_protection>true</enable_discovery_protection>\n"
             "<enable_liveliness_protection>true</enable_liveliness_protection>\n"
             "<enable_read_access_control>true</enable_read_access_control>\n"
             "<enable_write_access_control>true</enable_write_access_control>\n"
             "<metadata_protection_kind>ENCRYPT</metadata_protection_kind>\n"
             "<data_protection_kind>NONE</data_protection_kind></topic_rule>\n");
}

std::string secured_profiles(const std::string& profiles, const std::string& profile,
                             const std::string& identity_folder) {
  const std::string begin = "<participant profile_name=\"" + profile + "\">";
  const std::string text = read_text(profiles);
  const std::size_t at = text.find(begin);
  if (at == std::string::npos) throw std::runtime_error(profiles + ": no " + profile);
  const std::string place = "file://" + identity_folder + "/";
  const std::vector<std::pair<std::string, std::string>> properties{
      {"dds.sec.auth.plugin", "builtin.PKI-DH"},
      {"dds.sec.auth.builtin.PKI-DH.identity_ca", place + wire::kIdentityCa},
      {"dds.sec.auth.builtin.PKI-DH.identity_certificate", place + wire::kCertificate},
      {"dds.sec.auth.builtin.PKI-DH.private_key", place + wire::kPrivateKey},
      {"dds.sec.access.plugin", "builtin.Access-Permissions"},
      {"dds.sec.access.builtin.Access-Permissions.permissions_ca", place + wire::kPermissionsCa},
      {"dds.sec.access.builtin.Access-Permissions.governance", place + wire::kGovernance},
      {"dds.sec.access.builtin.Access-Permissions.permissions", place + wire::kPermissions},
      {"dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC"}};
  std::string list = "<propertiesPolicy><properties>";
  for (const auto& [name, value] : properties)
    list += "<property><name>" + name + "</name><value>" + value + "</value></property>\n";
  list += "</properties></propertiesPolicy>\n";
  const std::size_t end = text.find("</rtps>", at);
  if (end == std::string::npos) throw std::runtime_error(profiles + ": no end of " + profile);
  return text.substr(0, end) + list + text.substr(end);
}

}  // namespace nearmesh::test
