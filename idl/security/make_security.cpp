// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string_view>

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
// Keys of the authorities, and what all identities share.
const std::string kAuthorities = "private";
const char* const kIssued = "issued";  // each certificate, a line: serial and name

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

/// Of letters and digits, and these.
bool is_made_of(std::string_view text, std::string_view others) {
  return std::all_of(text.begin(), text.end(), [&](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
           others.find(c) != std::string_view::npos;
  });
}

/// A handshake carries them in one message, and Fast DDS 3.1 ends the process of who would send
/// more than 8 KB. So they take no more than with the longest names of prefixes and identities,
/// which a test sends.
Status check_room(const SecurityPlan& plan) {
  SecurityPlan longest;
  longest.domain = plan.domain;
  longest.prefix = std::string(kMaxPrefixBytes, 'x');
  for (const SecurityPlan::Identity& identity : plan.identities) {
    const std::size_t most =
        permissions_text(longest, {std::string(kMaxIdentityName, 'x'), identity.role}, 0).size();
    const std::size_t bytes = permissions_text(plan, identity, 0).size();
    if (bytes > most)
      return {StatusCode::kInvalidArgument,
              "topics: the permissions of " + identity.name + " would take " +
                  std::to_string(bytes) + " bytes, and a handshake has room for " +
                  std::to_string(most) +
                  "; name fewer, or all that begin alike as \"name/*\", or take a shorter prefix"};
  }
  return Status::ok();
}

Status check_topics(const SecurityPlan& plan) {
  const std::string own = plan.prefix + "/";
  for (const std::string& topic : plan.topics) {
    const bool is_pattern = topic.ends_with("/*");
    const std::string begin = topic.substr(0, topic.size() - (is_pattern ? 1 : 0));
    const bool fits = !begin.empty() && begin != "/" && is_made_of(begin, "_-./:~");
    if (!fits)
      return {
          StatusCode::kInvalidArgument,
          "topic '" + topic +
              "': expected letters, digits, '_', '-', '.', '/', ':' or '~', and at most \"/*\" at "
              "its end"};
    if (begin.starts_with(own) || (is_pattern && own.starts_with(begin)))
      return {StatusCode::kInvalidArgument,
              "topic '" + topic + "': topics under " + own +
                  " are nearmesh's own, and go by role; expected another"};
  }
  return check_room(plan);
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
                      is_made_of(name, "_-");
    if (!fits || name == kAuthorities)
      return {StatusCode::kInvalidArgument,
              "identity '" + name + "': expected 1 to 63 letters, digits, '_' or '-', and not '" +
                  kAuthorities + "'"};
    if (std::find(names.begin(), names.end(), name) != names.end())
      return {StatusCode::kConflict, "identity " + name + " is named twice"};
    names.push_back(name);
  }
  return check_topics(plan);
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
                      ", or by another release; give those, or another folder"};
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

/// Makes a folder beside its place first, so that nobody sees half of one, and what was there stays
/// until then.
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
    return path.filename() == kRevocations ||
           std::find(kIdentityFiles.begin(), kIdentityFiles.end(), path.filename()) !=
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

/// In place of what is there, whole.
Status replace_file(const fs::path& path, const std::string& text, mode_t mode) {
  const fs::path beside = path.parent_path() / ("." + path.filename().string() + ".new");
  ::unlink(beside.c_str());
  NEARMESH_RETURN_IF_ERROR(write_file(beside, text, mode));
  if (::rename(beside.c_str(), path.c_str()) == 0) return Status::ok();
  const Status status = io_error(path);
  ::unlink(beside.c_str());
  return status;
}

/// Serials of all certificates, by name.
using Issued = std::set<std::pair<std::string, std::string>>;

Issued read_issued(const fs::path& authorities) {
  Issued issued;
  std::ifstream in(authorities / kIssued);
  for (std::string serial, name; in >> serial >> name;) issued.emplace(name, serial);
  return issued;
}

/// Sets of before this was kept have what lies in the identities' folders. Of another authority it
/// may have any name, one of two words too, which would part the lines of what was issued.
void add_certificate(const fs::path& identity, X509& authority, Issued& issued) {
  const auto certificate = crypto::read_certificate(identity / kCertificate);
  if (certificate.is_ok() && crypto::is_issued_by(*certificate.value(), authority))
    issued.emplace(crypto::name_of(*certificate.value()), crypto::serial_of(*certificate.value()));
}

