// SPDX-License-Identifier: Apache-2.0
#pragma once
// The files of DDS Security for a set of nearmesh programs: making them, and saying what is wrong
// with some. No Fast DDS here. An identity is a folder with six files, all that its program needs:
//   identity_ca.cert.pem  permissions_ca.cert.pem  cert.pem  key.pem  governance.p7s
//   permissions.p7s
// and, once an identity of the set was revoked, identity_crl.pem: the certificates that count no
// more. The set's folder holds one for each identity, and in private/ the keys of the two
// authorities, which no program needs, and what they have issued.
// Two authorities: Fast DDS 2.9 takes permissions that anybody signed whose certificate is of the
// permissions authority, so with one for both, each identity could sign its own. Source: OMG DDS
// Security 1.1, sections 9.3 and 9.4.

#include <cstdint>
#include <ctime>
#include <string>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire {

/// All may join; what a role may write and read is in the table of topics.
[[nodiscard]] const char* to_string(Role role);

struct SecurityPlan {
  std::uint32_t domain = 0;
  std::string prefix = "nearmesh";  ///< of the topics
  struct Identity {
    /// 1 to 63 of [A-Za-z0-9_-]; the certificate's common name and the folder's name.
    std::string name;
    Role role = Role::kSubscriber;
  };
  std::vector<Identity> identities;
  /// Other topics that these identities may write and read, as a host's own are, of
  /// [A-Za-z0-9_-./:~]: as many as a handshake has room for. One that ends in "/*" is all that
  /// begin alike. None is nearmesh's own.
  std::vector<std::string> topics;
  /// Of everything made, from a day ago, for clocks that differ; 1 to 36,500.
  int valid_days = 365;
  bool force = false;  ///< make identities anew that exist
};

/// Makes the identities and, in a folder without them, the authorities: P-256 keys, mode 0600. An
/// authority that is there is never replaced; another set is another folder.
/// Errors: kInvalidArgument naming the option; kConflict for an identity that exists (without
/// force), a folder of its name that holds anything else, or a set made for another domain or
/// prefix; kIo naming the file. Nothing is half made: an identity's folder appears when it is
/// complete.
[[nodiscard]] Status make_security(const std::string& folder, const SecurityPlan& plan);

struct RevocationPlan {
  std::uint32_t domain = 0;
  std::string prefix = "nearmesh";
  std::vector<std::string> names;  ///< of identities of the set
};
struct RevocationReport {
  std::vector<std::string> certificates;  ///< "alice 3F…": those that are new on the list
  /// The lists in the identities' folders, all with the same bytes.
  std::vector<std::string> files;
};
/// Takes back every certificate that the set has issued in these names, and writes the list into
/// each identity's folder. Certificates that are made for the names later count. What is revoked
/// already stays so: then nothing is new.
/// Errors: kNotFound for a name that the set does not have, naming those that it has; kConflict,
/// kIo as make_security.
[[nodiscard]] Result<RevocationReport> revoke_identities(const std::string& folder,
                                                         const RevocationPlan& plan);

/// One line for the operator: which file, what is wrong, and what to do.
struct SecurityFault {
  std::string file, what, cure;
  [[nodiscard]] std::string line() const { return file + ": " + what + "; " + cure; }
};

/// What is wrong with one identity's folder, for programs on this domain and prefix; empty when all
/// is well, as of `now`. Reads nothing but the folder's files. The role is the one whose topics are
/// named most.
[[nodiscard]] std::vector<SecurityFault> check_security(const std::string& identity_folder,
                                                        std::uint32_t domain,
                                                        const std::string& prefix,
                                                        std::time_t now = std::time(nullptr));

/// What an operator wants to know of an identity that is good: "valid until 2027-11-22T…, 1
/// certificate of the set is revoked".
[[nodiscard]] std::string describe_identity(const std::string& identity_folder);

/// The identities' folders of a set, sorted; or `folder` itself where it is one (it has one of the
/// six files).
[[nodiscard]] std::vector<std::string> identities_in(const std::string& folder);

}  // namespace nearmesh::wire
