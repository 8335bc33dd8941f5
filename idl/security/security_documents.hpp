// SPDX-License-Identifier: Apache-2.0
#pragma once
// Governance and permissions as DDS Security writes them, and what they allow. Source: OMG DDS
// Security 1.1, section 9.4.1.

#include <ctime>
#include <string>
#include <vector>

#include "nearmesh/idl/messages/topics.hpp"
#include "security.hpp"

namespace nearmesh::wire {

/// "2026-11-22T19:47:24", of UTC.
[[nodiscard]] std::string date_of(std::time_t time);

/// One endpoint that a role has. Partition "" is the default; "*" all (batches: a partition for
/// each peer).
struct Endpoint {
  std::string topic;
  bool writes = false;
  std::string partition;
};
[[nodiscard]] std::vector<Endpoint> endpoints_of(Role role, const TopicNames& names);

[[nodiscard]] std::string governance_text(std::uint32_t domain, const std::string& prefix);
[[nodiscard]] std::string permissions_text(const SecurityPlan& plan,
                                           const SecurityPlan::Identity& identity, std::time_t now);

/// What is wrong with a governance for a domain, as a clause; "" for nothing.
[[nodiscard]] std::string judge_governance(const std::string& text, std::uint32_t domain,
                                           const std::string& prefix);
/// Likewise with permissions, for whom the certificate names.
[[nodiscard]] std::string judge_permissions(const std::string& text, const std::string& subject,
                                            std::uint32_t domain, const std::string& prefix,
                                            std::time_t now);

}  // namespace nearmesh::wire
