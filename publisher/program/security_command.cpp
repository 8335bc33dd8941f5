// SPDX-License-Identifier: Apache-2.0
// make-security and check-security: the files of DDS Security for a set of programs (docs/security.md).

#include <cstdio>
#include <memory>

#include "commands.hpp"
#include "idl/security/security.hpp"

namespace nearmesh::publisher::program {
namespace {

struct MakeOptions {
  std::string folder;
  wire::SecurityPlan plan;
  std::vector<std::string> publishers, subscribers, recorders;
};

struct CheckOptions {
  std::string folder;
  std::uint32_t domain = 0;
  std::string prefix = "nearmesh";
};

Status make(MakeOptions& options) {
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

Status check(const CheckOptions& options) {
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

void add_bus_options(CLI::App& command, std::uint32_t& domain, std::string& prefix) {
  command.add_option("--domain", domain, "DDS domain of the programs")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
  command.add_option("--prefix", prefix, "First part of every topic's name")->capture_default_str();
}

}  // namespace

void add_security_commands(CLI::App& app, std::function<Status()>& chosen) {
  auto making = std::make_shared<MakeOptions>();
  CLI::App* make_command = app.add_subcommand(
      "make-security", "Make identities for secured programs: keys, certificates, permissions.");
  make_command
      ->add_option("folder", making->folder,
                   "The set; one that exists is added to, with its authorities")
      ->required();
  add_bus_options(*make_command, making->plan.domain, making->plan.prefix);
  make_command->add_option("--publisher", making->publishers, "Names of identities that serve");
  make_command->add_option("--subscriber", making->subscribers,
                           "Names of identities that ask and move bodies");
  make_command->add_option("--recorder", making->recorders, "Names of identities that only listen");
  make_command->add_option("--days", making->plan.valid_days, "How long all of it is valid")
      ->capture_default_str();
  make_command->add_flag("--force", making->plan.force, "Make identities anew that exist");
  make_command->callback([&chosen, making] { chosen = [making] { return make(*making); }; });

  auto checking = std::make_shared<CheckOptions>();
  CLI::App* check_command = app.add_subcommand(
      "check-security", "Say what is wrong with an identity's folder, or with all of a set.");
  check_command->add_option("folder", checking->folder, "An identity's folder, or the set's")
      ->required();
  add_bus_options(*check_command, checking->domain, checking->prefix);
  check_command->callback(
      [&chosen, checking] { chosen = [checking] { return check(*checking); }; });
}

}  // namespace nearmesh::publisher::program
