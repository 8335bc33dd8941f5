// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "nearmesh/idl/messages/topics.hpp"
#include "security_crypto.hpp"
#include "security_documents.hpp"
#include "security_folder.hpp"

namespace nearmesh::wire {
namespace {

namespace fs = std::filesystem;
using crypto::Issuer;

constexpr int kMaxValidDays = 36500;
constexpr std::size_t kMaxIdentityName = 63;
constexpr mode_t kPrivate = 0600, kPublic = 0644;
const std::string kAuthorities =
    "private";  // keys of the authorities, and what all identities share

Status io_error(const std::string& path) {
  return {StatusCode::kIo, path + ": " + std::strerror(errno)};
}

/// Whole and on disk, or not there.
Status write_file(const fs::path& path, const std::string& text, mode_t mode) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  if (file < 0) return io_error(path);
  const bool written =
      ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
      ::fchmod(file, mode) == 0 && ::fsync(file) == 0;
  const Status status = written ? Status::ok() : io_error(path);
  ::close(file);
  if (!written) ::unlink(path.c_str());
  return status;
}

Status make_folder(const fs::path& path, mode_t mode) {
  if (::mkdir(path.c_str(), mode) == 0) return Status::ok();
  return io_error(path);
}

std::string read_file(const fs::path& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

Status check_plan(const SecurityPlan& plan) {
  NEARMESH_RETURN_IF_ERROR(check_prefix(plan.prefix));
  if (plan.valid_days < 1 || plan.valid_days > kMaxValidDays)
    return {StatusCode::kInvalidArgument, "days: expected 1 to " + std::to_string(kMaxValidDays) +
                                              ", found " + std::to_string(plan.valid_days)};
  if (plan.identities.empty())
    return {StatusCode::kInvalidArgument,
            "expected the name of at least one publisher, subscriber or recorder"};
  std::vector<std::string> names;
  for (const SecurityPlan::Identity& identity : plan.identities) {
    const std::string& name = identity.name;
    const bool fits = !name.empty() && name.size() <= kMaxIdentityName && name[0] != '-' &&
                      std::all_of(name.begin(), name.end(), [](unsigned char c) {
                        return std::isalnum(c) != 0 || c == '_' || c == '-';
                      });
    if (!fits || name == kAuthorities)
      return {StatusCode::kInvalidArgument,
              "identity '" + name + "': expected 1 to 63 letters, digits, '_' or '-', and not '" +
                  kAuthorities + "'"};
    if (std::find(names.begin(), names.end(), name) != names.end())
      return {StatusCode::kConflict, "identity " + name + " is named twice"};
    names.push_back(name);
  }
  return Status::ok();
}

/// What a set has once.
struct Authorities {
  Issuer identity, permissions;
  std::string governance;  ///< signed
};

Result<Issuer> read_authority(const fs::path& folder, const std::string& name) {
  auto certificate = crypto::read_certificate(folder / (name + ".cert.pem"));
  auto key = crypto::read_key(folder / (name + ".key.pem"));
  for (const Status& status : {certificate.status(), key.status()})
    if (!status.is_ok())
      return Status{status.code(), (folder / name).string() + ".*: " + status.message()};
  return Issuer{std::move(key).value(), std::move(certificate).value()};
}

Result<Issuer> make_authority(const fs::path& folder, const std::string& name,
                              const std::string& common_name, const SecurityPlan& plan,
                              std::time_t now) {
  auto made = crypto::make_identity(common_name, plan.valid_days, now, nullptr);
  NEARMESH_RETURN_IF_ERROR(made);
  const auto key = crypto::to_pem(*made.value().key);
  NEARMESH_RETURN_IF_ERROR(key);
  NEARMESH_RETURN_IF_ERROR(write_file(folder / (name + ".key.pem"), key.value(), kPrivate));
  NEARMESH_RETURN_IF_ERROR(write_file(folder / (name + ".cert.pem"),
                                      crypto::to_pem(*made.value().certificate), kPublic));
  return made;
}

/// Of a set that exists: not replaced, but held against the plan.
Result<Authorities> read_authorities(const fs::path& folder, const SecurityPlan& plan) {
  if (read_file(folder / "governance.xml") != governance_text(plan.domain, plan.prefix))
    return Status{StatusCode::kConflict,
                  folder.string() + "/governance.xml: made for another domain or prefix than " +
                      std::to_string(plan.domain) + " and " + plan.prefix +
                      "; give those, or another folder"};
  auto identity = read_authority(folder, "identity_ca");
  NEARMESH_RETURN_IF_ERROR(identity);
  auto permissions = read_authority(folder, "permissions_ca");
  NEARMESH_RETURN_IF_ERROR(permissions);
  return Authorities{std::move(identity).value(), std::move(permissions).value(),
                     read_file(folder / kGovernance)};
}

Status fill_authorities(const fs::path& folder, const SecurityPlan& plan, std::time_t now) {
  auto identity = make_authority(folder, "identity_ca", "nearmesh identities", plan, now);
  NEARMESH_RETURN_IF_ERROR(identity);
  auto permissions = make_authority(folder, "permissions_ca", "nearmesh permissions", plan, now);
  NEARMESH_RETURN_IF_ERROR(permissions);
  const std::string text = governance_text(plan.domain, plan.prefix);
  const auto governance = crypto::sign(text, permissions.value());
  NEARMESH_RETURN_IF_ERROR(governance);
  NEARMESH_RETURN_IF_ERROR(write_file(folder / "governance.xml", text, kPublic));
  return write_file(folder / kGovernance, governance.value(), kPublic);
}

/// Makes a folder beside its place first, so that nobody sees half of one, and what was there stays until then.
template <class Fill>
Status put_folder(const fs::path& place, mode_t mode, Fill fill) {
  const fs::path beside = place.parent_path() / ("." + place.filename().string() + ".new");
  std::error_code ignored;
  fs::remove_all(beside, ignored);  // of a run that was interrupted
  NEARMESH_RETURN_IF_ERROR(make_folder(beside, mode));
  Status status = fill(beside);
  if (status.is_ok()) {
    const fs::path old = place.parent_path() / ("." + place.filename().string() + ".old");
    fs::remove_all(old, ignored);
    const bool replaces = ::rename(place.c_str(), old.c_str()) == 0;
    if (::rename(beside.c_str(), place.c_str()) != 0) {
      status = io_error(place);
      if (replaces) static_cast<void>(::rename(old.c_str(), place.c_str()));
    }
    fs::remove_all(old, ignored);
  }
  if (!status.is_ok()) fs::remove_all(beside, ignored);
  return status;
}

/// --force makes identities anew, and nothing else goes with them.
Status check_replaceable(const fs::path& place) {
  const auto is_identity_file = [](const fs::path& path) {
    return std::find(kIdentityFiles.begin(), kIdentityFiles.end(), path.filename()) !=
           kIdentityFiles.end();
  };
  std::error_code error;
  for (fs::directory_iterator at(place, error), end; !error && at != end; at.increment(error))
    if (!is_identity_file(at->path()))
      return {StatusCode::kConflict, at->path().string() +
                                         ": belongs to no identity, so its folder is not replaced; "
                                         "move it or give another name"};
  if (error) return {StatusCode::kConflict, place.string() + ": is no identity's folder"};
  return Status::ok();
}

Result<Authorities> make_authorities(const fs::path& place, const SecurityPlan& plan,
                                     std::time_t now) {
  NEARMESH_RETURN_IF_ERROR(put_folder(
      place, 0700, [&](const fs::path& folder) { return fill_authorities(folder, plan, now); }));
  return read_authorities(place, plan);
}

Status fill_identity(const fs::path& folder, const SecurityPlan& plan,
                     const SecurityPlan::Identity& identity, const Authorities& authorities,
                     std::time_t now) {
  const auto made =
      crypto::make_identity(identity.name, plan.valid_days, now, &authorities.identity);
  NEARMESH_RETURN_IF_ERROR(made);
  const auto key = crypto::to_pem(*made.value().key);
  NEARMESH_RETURN_IF_ERROR(key);
  const auto permissions =
      crypto::sign(permissions_text(plan, identity, now), authorities.permissions);
  NEARMESH_RETURN_IF_ERROR(permissions);
  const auto pem = [](const Issuer& issuer) { return crypto::to_pem(*issuer.certificate); };
  NEARMESH_RETURN_IF_ERROR(write_file(folder / kIdentityCa, pem(authorities.identity), kPublic));
  NEARMESH_RETURN_IF_ERROR(
      write_file(folder / kPermissionsCa, pem(authorities.permissions), kPublic));
  NEARMESH_RETURN_IF_ERROR(write_file(folder / kCertificate, pem(made.value()), kPublic));
  NEARMESH_RETURN_IF_ERROR(write_file(folder / kPrivateKey, key.value(), kPrivate));
  NEARMESH_RETURN_IF_ERROR(write_file(folder / kGovernance, authorities.governance, kPublic));
  return write_file(folder / kPermissions, permissions.value(), kPublic);
}

}  // namespace

Status make_security(const std::string& folder, const SecurityPlan& plan) {
  NEARMESH_RETURN_IF_ERROR(check_plan(plan));
  const fs::path set = folder, authorities_folder = set / kAuthorities;
  for (const SecurityPlan::Identity& identity : plan.identities) {
    const fs::path place = set / identity.name;
    if (!fs::exists(place)) continue;
    if (!plan.force)
      return {StatusCode::kConflict, place.string() + ": exists; --force makes it anew"};
    NEARMESH_RETURN_IF_ERROR(check_replaceable(place));
  }
  std::error_code error;
  fs::create_directories(set, error);
  if (error) return {StatusCode::kIo, folder + ": " + error.message()};
  const std::time_t now = std::time(nullptr);
  const auto authorities = fs::exists(authorities_folder)
                               ? read_authorities(authorities_folder, plan)
                               : make_authorities(authorities_folder, plan, now);
  NEARMESH_RETURN_IF_ERROR(authorities);
  for (const SecurityPlan::Identity& identity : plan.identities)
    NEARMESH_RETURN_IF_ERROR(put_folder(set / identity.name, 0755, [&](const fs::path& made) {
      return fill_identity(made, plan, identity, authorities.value(), now);
    }));
  return Status::ok();
}

}  // namespace nearmesh::wire
