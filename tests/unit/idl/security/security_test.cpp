// SPDX-License-Identifier: Apache-2.0
#include "idl/security/security.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "idl/security/security_crypto.hpp"

namespace nearmesh::wire {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kDomain = 5;
constexpr std::time_t kYear_s = 366 * 24 * 60 * 60;
const std::string kPrefix = "site";

class Security : public ::testing::Test {
 protected:
  Security() {
    std::string name = ::testing::TempDir() + "nearmesh_security_XXXXXX";
    EXPECT_NE(::mkdtemp(name.data()), nullptr);
    folder = name;
    EXPECT_TRUE(make("set").is_ok());
    alice = folder + "/set/alice";
  }
  ~Security() override { fs::remove_all(folder); }

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

  std::string folder, alice;
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
  change_permissions("site/v*/body_pose", "site/v*/body_prose");
  expect_only_fault("permissions.p7s", "does not allow to publish site/v7/body_pose");
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
}

}  // namespace
}  // namespace nearmesh::wire
