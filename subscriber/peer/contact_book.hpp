// SPDX-License-Identifier: Apache-2.0
#pragma once
// The contacts of a pair of bodies, from update to update: which patch of now is which of before.

#include <cstdint>
#include <vector>

#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber {

class ContactBook {
 public:
  /// What an update says of the pair.
  struct Seen {
    const Contacts* contacts = nullptr;  ///< null: none are known
    bool is_all = false;                 ///< certified: there are no others
    Pose pose_a, pose_b;                 ///< what was asked about; unused without contacts
  };
  /// What became of each contact: those of `seen`, in the order of its patches, then those of
  /// before that are not among them. `ids` is set to those of the patches. New ones take `next_id`
  /// and raise it. A patch is one of before, first, if they share pairs of faces, then if they
  /// share a face of either body, then if it is no farther from where both bodies have carried that
  /// one than both reach and B has moved against A. Of several the one that shares most, or is
  /// nearest. Cost: O(n log n) in pairs, and old times new contacts.
  void follow(const Seen& seen, std::uint64_t& next_id, std::vector<std::uint64_t>& ids,
              std::vector<ContactEvent>& events);
  /// All are over.
  void end(std::vector<ContactEvent>& events);
  [[nodiscard]] bool is_empty() const { return held_.empty(); }

 private:
  struct Held {
    std::uint64_t id = 0;
    std::vector<FacePair> pairs;           // ascending
    std::array<double, 3> in_a{}, in_b{};  // its middle, in the models' frames, metres
    double reach_m = 0;                    // of its ends from there
    std::array<double, 3> b_in_a{};        // where B's origin was in A's frame
  };
  /// An old contact that a new one may be; the best first.
  struct Match;
  [[nodiscard]] std::vector<Match> matches(const std::vector<Held>& now, const Seen& seen) const;

  std::vector<Held> held_;
};

}  // namespace nearmesh::subscriber
