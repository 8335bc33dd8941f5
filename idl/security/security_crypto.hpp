// SPDX-License-Identifier: Apache-2.0
#pragma once
// The little of OpenSSL that security files need. Errors: kIo naming the file, kCorrupt for bytes
// that are something else.

#include <openssl/evp.h>
#include <openssl/x509.h>

#include <cstdint>
#include <ctime>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::wire::crypto {

template <auto Free>
struct Freer {
  template <class T>
  void operator()(T* object) const {
    Free(object);
  }
};
using Key = std::unique_ptr<EVP_PKEY, Freer<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Freer<X509_free>>;

struct Issuer {
  Key key;
  Certificate certificate;
};

/// A P-256 key with a certificate on it, from a day before `now`; signed by `issuer`, or by itself
/// (an authority) for nullptr.
[[nodiscard]] Result<Issuer> make_identity(const std::string& common_name, int valid_days,
                                           std::time_t now, const Issuer* issuer);

/// `text` with its signature, as S/MIME.
[[nodiscard]] Result<std::string> sign(const std::string& text, const Issuer& signer);
/// The text, if a signature by `authority` itself is on it.
[[nodiscard]] Result<std::string> verify_signed(const std::string& path, X509& authority);

/// For OpenSSL's readers of PEM, which else ask at the terminal, and wait there: a program that
/// starts by itself has nobody to ask.
int no_passphrase(char* buffer, int size, int is_written, void* user);
[[nodiscard]] std::string to_pem(X509& certificate);
[[nodiscard]] Result<std::string> to_pem(EVP_PKEY& key);
[[nodiscard]] Result<Certificate> read_certificate(const std::string& path);
[[nodiscard]] Result<Key> read_key(const std::string& path);

[[nodiscard]] bool is_issued_by(X509& certificate, X509& authority);
/// By RFC 2253, as permissions name it: "CN=alice".
[[nodiscard]] std::string subject_of(X509& certificate);
/// Of the identity: "alice".
[[nodiscard]] std::string name_of(X509& certificate);
/// In hexadecimal: names a certificate among those of its authority.
[[nodiscard]] std::string serial_of(X509& certificate);
/// The last moment at which it is valid.
[[nodiscard]] std::time_t end_of(X509& certificate);

/// What an authority takes back (RFC 5280, chapter 5).
struct Revocations {
  std::int64_t number = 0;                     ///< of the list; a later one has a higher
  std::map<std::string, std::time_t> serials;  ///< since when
};
/// A list in PEM, from a day before `now`, for clocks that differ; valid as long as the authority
/// itself.
[[nodiscard]] Result<std::string> sign_revocations(const Revocations& revoked, std::time_t now,
                                                   const Issuer& authority);
/// kConflict where it is not signed by the authority.
[[nodiscard]] Result<Revocations> read_revocations(const std::string& pem, X509& authority);

}  // namespace nearmesh::wire::crypto
