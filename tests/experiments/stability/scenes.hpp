// SPDX-License-Identifier: Apache-2.0
#pragma once
// The scenes, one list for the tests and for the program. Truths come from the oracle (oracle.hpp)
// on the base cases; variants change nothing (variants.hpp).

#include <string>
#include <vector>

#include "case.hpp"

namespace nearmesh::stability {

// ---- base cases, truths filled in ----
[[nodiscard]] std::vector<Case> touching_cases();       ///< F3
[[nodiscard]] std::vector<Case> small_pair_cases();     ///< F3: triangles in all ways of touching
[[nodiscard]] std::vector<Case> degenerate_cases();     ///< F4
[[nodiscard]] std::vector<Case> concave_cases();        ///< F15
[[nodiscard]] std::vector<Case> huge_triangle_cases();  ///< F17
[[nodiscard]] std::vector<Case> gap_cases();            ///< F19

/// F1: what a client holds of a needle on a plane, at each of `every`-th prefix of the stream, in
/// `seeds` random subsets of blocks, and with the needle's region never received; a ball at several
/// places.
[[nodiscard]] std::vector<Case> streamed_cases(std::uint32_t every, std::uint64_t seeds);
[[nodiscard]] std::vector<Case> solid_cases();        ///< F2
[[nodiscard]] std::vector<Case> sweep_cases();        ///< F7
[[nodiscard]] std::vector<Case> contact_cases();      ///< F8
[[nodiscard]] std::vector<Case> rolling_cases();      ///< F9
[[nodiscard]] std::vector<Case> resting_cases();      ///< F10
[[nodiscard]] std::vector<Case> invalid_cases();      ///< F5
[[nodiscard]] std::vector<Case> bound_cases();        ///< F11
[[nodiscard]] std::vector<Case> incremental_cases();  ///< F12
[[nodiscard]] std::vector<Case> thread_cases();       ///< F13
[[nodiscard]] std::vector<Case> limit_cases();        ///< F18
/// F16: none where `data_folder`/bad is absent.
[[nodiscard]] std::vector<Case> file_cases(const std::string& data_folder);

// ---- scenes as rows of the table ----
/// All rows in the order of their numbers.
[[nodiscard]] std::vector<std::string> scene_ids();
/// One row with its variants; `quick` keeps a sample of them. Precondition: one of scene_ids.
[[nodiscard]] Scene make_scene(const std::string& id, const std::string& data_folder, bool quick);

}  // namespace nearmesh::stability
