// SPDX-License-Identifier: Apache-2.0
#pragma once
// Names of the files in an identity's folder (security.hpp); those of ROS 2's enclaves.

#include <array>

namespace nearmesh::wire {

inline constexpr const char* kIdentityCa = "identity_ca.cert.pem";
inline constexpr const char* kPermissionsCa = "permissions_ca.cert.pem";
inline constexpr const char* kCertificate = "cert.pem";
inline constexpr const char* kPrivateKey = "key.pem";
inline constexpr const char* kGovernance = "governance.p7s";
inline constexpr const char* kPermissions = "permissions.p7s";
inline constexpr std::array kIdentityFiles{kIdentityCa, kPermissionsCa, kCertificate,
                                           kPrivateKey, kGovernance,    kPermissions};
/// There once an identity of the set was revoked.
inline constexpr const char* kRevocations = "identity_crl.pem";

}  // namespace nearmesh::wire