/// What is replaced must stay revocable, so it is noted before and after.
Status note_issued(const fs::path& set, const SecurityPlan& plan, X509& authority) {
  const Issued before = read_issued(set / kAuthorities);
  Issued issued = before;
  for (const SecurityPlan::Identity& identity : plan.identities)
    add_certificate(set / identity.name, authority, issued);
  if (issued == before) return Status::ok();
  std::string text;
  for (const auto& [name, serial] : issued) text += serial + " " + name + "\n";
  return replace_file(set / kAuthorities / kIssued, text, kPrivate);
}

Result<Authorities> make_authorities(const fs::path& place, const SecurityPlan& plan,
                                     std::time_t now) {
  NEARMESH_RETURN_IF_ERROR(put_folder(
      place, 0700, [&](const fs::path& folder) { return fill_authorities(folder, plan, now); }));
  return read_authorities(place, plan);
}

Status fill_identity(const fs::path& folder, const SecurityPlan& plan,
                     const SecurityPlan::Identity& identity, const Authorities& authorities,
                     const std::string& revocations, std::time_t now) {
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
  if (!revocations.empty())
    NEARMESH_RETURN_IF_ERROR(write_file(folder / kRevocations, revocations, kPublic));
  return write_file(folder / kPermissions, permissions.value(), kPublic);
}

/// What is in force in a set; number 0 where nothing was ever revoked.
Result<crypto::Revocations> read_list(const fs::path& authorities, X509& authority) {
  const fs::path path = authorities / kRevocations;
  if (!fs::exists(path)) return crypto::Revocations{};
  auto list = crypto::read_revocations(read_file(path), authority);
  if (!list.is_ok())
    return Status{list.status().code(), path.string() + ": " + list.status().message()};
  return list;
}

/// All certificates of these names. Errors: kNotFound.
Result<Issued> certificates_of(const std::vector<std::string>& names, const Issued& issued) {
  std::set<std::string> known;
  for (const auto& [name, serial] : issued) known.insert(name);
  Issued found;
  for (const std::string& name : names) {
    if (!known.contains(name)) {
      std::string all;
      for (const std::string& one : known) all += (all.empty() ? "" : ", ") + one;
      return Status{StatusCode::kNotFound,
                    "no identity " + name + " in this set; it has " + (all.empty() ? "none" : all)};
    }
    for (const auto& one : issued)
      if (one.first == name) found.insert(one);
  }
  return found;
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
  X509& authority = *authorities.value().identity.certificate;
  NEARMESH_RETURN_IF_ERROR(note_issued(set, plan, authority));
  const std::string revocations = read_file(authorities_folder / kRevocations);
  for (const SecurityPlan::Identity& identity : plan.identities)
    NEARMESH_RETURN_IF_ERROR(put_folder(set / identity.name, 0755, [&](const fs::path& made) {
      return fill_identity(made, plan, identity, authorities.value(), revocations, now);
    }));
  return note_issued(set, plan, authority);
}

Result<RevocationReport> revoke_identities(const std::string& folder, const RevocationPlan& plan) {
  const fs::path set = folder, place = set / kAuthorities;
  if (!fs::exists(place))
    return Status{StatusCode::kNotFound, place.string() +
                                             ": not there: whoever revokes needs the authorities' "
                                             "keys; name the set that make-security made"};
  SecurityPlan same;
  same.domain = plan.domain;
  same.prefix = plan.prefix;
  auto authorities = read_authorities(place, same);
  NEARMESH_RETURN_IF_ERROR(authorities);
  const Issuer& authority = authorities.value().identity;
  auto list = read_list(place, *authority.certificate);
  NEARMESH_RETURN_IF_ERROR(list);
  const std::vector<std::string> identities = identities_in(folder);
  Issued issued = read_issued(place);
  for (const std::string& identity : identities)
    add_certificate(identity, *authority.certificate, issued);
  const auto chosen = certificates_of(plan.names, issued);
  NEARMESH_RETURN_IF_ERROR(chosen);
  RevocationReport report;
  const std::time_t now = std::time(nullptr);
  for (const auto& [name, serial] : chosen.value())
    if (list.value().serials.emplace(serial, now).second)
      report.certificates.push_back(name + " " + serial);
  if (!report.certificates.empty()) {
    ++list.value().number;
    const auto signed_list = crypto::sign_revocations(list.value(), now, authority);
    NEARMESH_RETURN_IF_ERROR(signed_list);
    NEARMESH_RETURN_IF_ERROR(replace_file(place / kRevocations, signed_list.value(), kPublic));
  }
  const std::string text = read_file(place / kRevocations);
  for (const std::string& identity : identities) {
    const fs::path path = fs::path(identity) / kRevocations;
    if (read_file(path) != text) NEARMESH_RETURN_IF_ERROR(replace_file(path, text, kPublic));
    report.files.push_back(path.string());
  }
  return report;
}

}  // namespace nearmesh::wire
