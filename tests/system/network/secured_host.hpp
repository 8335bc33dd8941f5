// SPDX-License-Identifier: Apache-2.0
#pragma once
// A host with a topic of its own on a bus that is secured: its identity's documents name that topic too, signed by the set's authority.

#include <string>

namespace nearmesh::test {

/// Lets an identity of a set write and read one more topic, encrypted as ours are. Throws std::runtime_error.
void permit_topic(const std::string& set, const std::string& identity, const std::string& topic);

/// A file of Fast DDS profiles: `profiles` with the participant profile `profile` secured by that identity. Throws std::runtime_error.
[[nodiscard]] std::string secured_profiles(const std::string& profiles, const std::string& profile,
                                           const std::string& identity_folder);

}  // namespace nearmesh::test
