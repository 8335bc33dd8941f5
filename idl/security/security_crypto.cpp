// SPDX-License-Identifier: Apache-2.0
#include "security_crypto.hpp"

#include <openssl/bio.h>
#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>

#include <array>

namespace nearmesh::wire::crypto {
namespace {

using Bio = std::unique_ptr<BIO, Freer<BIO_free_all>>;
using Pkcs7 = std::unique_ptr<PKCS7, Freer<PKCS7_free>>;
using Extension = std::unique_ptr<X509_EXTENSION, Freer<X509_EXTENSION_free>>;

using List = std::unique_ptr<X509_CRL, Freer<X509_CRL_free>>;
using Number = std::unique_ptr<ASN1_INTEGER, Freer<ASN1_INTEGER_free>>;
using Time = std::unique_ptr<ASN1_TIME, Freer<ASN1_TIME_free>>;

constexpr std::time_t kDay_s = 24 * 60 * 60;
constexpr std::size_t kSerialBytes = 16;

/// OpenSSL's own words for what went wrong last.
Status refused(StatusCode code, const std::string& what) {
  const unsigned long error = ERR_peek_last_error();
  const char* reason = error == 0 ? nullptr : ERR_reason_error_string(error);
  ERR_clear_error();
  return {code, what + (reason == nullptr ? "" : std::string(": ") + reason)};
}

Bio memory(std::string_view text = {}) {
  if (text.empty()) return Bio(BIO_new(BIO_s_mem()));
  return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

std::string text_of(BIO& bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(&bio, &data);
  return size > 0 ? std::string(data, static_cast<std::size_t>(size)) : std::string();
}

bool add_extension(X509& certificate, int nid, const char* value) {
  const Extension extension(X509V3_EXT_conf_nid(nullptr, nullptr, nid, value));
  return extension != nullptr && X509_add_ext(&certificate, extension.get(), -1) == 1;
}

bool set_serial(X509& certificate) {
  std::array<unsigned char, kSerialBytes> bytes{};
  if (RAND_bytes(bytes.data(), static_cast<int>(bytes.size())) != 1) return false;
  bytes[0] &= 0x7f;  // positive
  const std::unique_ptr<BIGNUM, Freer<BN_free>> number(
      BN_bin2bn(bytes.data(), static_cast<int>(bytes.size()), nullptr));
  return number != nullptr &&
         BN_to_ASN1_INTEGER(number.get(), X509_get_serialNumber(&certificate)) != nullptr;
}

std::string hex_of(const ASN1_INTEGER& number) {
  const std::unique_ptr<BIGNUM, Freer<BN_free>> big(ASN1_INTEGER_to_BN(&number, nullptr));
  const std::unique_ptr<char, void (*)(char*)> text(big == nullptr ? nullptr : BN_bn2hex(big.get()),
                                                    [](char* t) { OPENSSL_free(t); });
  return text == nullptr ? std::string() : std::string(text.get());
}

Number number_of(const std::string& hex) {
  BIGNUM* read = nullptr;
  const bool good = BN_hex2bn(&read, hex.c_str()) == static_cast<int>(hex.size());
  const std::unique_ptr<BIGNUM, Freer<BN_free>> big(read);
  return good ? Number(BN_to_ASN1_INTEGER(big.get(), nullptr)) : nullptr;
}

std::time_t time_of(const ASN1_TIME& time) {
  std::tm parts{};
  return ASN1_TIME_to_tm(&time, &parts) == 1 ? ::timegm(&parts) : 0;
}

}  // namespace

Result<Issuer> make_identity(const std::string& common_name, int valid_days, std::time_t now,
                             const Issuer* issuer) {
  Issuer made{Key(EVP_EC_gen("P-256")), Certificate(X509_new())};
  if (made.key == nullptr || made.certificate == nullptr)
    return refused(StatusCode::kIo, "no key for " + common_name);
  X509& certificate = *made.certificate;
  X509_NAME* subject = X509_get_subject_name(&certificate);
  const bool named =
      X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_ASC,
                                 reinterpret_cast<const unsigned char*>(common_name.data()),
                                 static_cast<int>(common_name.size()), -1, 0) == 1;
  const std::time_t from = now - kDay_s;
  const X509_NAME* by =
      issuer == nullptr ? subject : X509_get_subject_name(issuer->certificate.get());
  const bool filled =
      named && X509_set_version(&certificate, X509_VERSION_3) == 1 && set_serial(certificate) &&
      X509_set_issuer_name(&certificate, by) == 1 &&
      ASN1_TIME_set(X509_getm_notBefore(&certificate), from) != nullptr &&
      ASN1_TIME_adj(X509_getm_notAfter(&certificate), now, valid_days, 0) != nullptr &&
      X509_set_pubkey(&certificate, made.key.get()) == 1;
  // An authority signs certificates (of identities) and documents; an identity proves itself.
  const bool extended =
      filled &&
      add_extension(certificate, NID_basic_constraints,
                    issuer == nullptr ? "critical,CA:TRUE,pathlen:0" : "critical,CA:FALSE") &&
      add_extension(certificate, NID_key_usage,
                    issuer == nullptr ? "critical,keyCertSign,cRLSign,digitalSignature"
                                      : "critical,digitalSignature,keyAgreement");
  EVP_PKEY* with = issuer == nullptr ? made.key.get() : issuer->key.get();
  if (!extended || X509_sign(&certificate, with, EVP_sha256()) == 0)
    return refused(StatusCode::kIo, "no certificate for " + common_name);
  return made;
}

Result<std::string> sign(const std::string& text, const Issuer& signer) {
  constexpr int kFlags = PKCS7_TEXT | PKCS7_DETACHED | PKCS7_STREAM;
  const Bio in = memory(text);
  const Bio out = memory();
  const Pkcs7 signature(
      PKCS7_sign(signer.certificate.get(), signer.key.get(), nullptr, in.get(), kFlags));
  if (signature == nullptr || SMIME_write_PKCS7(out.get(), signature.get(), in.get(), kFlags) != 1)
    return refused(StatusCode::kIo, "no signature");
  return text_of(*out);
}

Result<std::string> verify_signed(const std::string& path, X509& authority) {
  const Bio in(BIO_new_file(path.c_str(), "r"));
  if (in == nullptr) return refused(StatusCode::kIo, path);
  BIO* content = nullptr;
  const Pkcs7 signature(SMIME_read_PKCS7(in.get(), &content));
  const Bio owned(content);
  if (signature == nullptr) return refused(StatusCode::kCorrupt, "not an S/MIME document");
  const Bio out = memory();
  const std::unique_ptr<STACK_OF(X509), void (*)(STACK_OF(X509)*)> signers(
      sk_X509_new_null(), [](STACK_OF(X509) * stack) { sk_X509_free(stack); });
  sk_X509_push(signers.get(), &authority);
  // Of the authority itself, whoever else's certificate comes along; validity in time is judged
  // elsewhere.
  constexpr int kFlags = PKCS7_TEXT | PKCS7_NOINTERN | PKCS7_NOVERIFY;
  if (PKCS7_verify(signature.get(), signers.get(), nullptr, content, out.get(), kFlags) != 1)
    return refused(StatusCode::kConflict, "signature does not verify");
  return text_of(*out);
}

int no_passphrase(char*, int, int, void*) { return -1; }

std::string to_pem(X509& certificate) {
  const Bio out = memory();
  PEM_write_bio_X509(out.get(), &certificate);
  return text_of(*out);
}

Result<std::string> to_pem(EVP_PKEY& key) {
  const Bio out = memory();
  if (PEM_write_bio_PrivateKey(out.get(), &key, nullptr, nullptr, 0, nullptr, nullptr) != 1)
    return refused(StatusCode::kIo, "private key");
  return text_of(*out);
}

Result<Certificate> read_certificate(const std::string& path) {
  const Bio in(BIO_new_file(path.c_str(), "r"));
  if (in == nullptr) return refused(StatusCode::kIo, path);
  Certificate certificate(PEM_read_bio_X509(in.get(), nullptr, no_passphrase, nullptr));
  if (certificate == nullptr) return refused(StatusCode::kCorrupt, "not a certificate in PEM");
  return certificate;
}

Result<Key> read_key(const std::string& path) {
  const Bio in(BIO_new_file(path.c_str(), "r"));
  if (in == nullptr) return refused(StatusCode::kIo, path);
  Key key(PEM_read_bio_PrivateKey(in.get(), nullptr, no_passphrase, nullptr));
  if (key == nullptr) return refused(StatusCode::kCorrupt, "not a private key in PEM");
  return key;
}

bool is_issued_by(X509& certificate, X509& authority) {
  const bool issued = X509_check_issued(&authority, &certificate) == X509_V_OK &&
                      X509_verify(&certificate, X509_get0_pubkey(&authority)) == 1;
  ERR_clear_error();
  return issued;
}

std::string subject_of(X509& certificate) {
  const Bio out = memory();
  X509_NAME_print_ex(out.get(), X509_get_subject_name(&certificate), 0, XN_FLAG_RFC2253);
  return text_of(*out);
}

std::string name_of(X509& certificate) {
  const std::string subject = subject_of(certificate);
  return subject.starts_with("CN=") ? subject.substr(3) : subject;
}

std::string serial_of(X509& certificate) { return hex_of(*X509_get0_serialNumber(&certificate)); }

std::time_t end_of(X509& certificate) { return time_of(*X509_get0_notAfter(&certificate)); }

Result<std::string> sign_revocations(const Revocations& revoked, std::time_t now,
                                     const Issuer& authority) {
  const List list(X509_CRL_new());
  const Time from(ASN1_TIME_set(nullptr, now - kDay_s));
  const Number number(ASN1_INTEGER_new());
  bool good =
      list != nullptr && from != nullptr && number != nullptr &&
      ASN1_INTEGER_set_int64(number.get(), revoked.number) == 1 &&
      X509_CRL_set_version(list.get(), X509_CRL_VERSION_2) == 1 &&
      X509_CRL_set_issuer_name(list.get(), X509_get_subject_name(authority.certificate.get())) ==
          1 &&
      X509_CRL_set1_lastUpdate(list.get(), from.get()) == 1 &&
      X509_CRL_set1_nextUpdate(list.get(), X509_get0_notAfter(authority.certificate.get())) == 1 &&
      X509_CRL_add1_ext_i2d(list.get(), NID_crl_number, number.get(), 0, 0) == 1;
  for (const auto& [serial, since] : revoked.serials) {
    if (!good) break;
    std::unique_ptr<X509_REVOKED, Freer<X509_REVOKED_free>> entry(X509_REVOKED_new());
    const Number named = number_of(serial);
    const Time when(ASN1_TIME_set(nullptr, since));
    good = entry != nullptr && named != nullptr && when != nullptr &&
           X509_REVOKED_set_serialNumber(entry.get(), named.get()) == 1 &&
           X509_REVOKED_set_revocationDate(entry.get(), when.get()) == 1 &&
           X509_CRL_add0_revoked(list.get(), entry.get()) == 1;
    if (good) static_cast<void>(entry.release());
  }
  good = good && X509_CRL_sort(list.get()) == 1 &&
         X509_CRL_sign(list.get(), authority.key.get(), EVP_sha256()) != 0;
  const Bio out = memory();
  if (!good || PEM_write_bio_X509_CRL(out.get(), list.get()) != 1)
    return refused(StatusCode::kIo, "no revocation list");
  return text_of(*out);
}

Result<Revocations> read_revocations(const std::string& pem, X509& authority) {
  const Bio in = memory(pem);
  const List list(PEM_read_bio_X509_CRL(in.get(), nullptr, no_passphrase, nullptr));
  if (list == nullptr) return refused(StatusCode::kCorrupt, "not a revocation list in PEM");
  if (X509_NAME_cmp(X509_CRL_get_issuer(list.get()), X509_get_subject_name(&authority)) != 0 ||
      X509_CRL_verify(list.get(), X509_get0_pubkey(&authority)) != 1)
    return refused(StatusCode::kConflict, "signature does not verify");
  Revocations found;
  const Number number(static_cast<ASN1_INTEGER*>(
      X509_CRL_get_ext_d2i(list.get(), NID_crl_number, nullptr, nullptr)));
  // Others' tools may leave the number out.
  if (number == nullptr || ASN1_INTEGER_get_int64(&found.number, number.get()) != 1)
    found.number = time_of(*X509_CRL_get0_lastUpdate(list.get()));
  STACK_OF(X509_REVOKED)* const entries = X509_CRL_get_REVOKED(list.get());
  for (int i = 0; i < sk_X509_REVOKED_num(entries); ++i) {
    const X509_REVOKED* entry = sk_X509_REVOKED_value(entries, i);
    found.serials.emplace(hex_of(*X509_REVOKED_get0_serialNumber(entry)),
                          time_of(*X509_REVOKED_get0_revocationDate(entry)));
  }
  ERR_clear_error();
  return found;
}

}  // namespace nearmesh::wire::crypto
