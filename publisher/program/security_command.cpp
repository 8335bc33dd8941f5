// SPDX-License-Identifier: Apache-2.0
// make-security and check-security: the files of DDS Security for a set of programs (docs/security.md).

#include <cstdio>

#include "commands.hpp"

namespace nearmesh::publisher::program {

Status run(MakeSecurityOptions options) {
  const auto add = [&](const std::vector<std::string>& names, wire::Role role) {
    for (const std::string& name : names) options.plan.identities.push_back({name, role});
  };
  add(options.publishers, wire::Role::kPublisher);
  add(options.subscribers, wire::Role::kSubscriber);
  add(options.recorders, wire::Role::kRecorder);
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
    if (faults.empty()) std::printf("%s: good\n", identity.c_str());
    count += faults.size();
  }
  if (count == 0) return Status::ok();
  return {StatusCode::kInvalidArgument, options.folder + ": " + std::to_string(count) +
                                            (count == 1 ? " fault" : " faults") + " found"};
}

}  // namespace nearmesh::publisher::program
