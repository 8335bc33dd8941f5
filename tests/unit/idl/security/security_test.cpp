// SPDX-License-Identifier: Apache-2.0
#include "idl/security/security.hpp"

#include <gtest/gtest.h>
#include <openssl/ui.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "idl/security/identity_book.hpp"
#include "idl/security/security_crypto.hpp"
#include "idl/security/security_documents.hpp"
#include "tests/support/folder.hpp"

namespace nearmesh::wire {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kDomain = 5;
constexpr std::time_t kYear_s = 366 * 24 * 60 * 60;
const std::string kPrefix = "site";

class Security : public ::testing::Test {
 protected:
  Security() {
    EXPECT_TRUE(make("set").is_ok());
    alice = folder + "/set/alice";
  }

  static SecurityPlan plan() {
    SecurityPlan plan;
    plan.domain = kDomain;
    plan.prefix = kPrefix;
    plan.identities = {
        {"serve", Role::kPublisher}, {"alice", Role::kSubscriber}, {"rec", Role::kRecorder}};
    return plan;
  }
  [[nodiscard]] Status make(const std::string& set) const {
    return make_security(folder + "/" + set, plan());
  }
  static std::string read(const std::string& path) {
    std::ifstream in(path);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
  }
  static void write(const std::string& path, const std::string& text) {
    std::ofstream(path) << text;
  }
  // Alice's file with another's content.
  void take_from(const std::string& other, const std::string& file) const {
    write(alice + "/" + file, read(folder + "/" + other + "/" + file));
  }
  // Alice's permissions with a change, signed again by the set's authority.
  void change_permissions(const std::string& from, const std::string& to) const {
    const std::string authority = folder + "/set/private/permissions_ca";
    auto certificate = crypto::read_certificate(authority + ".cert.pem");
    auto key = crypto::read_key(authority + ".key.pem");
    ASSERT_TRUE(certificate.is_ok() && key.is_ok());
    auto text = crypto::verify_signed(alice + "/permissions.p7s", *certificate.value());
    ASSERT_TRUE(text.is_ok());
    std::string changed = text.value();
    const auto at = changed.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    changed.replace(at, from.size(), to);
    const auto text_again =
        crypto::sign(changed, {std::move(key).value(), std::move(certificate).value()});
    ASSERT_TRUE(text_again.is_ok());
    write(alice + "/permissions.p7s", text_again.value());
  }
  // What is said of alice: one line, of this file, with these words.
  void expect_fault(const std::string& file, const std::string& what,
                    std::time_t now = std::time(nullptr)) const {
    std::string lines;
    bool found = false;
    for (const SecurityFault& fault : check_security(alice, kDomain, kPrefix, now)) {
      lines += fault.line() + "\n";
      found |= fault.file == alice + "/" + file && fault.what.find(what) != std::string::npos &&
               !fault.cure.empty();
    }
    EXPECT_TRUE(found) << file << " " << what << ", found:\n" << lines;
  }
  void expect_only_fault(const std::string& file, const std::string& what) const {
    expect_fault(file, what);
    EXPECT_EQ(check_security(alice, kDomain, kPrefix).size(), 1U);
  }

