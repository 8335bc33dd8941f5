// SPDX-License-Identifier: Apache-2.0
#include "identity_book.hpp"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <mutex>
#include <sstream>

#include "security_crypto.hpp"
#include "security_documents.hpp"

namespace nearmesh::wire {
namespace {

/// Checked certificates that are remembered: the same ones come in every handshake.
constexpr std::size_t kMaxKnown = 1024;
constexpr std::size_t kMaxCertificateBytes = 16384;

std::optional<std::string> text_of_file(const std::string& path) {
  std::ifstream in(path);
  if (!in) return std::nullopt;
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

IdentityFacts read_facts(X509& certificate, X509& authority) {
  IdentityFacts facts;
  facts.name = crypto::name_of(certificate);
  facts.serial = crypto::serial_of(certificate);
  facts.end = std::min(crypto::end_of(certificate), crypto::end_of(authority));
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  X509_NAME_digest(X509_get_subject_name(&certificate), EVP_sha256(), digest.data(), &length);
  facts.key_start[0] = static_cast<std::uint8_t>(0x80 | digest[0] >> 1);
  for (std::size_t i = 1; i < facts.key_start.size(); ++i)
    facts.key_start[i] = static_cast<std::uint8_t>(digest[i - 1] << 7 | digest[i] >> 1);
  return facts;
}

/// What tells that a file has changed.
using Stamp = std::array<std::int64_t, 4>;

Stamp stamp_of(const std::string& path) {
  struct stat facts {};
  if (::stat(path.c_str(), &facts) != 0) return {};
  return {facts.st_mtim.tv_sec, facts.st_mtim.tv_nsec, static_cast<std::int64_t>(facts.st_ino),
          facts.st_size};
}

}  // namespace

struct IdentityBook::Impl {
  mutable std::mutex mutex;
  std::string path;
  crypto::Certificate authority;
  IdentityFacts own;
  crypto::Revocations revoked;
  Stamp read{}, refused{}, said{};
  std::map<std::string, IdentityFacts> known;

  std::string refresh() {
    const Stamp now = stamp_of(path);
    if (now == Stamp{} || now == read || now == said) return "";
    const std::optional<std::string> text = text_of_file(path);
    if (!text) return "";
    auto list = crypto::read_revocations(*text, *authority);
    if (!list.is_ok())
      return refuse(now, list.status().code() == StatusCode::kConflict
                             ? "not signed by the set's authority"
                             : list.status().message());
    if (list.value().number < revoked.number ||
        (list.value().number == revoked.number && list.value().serials != revoked.serials))
      return refuse(now, "list " + std::to_string(list.value().number) + " is older than list " +
                             std::to_string(revoked.number));
    std::string line;
    if (list.value().number != revoked.number) {
      const std::size_t count = list.value().serials.size();
      line = path + ": list " + std::to_string(list.value().number) + " is in force, " +
             std::to_string(count) +
             (count == 1 ? " certificate is revoked" : " certificates are revoked");
      revoked = std::move(list).value();
    }
    read = now;
    return line;
  }

  /// Said at the second look: the file may just be being copied.
  std::string refuse(const Stamp& now, const std::string& why) {
    if (now != refused) {
      refused = now;
      return "";
    }
    std::string line =
        path + ": " + why + ": what was in force before stays; copy it again from the set";
    said = now;
    return line;
  }
};

IdentityBook::IdentityBook() : impl_(std::make_unique<Impl>()) {}
IdentityBook::~IdentityBook() = default;

Result<std::unique_ptr<IdentityBook>> IdentityBook::open(const IdentityPaths& paths) {
  std::unique_ptr<IdentityBook> book(new IdentityBook);
  auto authority = crypto::read_certificate(paths.authority);
  NEARMESH_RETURN_IF_ERROR(authority);
  auto own = crypto::read_certificate(paths.certificate);
  NEARMESH_RETURN_IF_ERROR(own);
  Impl& impl = *book->impl_;
  impl.authority = std::move(authority).value();
  impl.own = read_facts(*own.value(), *impl.authority);
  impl.path = paths.revocations;
  const std::string ignored = impl.refresh();
  return book;
}

std::string IdentityBook::refresh() {
  const std::lock_guard lock(impl_->mutex);
  return impl_->refresh();
}

std::optional<IdentityFacts> IdentityBook::facts_of(std::span<const std::uint8_t> pem) {
  if (pem.empty() || pem.size() > kMaxCertificateBytes) return std::nullopt;
  const std::string text(pem.begin(), pem.end());
  {
    const std::lock_guard lock(impl_->mutex);
    if (const auto at = impl_->known.find(text); at != impl_->known.end()) return at->second;
  }
  // As Fast DDS reads it, but that nobody is asked for a passphrase.
  const std::unique_ptr<BIO, crypto::Freer<BIO_free_all>> in(
      BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  const crypto::Certificate certificate(
      PEM_read_bio_X509_AUX(in.get(), nullptr, crypto::no_passphrase, nullptr));
  ERR_clear_error();
  if (certificate == nullptr) return std::nullopt;
  if (!crypto::is_issued_by(*certificate, *impl_->authority)) return std::nullopt;
  const IdentityFacts facts = read_facts(*certificate, *impl_->authority);
  const std::lock_guard lock(impl_->mutex);
  if (impl_->known.size() >= kMaxKnown) impl_->known.clear();
  impl_->known.emplace(text, facts);
  return facts;
}

std::string IdentityBook::fault_of(const IdentityFacts& facts, std::time_t now) const {
  const std::lock_guard lock(impl_->mutex);
  if (impl_->revoked.serials.contains(facts.serial)) return "was revoked";
  if (facts.end < now) return "expired on " + date_of(facts.end);
  return "";
}

const IdentityFacts& IdentityBook::own() const { return impl_->own; }

}  // namespace nearmesh::wire
