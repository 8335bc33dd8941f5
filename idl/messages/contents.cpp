// SPDX-License-Identifier: Apache-2.0
#include "contents.hpp"

#include <algorithm>

namespace nearmesh::wire {
namespace {

bool replaces(const Offer& offer, const ContentHash& content) {
  return offer.replaces == content && offer.content != content;
}

}  // namespace

void add_offer(const Hello& hello, const std::string& name, std::vector<Offer>& offers) {
  for (const Hello::Model& model : hello.models)
    if (model.name == name)
      offers.push_back({hello.publisher, model.content_hash, model.replaces, model.mesh_bytes,
                        hello.name, model.epoch});
}

std::optional<Epoch> epoch_at(std::span<const Offer> offers, double time_s) {
  std::optional<Epoch> greatest;
  for (const Offer& offer : offers)
    if (offer.epoch.has_begun(time_s) && (!greatest || offer.epoch.number > greatest->number))
      greatest = offer.epoch;
  return greatest;
}

std::optional<Epoch> epoch_after(std::span<const Offer> offers, double time_s) {
  const std::optional<Epoch> now = epoch_at(offers, time_s);
  std::optional<Epoch> next;
  for (const Offer& offer : offers)
    if (!offer.epoch.has_begun(time_s) && (!now || offer.epoch.number > now->number) &&
        (!next || offer.epoch.from_s < next->from_s))
      next = offer.epoch;
  return next;
}

std::vector<Offer> of_epoch(std::span<const Offer> offers, std::uint32_t number) {
  std::vector<Offer> its;
  std::copy_if(offers.begin(), offers.end(), std::back_inserter(its),
               [number](const Offer& offer) { return offer.epoch.number == number; });
  return its;
}

std::vector<ContentHash> standing(std::span<const Offer> offers) {
  std::vector<ContentHash> all, left;
  for (const Offer& offer : offers) all.push_back(offer.content);
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  std::copy_if(all.begin(), all.end(), std::back_inserter(left), [&](const ContentHash& content) {
    return std::none_of(offers.begin(), offers.end(),
                        [&](const Offer& offer) { return replaces(offer, content); });
  });
  return left.empty() ? all : left;
}

const Offer* offer_of(std::span<const Offer> offers, const ContentHash& content) {
  const auto at = std::find_if(offers.begin(), offers.end(),
                               [&](const Offer& offer) { return offer.content == content; });
  return at == offers.end() ? nullptr : &*at;
}

std::optional<ContentHash> successor(std::span<const Offer> offers, const ContentHash& content) {
  std::optional<ContentHash> found;
  for (const Offer& offer : offers) {
    if (!replaces(offer, content)) continue;
    if (found && *found != offer.content) return std::nullopt;
    found = offer.content;
  }
  return found;
}

}  // namespace nearmesh::wire
