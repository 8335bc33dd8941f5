// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which content a model's name stands for at a peer, and why. What is held stays while a publisher
// of it is there; it changes only by an act: a publisher that says that it replaces it, an epoch
// that begins, or the end of its last publisher.

#include <span>
#include <string>

#include "idl/messages/contents.hpp"

namespace nearmesh::subscriber {

/// What a peer knows of the name before it looks at publishers; each may be none.
struct KnownContent {
  ContentHash pinned;  ///< by whoever made the scene: nothing else is ever taken
  ContentHash held;    ///< a base mesh of it is here
  wire::Epoch epoch;   ///< that it was taken in
};

struct ContentChoice {
  ContentHash content;  ///< none: none of those that are served may be taken, or none is served
  std::uint64_t mesh_bytes = 0;
  std::string change;    ///< what became of the content that was held; empty where it stays
  std::string conflict;  ///< what people must mend; empty where publishers agree
  wire::Epoch epoch;     ///< of the content
  ContentHash coming;    ///< of the next epoch, to be fetched before it begins; or none
};

/// `offers`: of all publishers that are there, in an order that is the same each time (the ids').
/// `time_s`: of the frame, on the exercise's clock. Among peers that hear the same offers, epochs
/// begin in the same frame, whatever each held before.
[[nodiscard]] ContentChoice choose_content(const KnownContent& known,
                                           std::span<const wire::Offer> offers, double time_s);

}  // namespace nearmesh::subscriber
