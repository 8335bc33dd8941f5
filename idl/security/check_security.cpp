// SPDX-License-Identifier: Apache-2.0
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>

#include "security_crypto.hpp"
#include "security_documents.hpp"
#include "security_folder.hpp"

namespace nearmesh::wire {
namespace {

namespace fs = std::filesystem;

const std::string kMakeAgain = "make the identity again: make-security --force";
const std::string kCopyFromSet = "copy it again from the set in which make-security made it";

/// Nothing: there is none.
std::optional<Result<crypto::Revocations>> list_in(const fs::path& folder, X509& authority) {
  std::ifstream in(folder / kRevocations);
  if (!in) return std::nullopt;
  std::ostringstream text;
  text << in.rdbuf();
  return crypto::read_revocations(text.str(), authority);
}

class Check {
 public:
  Check(const std::string& folder, std::uint32_t domain, const std::string& prefix, std::time_t now)
      : folder_(folder), domain_(domain), prefix_(prefix), now_(now) {}

  std::vector<SecurityFault> run() {
    for (const char* name : kIdentityFiles)
      if (!fs::is_regular_file(fs::path(folder_) / name)) fault(name, "missing", kCopyFromSet);
    if (!faults_.empty()) return std::move(faults_);
    const crypto::Certificate identity_ca = read_certificate(kIdentityCa),
                              permissions_ca = read_certificate(kPermissionsCa),
                              certificate = read_certificate(kCertificate);
    if (certificate != nullptr && identity_ca != nullptr &&
        !crypto::is_issued_by(*certificate, *identity_ca))
      fault(kCertificate, std::string("not signed by ") + kIdentityCa,
            "take both from one set; " + kMakeAgain);
    check_key(certificate.get());
    if (certificate != nullptr && identity_ca != nullptr) check_list(*certificate, *identity_ca);
    if (permissions_ca == nullptr) return std::move(faults_);
    if (const std::string text = read_signed(kGovernance, *permissions_ca); !text.empty())
      judge(kGovernance, judge_governance(text, domain_, prefix_),
            "make a set for this --domain and --prefix, in another folder");
    if (const std::string text = read_signed(kPermissions, *permissions_ca);
        !text.empty() && certificate != nullptr)
      judge(kPermissions,
            judge_permissions(text, crypto::subject_of(*certificate), domain_, prefix_, now_),
            "start with the --domain and --prefix of make-security, or " + kMakeAgain);
    return std::move(faults_);
  }

 private:
  [[nodiscard]] std::string path_of(const char* name) const {
    return (fs::path(folder_) / name).string();
  }

  void fault(const char* name, const std::string& what, const std::string& cure) {
    faults_.push_back({path_of(name), what, cure});
  }

  void judge(const char* name, const std::string& what, const std::string& cure) {
    if (!what.empty()) fault(name, what, cure);
  }

  crypto::Certificate read_certificate(const char* name) {
    auto read = crypto::read_certificate(path_of(name));
    if (!read.is_ok()) {
      fault(name, "cannot be read (" + read.status().message() + ")", kCopyFromSet);
      return nullptr;
    }
    crypto::Certificate certificate = std::move(read).value();
    std::time_t now = now_;
    if (X509_cmp_time(X509_get0_notBefore(certificate.get()), &now) > 0)
      fault(name, "not valid yet", "set this machine's clock, or " + kMakeAgain);
    if (X509_cmp_time(X509_get0_notAfter(certificate.get()), &now) < 0)
      fault(name, "expired",
            std::string_view(name) == kCertificate ? kMakeAgain
                                                   : "make a new set, in another folder");
    return certificate;
  }

  void check_key(X509* certificate) {
    struct stat facts {};
    if (::stat(path_of(kPrivateKey).c_str(), &facts) == 0 && (facts.st_mode & 077) != 0)
      fault(kPrivateKey, "can be read by others than its owner",
            "chmod 600 " + path_of(kPrivateKey) + ", and if others were here " + kMakeAgain);
    const auto key = crypto::read_key(path_of(kPrivateKey));
    if (!key.is_ok()) {
      fault(kPrivateKey, "cannot be read (" + key.status().message() + ")", kCopyFromSet);
    } else if (certificate != nullptr &&
               X509_check_private_key(certificate, key.value().get()) != 1) {
      fault(kPrivateKey, std::string("does not belong to ") + kCertificate,
            "take both from one folder; " + kMakeAgain);
    }
  }

  void check_list(X509& certificate, X509& authority) {
    const auto list = list_in(folder_, authority);
    if (!list) return;
    if (!list->is_ok()) {
      fault(kRevocations,
            list->status().code() == StatusCode::kConflict
                ? std::string("not signed by ") + kIdentityCa + ", or changed since"
                : "cannot be read (" + list->status().message() + ")",
            kCopyFromSet);
    } else if (list->value().serials.contains(crypto::serial_of(certificate))) {
      fault(kCertificate,
            "revoked on " + date_of(list->value().serials.at(crypto::serial_of(certificate))),
            kMakeAgain);
    }
  }

  std::string read_signed(const char* name, X509& authority) {
    auto text = crypto::verify_signed(path_of(name), authority);
    if (text.is_ok()) return std::move(text).value();
    fault(name,
          text.status().code() == StatusCode::kConflict
              ? std::string("not signed by ") + kPermissionsCa + ", or changed since"
              : "cannot be read (" + text.status().message() + ")",
          kCopyFromSet);
    return "";
  }

  const std::string folder_;
  const std::uint32_t domain_;
  const std::string prefix_;
  const std::time_t now_;
  std::vector<SecurityFault> faults_;
};

bool is_identity(const fs::path& folder) {
  return std::any_of(kIdentityFiles.begin(), kIdentityFiles.end(),
                     [&](const char* name) { return fs::exists(folder / name); });
}

}  // namespace

std::vector<SecurityFault> check_security(const std::string& identity_folder, std::uint32_t domain,
                                          const std::string& prefix, std::time_t now) {
  return Check(identity_folder, domain, prefix, now).run();
}

std::string describe_identity(const std::string& identity_folder) {
  const fs::path folder = identity_folder;
  const auto certificate = crypto::read_certificate(folder / kCertificate);
  const auto authority = crypto::read_certificate(folder / kIdentityCa);
  if (!certificate.is_ok() || !authority.is_ok()) return "";
  std::time_t end =
      std::min(crypto::end_of(*certificate.value()), crypto::end_of(*authority.value()));
  // An identity that was added later may outlive the authorities, and then nobody takes it.
  if (const auto other = crypto::read_certificate(folder / kPermissionsCa); other.is_ok())
    end = std::min(end, crypto::end_of(*other.value()));
  const std::string until = "valid until " + date_of(end);
  const auto list = list_in(folder, *authority.value());
  if (!list || !list->is_ok()) return until;
  const std::size_t count = list->value().serials.size();
  return until + ", revocation list " + std::to_string(list->value().number) + ": " +
         std::to_string(count) + (count == 1 ? " certificate" : " certificates");
}

std::vector<std::string> identities_in(const std::string& folder) {
  if (is_identity(folder)) return {folder};
  std::vector<std::string> found;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
    if (entry.is_directory(error) && entry.path().filename() != "private" &&
        is_identity(entry.path()))
      found.push_back(entry.path().string());
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace nearmesh::wire
