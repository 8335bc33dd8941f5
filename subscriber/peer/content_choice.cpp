// SPDX-License-Identifier: Apache-2.0
#include "content_choice.hpp"

#include <algorithm>
#include <vector>

#include "core/base/hash.hpp"
#include "idl/messages/process_name.hpp"

namespace nearmesh::subscriber {
namespace {

using wire::Offer;
using wire::offer_of;

std::string called_of(const Offer& offer) {
  return "publisher " + wire::called(offer.publisher, offer.name);
}

/// "publisher P serves content C under this name", and how many others do so.
std::string served(std::span<const Offer> offers, const std::vector<ContentHash>& contents) {
  const Offer& first = *offer_of(offers, contents.front());
  std::string text =
      called_of(first) + " serves content " + to_hex(first.content) + " under this name";
  if (contents.size() > 1) text += " (and " + std::to_string(contents.size() - 1) + " more)";
  return text;
}

/// What replaces the content, whatever replaces that, and so on; itself where that leads nowhere,
/// or in a circle.
ContentHash newest(std::span<const Offer> offers, const ContentHash& content) {
  ContentHash at = content;
  for (std::size_t i = 0; i <= offers.size(); ++i) {
    const auto next = wire::successor(offers, at);
    if (!next) return at;
    at = *next;
  }
  return content;
}

}  // namespace

ContentChoice choose_content(const KnownContent& known, std::span<const Offer> all, double time_s) {
  ContentChoice choice;
  if (const auto next = wire::epoch_after(all, time_s); next && !known.pinned.is_set()) {
    const std::vector<Offer> coming = wire::of_epoch(all, next->number);
    if (const auto contents = wire::standing(coming); contents.size() == 1)
      choice.coming = contents.front();
  }
  const wire::Epoch epoch = wire::epoch_at(all, time_s).value_or(wire::Epoch{});
  const bool holds = known.held.is_set() && known.epoch.has_begun(time_s);
  if (!known.pinned.is_set() && holds && known.epoch.number > epoch.number) {
    // Whoever served it is gone; those before it do not come back.
    choice.content = known.held;
    choice.epoch = known.epoch;
    return choice;
  }
  std::vector<Offer> offers = wire::of_epoch(all, epoch.number);
  std::erase_if(offers, [&](const Offer& offer) { return !offer.epoch.has_begun(time_s); });
  std::vector<ContentHash> standing = wire::standing(offers);
  if (known.pinned.is_set()) {
    choice.content = known.pinned;
  } else if (holds && known.epoch.number == epoch.number) {
    choice.content = newest(offers, known.held);
    if (choice.content != known.held) {
      choice.change = called_of(*offer_of(offers, choice.content)) + " replaces content " +
                      to_hex(known.held) + " by " + to_hex(choice.content);
    } else if (offer_of(offers, known.held) == nullptr && standing.size() == 1) {
      choice.content = standing.front();
      choice.change = "no publisher of content " + to_hex(known.held) + " is there any more; " +
                      called_of(*offer_of(offers, choice.content)) + " serves content " +
                      to_hex(choice.content);
    }
  } else if (standing.size() == 1) {
    choice.content = standing.front();
    if (known.held.is_set() && choice.content != known.held)
      choice.change = "epoch " + std::to_string(epoch.number) + " holds at " +
                      std::to_string(time_s) + " s: content " + to_hex(choice.content) +
                      " takes the place of " + to_hex(known.held);
  } else if (holds) {
    choice.content = known.held;
  }
  choice.epoch = choice.content == known.held && standing.size() != 1 ? known.epoch : epoch;
  if (const Offer* offer = offer_of(all, choice.content)) choice.mesh_bytes = offer->mesh_bytes;

  std::erase(standing, choice.content);
  if (standing.empty()) return choice;
  if (!choice.content.is_set()) {
    const Offer& other = *offer_of(offers, standing[1]);
    choice.conflict = served(offers, {standing.front()}) + ", " + called_of(other) + " content " +
                      to_hex(other.content) +
                      ": neither is taken; stop one of them, or pin one (content)";
  } else {
    choice.conflict = served(offers, standing) + "; content " + to_hex(choice.content) +
                      (known.pinned.is_set() ? " is pinned" : " is held and stays");
  }
  return choice;
}

}  // namespace nearmesh::subscriber
