// SPDX-License-Identifier: Apache-2.0
// make-security and check-security: the files of DDS Security for a set of programs
// (docs/security.md).

#include <cstdio>

#include "commands.hpp"

namespace nearmesh::publisher::program {

namespace {

Status revoke(const MakeSecurityOptions& options) {
  const auto report = wire::revoke_identities(
      options.folder, {options.plan.domain, options.plan.prefix, options.revoked});
  NEARMESH_RETURN_IF_ERROR(report);
  for (const std::string& certificate : report.value().certificates)
    std::printf("%s: revoked\n", certificate.c_str());
  if (report.value().certificates.empty()) std::printf("all of these were revoked already\n");
  for (const std::string& file : report.value().files)
    std::printf("%s: copy it to that identity's folder on its machine\n", file.c_str());
  std::printf(
      "running programs read it within identity_period_s (10 s unless set), and need no restart\n");
  return Status::ok();
}

}  // namespace

Status run(MakeSecurityOptions options) {
  const auto add = [&](const std::vector<std::string>& names, wire::Role role) {
    for (const std::string& name : names) options.plan.identities.push_back({name, role});
  };
  add(options.publishers, wire::Role::kPublisher);
  add(options.subscribers, wire::Role::kSubscriber);
  add(options.recorders, wire::Role::kRecorder);
  if (!options.revoked.empty()) {
    if (options.plan.identities.empty()) return revoke(options);
    return {StatusCode::kInvalidArgument,
            "--revoke: takes no identities to be made: revoke first, then make again with --force"};
  }
  NEARMESH_RETURN_IF_ERROR(wire::make_security(options.folder, options.plan));
  for (const wire::SecurityPlan::Identity& identity : options.plan.identities)
    std::printf("%s/%s: %s, use --security with this folder, copied to its machine\n",
                options.folder.c_str(), identity.name.c_str(), to_string(identity.role));
  std::printf("%s/private: keys of the authorities; keep them, and give them to nobody\n",
              options.folder.c_str());
  return Status::ok();
}

Status run(const CheckSecurityOptions& options) {
  const std::vector<std::string> identities = wire::identities_in(options.folder);
  if (identities.empty())
    return {StatusCode::kNotFound,
            options.folder + ": no identity is in there; make some with make-security"};
  std::size_t count = 0;
  for (const std::string& identity : identities) {
    const auto faults = wire::check_security(identity, options.domain, options.prefix);
    for (const wire::SecurityFault& fault : faults) std::printf("%s\n", fault.line().c_str());
    if (faults.empty())
      std::printf("%s: good, %s\n", identity.c_str(), wire::describe_identity(identity).c_str());
    count += faults.size();
  }
  if (count == 0) return Status::ok();
  return {StatusCode::kInvalidArgument, options.folder + ": " + std::to_string(count) +
                                            (count == 1 ? " fault" : " faults") + " found"};
}

}  // namespace nearmesh::publisher::program
