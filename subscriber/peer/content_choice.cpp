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

/// What replaces the content, whatever replaces that, and so on; itself where that leads nowhere, or in a circle.
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

ContentChoice choose_content(const KnownContent& known, std::span<const Offer> offers) {
  std::vector<ContentHash> standing = wire::standing(offers);
  ContentChoice choice;
  if (known.pinned.is_set()) {
    choice.content = known.pinned;
  } else if (known.held.is_set()) {
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
  }
  if (const Offer* offer = offer_of(offers, choice.content)) choice.mesh_bytes = offer->mesh_bytes;

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
