// SPDX-License-Identifier: Apache-2.0
#pragma once
// Answers as C reads them: plain structs, and what owns the arrays that they point to.

#include <optional>
#include <span>
#include <vector>

#include "nearmesh.h"
#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/depth.hpp"
#include "nearmesh/core/query/sweep.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/core/world/world_probe.hpp"

namespace nearmesh::c {

[[nodiscard]] nearmesh_face_pair to_c(const FacePair& pair);
[[nodiscard]] nearmesh_pose to_c(const Pose& pose);
[[nodiscard]] nearmesh_motion to_c(const Motion& motion);
[[nodiscard]] Pose from_c(const nearmesh_pose& pose);
[[nodiscard]] Motion from_c(const nearmesh_motion& motion);
[[nodiscard]] nearmesh_swept to_c(const SweptAnswer& swept);
[[nodiscard]] nearmesh_world_tile to_c(const WorldTile& tile);

/// 32 digits and a 0; empty for no content.
struct ContentText {
  char digits[40] = {};
  ContentText() = default;
  explicit ContentText(const ContentHash& content);
};

/// What is told of a header. The text must outlive it.
[[nodiscard]] nearmesh_model_facts facts_of(const SpmHeader& header, const ContentText& content);

/// Patches are given one by one, so that they may grow; the library finds them behind the struct.
/// These stay where they were made, for structs point into them, and are filled anew: a frame's
/// arrays keep their memory.
struct OwnedContacts : nearmesh_contacts {
  OwnedContacts() : nearmesh_contacts{} {}
  OwnedContacts(const OwnedContacts&) = delete;
  OwnedContacts& operator=(const OwnedContacts&) = delete;
  void fill(const Contacts& of);

  std::vector<nearmesh_contact_segment> all_segments;
  std::vector<nearmesh_contact_patch> patches;
};

struct OwnedAnswer {
  OwnedAnswer() = default;
  OwnedAnswer(const OwnedAnswer&) = delete;
  OwnedAnswer& operator=(const OwnedAnswer&) = delete;
  void fill(const Answer& of, const std::optional<Contacts>& of_contacts,
            const std::optional<Depth>& of_depth);

  nearmesh_answer answer{};
  std::vector<nearmesh_face_pair> pairs;
  OwnedContacts contacts;
  nearmesh_depth depth{};
};

}  // namespace nearmesh::c
