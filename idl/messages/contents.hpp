// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which contents stand for the name of a model, by what the publishers that are there say of it.
// One rule for peers, publishers and whoever looks at the bus.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// What one publisher that is there serves under the name.
struct Offer {
  SessionId publisher = 0;
  ContentHash content;
  ContentHash replaces;  ///< takes its place; or none
  std::uint64_t mesh_bytes = 0;
  std::string name{};  ///< of the publisher, for people
  Epoch epoch{};
};

/// Adds what a publisher serves under the name, if it does.
void add_offer(const Hello& hello, const std::string& name, std::vector<Offer>& offers);

/// What people are told to do where several contents stand for one name.
inline constexpr const char* kConflictAdvice =
    "peers keep what they hold: stop or rename one, or serve the right one with --replaces";

/// The greatest epoch that has begun at that time of the exercise; nothing where none has.
[[nodiscard]] std::optional<Epoch> epoch_at(std::span<const Offer> offers, double time_s);
/// The epoch that takes its place next; nothing where none is announced.
[[nodiscard]] std::optional<Epoch> epoch_after(std::span<const Offer> offers, double time_s);
/// The offers of one epoch: what stands for a name is settled among these.
[[nodiscard]] std::vector<Offer> of_epoch(std::span<const Offer> offers, std::uint32_t number);

/// The contents that nobody replaces, ascending: more than one is a mistake that people must mend.
/// Where they replace each other in a circle all of them stand.
[[nodiscard]] std::vector<ContentHash> standing(std::span<const Offer> offers);

/// The first that offers a content; nullptr: nobody does.
[[nodiscard]] const Offer* offer_of(std::span<const Offer> offers, const ContentHash& content);

/// What replaces a content; none where nothing does, or publishers disagree about it.
[[nodiscard]] std::optional<ContentHash> successor(std::span<const Offer> offers,
                                                   const ContentHash& content);

}  // namespace nearmesh::wire