  const nearmesh::test::Folder scratch;
  const std::string folder = scratch.path();
  std::string alice;
};

TEST_F(Security, WhatIsMadeIsGoodForEveryRole) {
  const auto identities = identities_in(folder + "/set");
  ASSERT_EQ(identities.size(), 3U);
  for (const std::string& identity : identities)
    EXPECT_TRUE(check_security(identity, kDomain, kPrefix).empty()) << identity;
  EXPECT_EQ(identities_in(alice), std::vector{alice});
  EXPECT_TRUE(identities_in(folder + "/nowhere").empty());
}

TEST_F(Security, PrivateKeysAreForTheirOwnerAlone) {
  for (const char* file :
       {"alice/key.pem", "private/identity_ca.key.pem", "private/permissions_ca.key.pem"}) {
    struct stat facts {};
    ASSERT_EQ(::stat((folder + "/set/" + file).c_str(), &facts), 0) << file;
    EXPECT_EQ(facts.st_mode & 0777, 0600U) << file;
  }
}

TEST_F(Security, NothingIsOverwrittenWithoutForce) {
  const std::string key = read(alice + "/key.pem");
  EXPECT_EQ(make("set").code(), StatusCode::kConflict);
  EXPECT_EQ(read(alice + "/key.pem"), key);
  SecurityPlan again = plan();
  again.identities = {{"alice", Role::kSubscriber}};
  again.force = true;
  EXPECT_TRUE(make_security(folder + "/set", again).is_ok());
  EXPECT_NE(read(alice + "/key.pem"), key);
  EXPECT_TRUE(check_security(alice, kDomain, kPrefix).empty());
}

// --force is for identities; a folder of the user's that has a name of the plan stays.
TEST_F(Security, ForceReplacesNothingButIdentities) {
  SecurityPlan again = plan();
  again.identities = {{"serve", Role::kPublisher}, {"alice", Role::kSubscriber}};
  again.force = true;
  std::ofstream(alice + "/thesis.txt") << "ten years";
  const std::string key = read(folder + "/set/serve/key.pem");
  const Status status = make_security(folder + "/set", again);
  EXPECT_EQ(status.code(), StatusCode::kConflict);
  EXPECT_NE(status.message().find(alice + "/thesis.txt"), std::string::npos) << status.message();
  EXPECT_EQ(read(alice + "/thesis.txt"), "ten years");
  EXPECT_EQ(read(folder + "/set/serve/key.pem"), key);
  again.identities = {{"file", Role::kPublisher}};
  std::ofstream(folder + "/set/file") << "mine";
  EXPECT_EQ(make_security(folder + "/set", again).code(), StatusCode::kConflict);
  EXPECT_EQ(read(folder + "/set/file"), "mine");
}

TEST_F(Security, SetIsAddedToWithItsOwnAuthorities) {
  SecurityPlan more = plan();
  more.identities = {{"bob", Role::kSubscriber}};
  EXPECT_TRUE(make_security(folder + "/set", more).is_ok());
  EXPECT_EQ(read(folder + "/set/bob/identity_ca.cert.pem"), read(alice + "/identity_ca.cert.pem"));
  more.identities = {{"eve", Role::kSubscriber}};
  more.domain = kDomain + 1;
  EXPECT_EQ(make_security(folder + "/set", more).code(), StatusCode::kConflict);
  EXPECT_FALSE(fs::exists(folder + "/set/eve"));
}

TEST_F(Security, NamesAndDaysAreChecked) {
  for (const std::string name : {"", "a/b", "..", "private", "-x", "a b"}) {
    SecurityPlan bad = plan();
    bad.identities = {{name, Role::kRecorder}};
    EXPECT_EQ(make_security(folder + "/bad", bad).code(), StatusCode::kInvalidArgument) << name;
  }
  SecurityPlan twice = plan();
  twice.identities = {{"a", Role::kRecorder}, {"a", Role::kPublisher}};
  EXPECT_EQ(make_security(folder + "/bad", twice).code(), StatusCode::kConflict);
  SecurityPlan days = plan();
  days.valid_days = 0;
  EXPECT_EQ(make_security(folder + "/bad", days).code(), StatusCode::kInvalidArgument);
  EXPECT_FALSE(fs::exists(folder + "/bad"));
}

// --- Broken sets

TEST_F(Security, MissingFile) {
  fs::remove(alice + "/governance.p7s");
  expect_only_fault("governance.p7s", "missing");
}

TEST_F(Security, GarbageInPlaceOfACertificate) {
  write(alice + "/cert.pem", "garbage");
  expect_only_fault("cert.pem", "cannot be read");
}

// A handshake of a stranger, too, may hold bytes that say that they are encrypted.
TEST_F(Security, NobodyIsAskedForAPassphrase) {
  static int asked;
  asked = 0;
  UI_METHOD* const counting = UI_create_method("counts who asks");
  UI_method_set_opener(counting, [](UI*) {
    ++asked;
    return 0;
  });
  UI_set_default_method(counting);
  const auto locked = [](const std::string& kind) {
    return "-----BEGIN " + kind + "-----\nProc-Type: 4,ENCRYPTED\nDEK-Info: AES-128-CBC," +
           std::string(32, 'A') + "\n\n" + std::string(64, 'A') + "\n-----END " + kind + "-----\n";
  };
  const std::string set = folder + "/set/serve/", certificate = locked("CERTIFICATE");
  const auto book = IdentityBook::open(
      {set + "identity_ca.cert.pem", set + "cert.pem", set + "identity_crl.pem"});
  ASSERT_TRUE(book.is_ok());
  EXPECT_FALSE(book.value()
                   ->facts_of({reinterpret_cast<const std::uint8_t*>(certificate.data()),
                               certificate.size()})
                   .has_value());
  write(alice + "/identity_crl.pem", locked("X509 CRL"));
  expect_only_fault("identity_crl.pem", "cannot be read");
  write(alice + "/cert.pem", certificate);
  expect_fault("cert.pem", "cannot be read");
  write(alice + "/key.pem", locked("EC PRIVATE KEY"));
  expect_fault("key.pem", "cannot be read");
  EXPECT_EQ(asked, 0);
  UI_set_default_method(UI_OpenSSL());
  UI_destroy_method(counting);
}

TEST_F(Security, GarbageInPlaceOfAKey) {
  write(alice + "/key.pem", "garbage");
  expect_only_fault("key.pem", "cannot be read");
}

TEST_F(Security, GarbageInPlaceOfPermissions) {
  write(alice + "/permissions.p7s", "garbage");
  expect_only_fault("permissions.p7s", "cannot be read");
}

TEST_F(Security, Expired) {
  expect_fault("cert.pem", "expired", std::time(nullptr) + kYear_s);
  expect_fault("identity_ca.cert.pem", "expired", std::time(nullptr) + kYear_s);
  expect_fault("permissions.p7s", "expired on", std::time(nullptr) + kYear_s);
}

TEST_F(Security, NotValidYet) {
  expect_fault("cert.pem", "not valid yet", std::time(nullptr) - kYear_s);
  expect_fault("permissions.p7s", "not valid before", std::time(nullptr) - kYear_s);
}

TEST_F(Security, CertificateOfAnotherAuthority) {
  ASSERT_TRUE(make("other").is_ok());
  take_from("other/alice", "cert.pem");
  take_from("other/alice", "key.pem");
  expect_only_fault("cert.pem", "not signed by identity_ca.cert.pem");
}

TEST_F(Security, KeyOfAnotherCertificate) {
  take_from("set/serve", "key.pem");
  expect_only_fault("key.pem", "does not belong to cert.pem");
}

TEST_F(Security, KeyThatOthersCanRead) {
  fs::permissions(alice + "/key.pem", fs::perms::others_read, fs::perm_options::add);
  expect_only_fault("key.pem", "can be read by others");
}

TEST_F(Security, PermissionsOfAnotherAuthority) {
  ASSERT_TRUE(make("other").is_ok());
  take_from("other/alice", "permissions.p7s");
  expect_only_fault("permissions.p7s", "not signed by permissions_ca.cert.pem");
}

TEST_F(Security, PermissionsSignedByAnIdentity) {
  // With a certificate of the permissions authority, which is not that authority.
  auto certificate = crypto::read_certificate(folder + "/set/serve/cert.pem");
  auto key = crypto::read_key(folder + "/set/serve/key.pem");
  const auto text =
      crypto::sign("<dds/>", {std::move(key).value(), std::move(certificate).value()});
  ASSERT_TRUE(text.is_ok());
  write(alice + "/permissions.p7s", text.value());
  take_from("set/serve", "identity_ca.cert.pem");
  expect_only_fault("permissions.p7s", "not signed by permissions_ca.cert.pem");
}

TEST_F(Security, PermissionsChangedAfterwards) {
  std::string text = read(alice + "/permissions.p7s");
  text.replace(text.find("DENY"), 4, "ALOW");
  write(alice + "/permissions.p7s", text);
  expect_only_fault("permissions.p7s", "or changed since");
}

TEST_F(Security, PermissionsOfSomebodyElse) {
  take_from("set/serve", "permissions.p7s");
  expect_only_fault("permissions.p7s", "grants nothing to CN=alice");
}

TEST_F(Security, PermissionsWithoutATopic) {
  change_permissions("site/v*/body_poses", "site/v*/body_proses");
  expect_only_fault("permissions.p7s", "does not allow to publish site/v15/body_poses");
}

TEST_F(Security, HostsTopicsStandBesideOwn) {
  SecurityPlan hosts = plan();
  hosts.topics = {"flight_sim/state", "rt/*"};
  const std::string text = permissions_text(hosts, {"alice", Role::kSubscriber}, 0);
  for (const char* topic : {"flight_sim/state", "rt/*"}) {
    const std::string named = std::string("<topic>") + topic + "</topic>";
    const std::size_t publishes = text.find(named);
    ASSERT_NE(publishes, std::string::npos) << topic;
    EXPECT_LT(publishes, text.find("<subscribe>"));
    EXPECT_GT(text.find(named, publishes + 1), text.find("<subscribe>"));
  }
  ASSERT_TRUE(make_security(folder + "/hosts", hosts).is_ok());
  for (const char* identity : {"serve", "alice", "rec"})
    EXPECT_TRUE(check_security(folder + "/hosts/" + identity, kDomain, kPrefix).empty());
  // After nearmesh's own rules, of which the first that names a topic counts.
  const std::string governance = governance_text(kDomain, kPrefix);
  EXPECT_GT(governance.find("<topic_expression>*</topic_expression>"),
            governance.find("<topic_expression>site/*</topic_expression>"));
}

TEST_F(Security, TopicsThatNoHostMayHaveAreRefused) {
  const auto refusal = [](std::vector<std::string> topics) {
    SecurityPlan hosts = plan();
    hosts.topics = std::move(topics);
    return make_security("/nowhere", hosts).message();
  };
  for (const char* topic : {"", "/*", "*", "a*", "a/*/b", "a b", "<a>", "a&b"})
    EXPECT_NE(refusal({topic}).find("expected letters, digits"), std::string::npos) << topic;
  EXPECT_NE(refusal({std::string("a\0b", 3)}).find("expected letters"), std::string::npos);
  // It would let everybody with it serve false detail.
  for (const char* topic : {"site/v15/split_batch", "site/*", "site/v15/*"})
    EXPECT_NE(refusal({topic}).find("nearmesh's own"), std::string::npos) << topic;
  EXPECT_NE(refusal(std::vector<std::string>(200, "a")).find("a handshake has room for"),
            std::string::npos);
}

TEST_F(Security, PermissionsForAnotherDomain) {
  change_permissions("<id>5</id>", "<id_range><min>6</min><max>9</max></id_range>");
  expect_only_fault("permissions.p7s", "does not name domain 5");
}

TEST_F(Security, PermissionsForARangeWithTheDomain) {
  change_permissions("<id>5</id>", "<id_range><min>4</min></id_range>");
  EXPECT_TRUE(check_security(alice, kDomain, kPrefix).empty());
}

TEST_F(Security, PermissionsWithoutThePartition) {
  change_permissions("<partition>*</partition>", "<partition>a</partition>");
  expect_only_fault("permissions.p7s", "does not name partition *");
}

TEST_F(Security, PermissionsThatDeny) {
  change_permissions("<allow_rule>", "<deny_rule>");
  change_permissions("</allow_rule>", "</deny_rule>");
  expect_only_fault("permissions.p7s", "denies to");
}

TEST_F(Security, SetForAnotherBus) {
  EXPECT_EQ(check_security(alice, kDomain + 1, kPrefix).size(), 2U);  // governance, permissions
  EXPECT_EQ(check_security(alice, kDomain, "elsewhere").size(), 2U);
  // Its last rule names all topics, but does not sign nearmesh's for each reader.
  EXPECT_NE(judge_governance(governance_text(kDomain, kPrefix), kDomain, "elsewhere")
                .find("no ENCRYPT_WITH_ORIGIN_AUTHENTICATION for topic elsewhere/"),
            std::string::npos);
}

// --- Taking back

class Revoking : public Security {
 protected:
  [[nodiscard]] Result<RevocationReport> revoke(const std::vector<std::string>& names) const {
    return revoke_identities(folder + "/set", {kDomain, kPrefix, names});
  }
  [[nodiscard]] IdentityPaths paths(const std::string& of) const {
    const std::string at = folder + "/set/" + of + "/";
    return {at + "identity_ca.cert.pem", at + "cert.pem", at + "identity_crl.pem"};
  }
  [[nodiscard]] std::unique_ptr<IdentityBook> book_of(const std::string& of) const {
    auto book = IdentityBook::open(paths(of));
    EXPECT_TRUE(book.is_ok()) << book.status().message();
    return std::move(book).value();
  }
  [[nodiscard]] std::optional<IdentityFacts> facts_of(IdentityBook& book,
                                                      const std::string& certificate) const {
    const std::string pem = read(folder + "/" + certificate);
    return book.facts_of({reinterpret_cast<const std::uint8_t*>(pem.data()), pem.size()});
  }
  [[nodiscard]] std::string fault_of(IdentityBook& book, const std::string& certificate,
                                     std::time_t now = std::time(nullptr)) const {
    const auto facts = facts_of(book, certificate);
    EXPECT_TRUE(facts.has_value()) << certificate;
    return facts ? book.fault_of(*facts, now) : "nothing of it";
  }
  // Alice's list in place of another set's file, as somebody would who can write there.
  void put_list(const std::string& text) const { write(alice + "/identity_crl.pem", text); }
  // What is said at two looks.
  static std::string refresh_twice(IdentityBook& book) {
    const std::string first = book.refresh();
    return first.empty() ? book.refresh() : first;
  }
};

TEST_F(Revoking, RevokedIsRefusedAndNobodyElseIs) {
  const auto report = revoke({"alice"});
  ASSERT_TRUE(report.is_ok()) << report.status().message();
  ASSERT_EQ(report.value().certificates.size(), 1U);
  EXPECT_TRUE(report.value().certificates[0].starts_with("alice "));
  EXPECT_EQ(report.value().files.size(), 3U);
  for (const char* name : {"alice", "rec", "serve"})
    EXPECT_EQ(read(folder + "/set/" + name + "/identity_crl.pem"),
              read(folder + "/set/private/identity_crl.pem"));
  expect_only_fault("cert.pem", "revoked on");
  EXPECT_TRUE(check_security(folder + "/set/serve", kDomain, kPrefix).empty());
  EXPECT_NE(describe_identity(folder + "/set/serve").find("list 1: 1 certificate"),
            std::string::npos)
      << describe_identity(folder + "/set/serve");
}

TEST_F(Revoking, TwiceIsOnce) {
  ASSERT_TRUE(revoke({"alice"}).is_ok());
  const std::string list = read(alice + "/identity_crl.pem");
  fs::remove(folder + "/set/serve/identity_crl.pem");
  const auto again = revoke({"alice"});
  ASSERT_TRUE(again.is_ok()) << again.status().message();
  EXPECT_TRUE(again.value().certificates.empty());
  EXPECT_EQ(again.value().files.size(), 3U);
  EXPECT_EQ(read(alice + "/identity_crl.pem"), list);
  EXPECT_EQ(read(folder + "/set/serve/identity_crl.pem"), list);
}

TEST_F(Revoking, UnknownNameIsToldTheNamesThatThereAre) {
  const auto report = revoke({"alice", "alicia"});
  ASSERT_EQ(report.status().code(), StatusCode::kNotFound);
  EXPECT_NE(report.status().message().find("alicia"), std::string::npos);
  EXPECT_NE(report.status().message().find("alice, rec, serve"), std::string::npos)
      << report.status().message();
  EXPECT_FALSE(fs::exists(alice + "/identity_crl.pem"));
}

TEST_F(Revoking, SetWithoutItsAuthoritiesCannotRevoke) {
  EXPECT_EQ(revoke_identities(alice, {kDomain, kPrefix, {"alice"}}).status().code(),
            StatusCode::kNotFound);
}

TEST_F(Revoking, RenewedIdentityCountsAndTheOldOneStaysRevoked) {
  fs::copy(alice, folder + "/stolen");
  ASSERT_TRUE(revoke({"alice"}).is_ok());
  SecurityPlan again = plan();
  again.identities = {{"alice", Role::kSubscriber}};
  again.force = true;
  ASSERT_TRUE(make_security(folder + "/set", again).is_ok());
  EXPECT_TRUE(check_security(alice, kDomain, kPrefix).empty());
  const auto book = book_of("serve");
  EXPECT_EQ(fault_of(*book, "set/alice/cert.pem"), "");
  EXPECT_EQ(fault_of(*book, "stolen/cert.pem"), "was revoked");
  // Both have the name; a participant shows its certificate by more than that.
  EXPECT_EQ(facts_of(*book, "stolen/cert.pem")->name, "alice");
  EXPECT_EQ(facts_of(*book, "stolen/cert.pem")->key_start,
            facts_of(*book, "set/alice/cert.pem")->key_start);
}

// What --force replaced is not in the set any more, and still opens doors.
TEST_F(Revoking, ReplacedCertificateIsRevokedToo) {
  fs::copy(alice, folder + "/stolen");
  SecurityPlan again = plan();
  again.identities = {{"alice", Role::kSubscriber}};
  again.force = true;
  ASSERT_TRUE(make_security(folder + "/set", again).is_ok());
  const auto report = revoke({"alice"});
  ASSERT_TRUE(report.is_ok());
  EXPECT_EQ(report.value().certificates.size(), 2U);
  const auto book = book_of("serve");
  EXPECT_EQ(fault_of(*book, "stolen/cert.pem"), "was revoked");
  EXPECT_EQ(fault_of(*book, "set/alice/cert.pem"), "was revoked");
}

// Somebody's certificate that lies in a set's folder is not of the set, and may have any name.
TEST_F(Revoking, CertificatesOfOthersDoNotHideThoseOfTheSet) {
  fs::copy(folder + "/set/serve", folder + "/stolen");
  auto stranger = crypto::make_identity("A Stranger", 365, std::time(nullptr), nullptr);
  ASSERT_TRUE(stranger.is_ok());
  write(folder + "/set/serve/cert.pem", crypto::to_pem(*stranger.value().certificate));
  SecurityPlan again = plan();
  again.force = true;
  ASSERT_TRUE(make_security(folder + "/set", again).is_ok());
  const auto report = revoke({"serve"});
  ASSERT_TRUE(report.is_ok()) << report.status().message();
  EXPECT_EQ(report.value().certificates.size(), 2U);
  EXPECT_EQ(fault_of(*book_of("alice"), "stolen/cert.pem"), "was revoked");
}

TEST_F(Revoking, RunningProgramReadsTheListAgain) {
  const auto book = book_of("serve");
  EXPECT_EQ(book->refresh(), "");
  EXPECT_EQ(fault_of(*book, "set/alice/cert.pem"), "");
  ASSERT_TRUE(revoke({"alice"}).is_ok());
  EXPECT_NE(book->refresh().find("list 1 is in force, 1 certificate is revoked"),
            std::string::npos);
  EXPECT_EQ(book->refresh(), "");
  EXPECT_EQ(fault_of(*book, "set/alice/cert.pem"), "was revoked");
  EXPECT_EQ(book->fault_of(book->own(), std::time(nullptr)), "");
  ASSERT_TRUE(revoke({"serve"}).is_ok());
  EXPECT_NE(book->refresh().find("list 2"), std::string::npos);
  EXPECT_EQ(book->fault_of(book->own(), std::time(nullptr)), "was revoked");
}

TEST_F(Revoking, ForgedListIsRefused) {
  ASSERT_TRUE(revoke({"serve"}).is_ok());
  const auto book = book_of("alice");
  EXPECT_EQ(fault_of(*book, "set/serve/cert.pem"), "was revoked");
  // Of another authority of the same name.
  ASSERT_TRUE(make("other").is_ok());
  ASSERT_TRUE(revoke_identities(folder + "/other", {kDomain, kPrefix, {"rec"}}).is_ok());
  put_list(read(folder + "/other/rec/identity_crl.pem"));
  EXPECT_NE(refresh_twice(*book).find("not signed by the set's authority"), std::string::npos);
  EXPECT_EQ(fault_of(*book, "set/serve/cert.pem"), "was revoked");
  expect_only_fault("identity_crl.pem", "not signed by identity_ca.cert.pem");
  // Signed by an identity of the set.
  auto key = crypto::read_key(folder + "/set/rec/key.pem");
  auto authority = crypto::read_certificate(folder + "/set/private/identity_ca.cert.pem");
  const auto list = crypto::sign_revocations(
      {7, {}}, std::time(nullptr), {std::move(key).value(), std::move(authority).value()});
  ASSERT_TRUE(list.is_ok()) << list.status().message();
  put_list(list.value());
  EXPECT_NE(refresh_twice(*book).find("not signed"), std::string::npos);
  EXPECT_EQ(fault_of(*book, "set/serve/cert.pem"), "was revoked");
  put_list("garbage");
  EXPECT_NE(refresh_twice(*book).find("not a revocation list"), std::string::npos);
  EXPECT_EQ(refresh_twice(*book), "");  // said once
  fs::remove(alice + "/identity_crl.pem");
  EXPECT_EQ(refresh_twice(*book), "");
  EXPECT_EQ(fault_of(*book, "set/serve/cert.pem"), "was revoked");
}

TEST_F(Revoking, OlderListIsRefused) {
  ASSERT_TRUE(revoke({"rec"}).is_ok());
  const std::string older = read(alice + "/identity_crl.pem");
  ASSERT_TRUE(revoke({"serve"}).is_ok());
  const auto book = book_of("alice");
  put_list(older);
  EXPECT_NE(refresh_twice(*book).find("list 1 is older than list 2"), std::string::npos);
  EXPECT_EQ(fault_of(*book, "set/serve/cert.pem"), "was revoked");
}

TEST_F(Revoking, CertificateEndsWhenItSays) {
  const auto book = book_of("serve");
  const auto facts = facts_of(*book, "set/alice/cert.pem");
  ASSERT_TRUE(facts.has_value());
  EXPECT_NEAR(static_cast<double>(facts->end - std::time(nullptr)), 365.0 * 24 * 3600, 3600);
  EXPECT_EQ(book->fault_of(*facts, facts->end), "");
  EXPECT_NE(book->fault_of(*facts, facts->end + 1).find("expired on 20"), std::string::npos);
}

// An identity that was added to a set late may be valid for longer than those who vouch for it.
TEST_F(Revoking, NobodyOutlivesTheAuthorities) {
  SecurityPlan more = plan();
  more.identities = {{"bob", Role::kSubscriber}};
  more.valid_days = 1000;
  ASSERT_TRUE(make_security(folder + "/set", more).is_ok());
  const auto authority = crypto::read_certificate(folder + "/set/bob/identity_ca.cert.pem");
  const auto book = book_of("bob");
  for (const auto& facts : {facts_of(*book, "set/bob/cert.pem"), std::optional(book->own())}) {
    ASSERT_TRUE(facts.has_value());
    EXPECT_EQ(facts->end, crypto::end_of(*authority.value()));
  }
  EXPECT_EQ(describe_identity(folder + "/set/bob").substr(0, 22),
            describe_identity(alice).substr(0, 22));
}

TEST_F(Revoking, CertificatesOfOthersAreNobodys) {
  ASSERT_TRUE(make("other").is_ok());
  const auto book = book_of("serve");
  EXPECT_FALSE(facts_of(*book, "other/alice/cert.pem").has_value());
  EXPECT_FALSE(facts_of(*book, "set/alice/key.pem").has_value());
  EXPECT_FALSE(facts_of(*book, "set/nowhere").has_value());
}

}  // namespace
}  // namespace nearmesh::wire
