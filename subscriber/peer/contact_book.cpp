// SPDX-License-Identifier: Apache-2.0
#include "contact_book.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

namespace nearmesh::subscriber {
namespace {

using Point = std::array<double, 3>;

Point to_model(const Pose& pose, const Point& world) {
  Point out{};
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t k = 0; k < 3; ++k)
      out[k] += pose.rotation[3 * r + k] * (world[r] - pose.translation_m[r]);
  return out;
}
Point to_world(const Pose& pose, const Point& model) {
  Point out = pose.translation_m;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t k = 0; k < 3; ++k) out[r] += pose.rotation[3 * r + k] * model[k];
  return out;
}
double distance(const Point& a, const Point& b) {
  double square = 0;
  for (std::size_t k = 0; k < 3; ++k) square += (a[k] - b[k]) * (a[k] - b[k]);
  return std::sqrt(square);
}
/// Of p from the way from a to b.
double distance_from_way(const Point& p, const Point& a, const Point& b) {
  double along = 0, square = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    along += (p[k] - a[k]) * (b[k] - a[k]);
    square += (b[k] - a[k]) * (b[k] - a[k]);
  }
  const double share = square > 0 ? std::clamp(along / square, 0.0, 1.0) : 0;
  Point foot = a;
  for (std::size_t k = 0; k < 3; ++k) foot[k] += share * (b[k] - a[k]);
  return distance(p, foot);
}

/// What each of several contacts has, ascending.
template <class Key>
using Owners = std::vector<std::pair<Key, std::uint32_t>>;

template <class Key>
void sort_once(Owners<Key>& owners) {
  std::sort(owners.begin(), owners.end());
  owners.erase(std::unique(owners.begin(), owners.end()), owners.end());
}

/// How much each old contact and each new one have in common.
using Shared = std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t>;

template <class Key>
void count_shared(const Owners<Key>& before, const Owners<Key>& now, Shared& shared) {
  for (const auto& [key, new_one] : now)
    for (auto at = std::lower_bound(before.begin(), before.end(), std::pair(key, 0U));
         at != before.end() && at->first == key; ++at)
      ++shared[{at->second, new_one}];
}

}  // namespace

struct ContactBook::Match {
  int kind;      // the less the surer
  double worse;  // among those of a kind
  std::uint32_t before, now;
  auto operator<=>(const Match&) const = default;
};

std::vector<ContactBook::Match> ContactBook::matches(const std::vector<Held>& now,
                                                     const Seen& seen) const {
  const auto owners_of = [](const std::vector<Held>& contacts, const auto& key_of) {
    Owners<decltype(key_of(FacePair{}))> owners;
    for (std::uint32_t i = 0; i < contacts.size(); ++i)
      for (const FacePair& pair : contacts[i].pairs) owners.emplace_back(key_of(pair), i);
    sort_once(owners);
    return owners;
  };
  std::vector<Match> found;
  const auto add_shared = [&](int kind, const auto&... keys_of) {
    Shared shared;
    (count_shared(owners_of(held_, keys_of), owners_of(now, keys_of), shared), ...);
    for (const auto& [which, count] : shared)
      found.push_back({kind, -static_cast<double>(count), which.first, which.second});
  };
  add_shared(0, [](const FacePair& pair) { return pair; });
  add_shared(
      1, [](const FacePair& pair) { return pair.a; }, [](const FacePair& pair) { return pair.b; });
  for (std::uint32_t i = 0; i < held_.size(); ++i)
    for (std::uint32_t j = 0; j < now.size(); ++j) {
      const Held &before = held_[i], &after = now[j];
      const double off =
          distance_from_way(to_world(seen.pose_a, after.in_a), to_world(seen.pose_a, before.in_a),
                            to_world(seen.pose_b, before.in_b));
      if (off <= before.reach_m + after.reach_m + distance(before.b_in_a, after.b_in_a))
        found.push_back({2, off, i, j});
    }
  std::sort(found.begin(), found.end());
  return found;
}

void ContactBook::follow(const Seen& seen, std::uint64_t& next_id, std::vector<std::uint64_t>& ids,
                         std::vector<ContactEvent>& events) {
  std::vector<Held> now;
  if (seen.contacts != nullptr) {
    const Point b_in_a = to_model(seen.pose_a, seen.pose_b.translation_m);
    for (const ContactPatch& patch : seen.contacts->patches) {
      Held& one = now.emplace_back();
      one.in_a = to_model(seen.pose_a, patch.centroid_m);
      one.in_b = to_model(seen.pose_b, patch.centroid_m);
      one.b_in_a = b_in_a;
      for (std::uint32_t i = patch.first; i < patch.first + patch.count; ++i) {
        const ContactSegment& segment = seen.contacts->segments[i];
        one.reach_m = std::max({one.reach_m, distance(segment.p_m, patch.centroid_m),
                                distance(segment.q_m, patch.centroid_m)});
        if (one.pairs.empty() || one.pairs.back() != segment.pair)
          one.pairs.push_back(segment.pair);
      }
    }
  }
  std::vector<bool> is_known(held_.size());
  if (!held_.empty() && !now.empty())
    for (const Match& match : matches(now, seen)) {
      if (is_known[match.before] || now[match.now].id != 0) continue;
      is_known[match.before] = true;
      now[match.now].id = held_[match.before].id;
    }
  ids.clear();
  for (std::uint32_t i = 0; i < now.size(); ++i) {
    const bool is_new = now[i].id == 0;
    if (is_new) now[i].id = next_id++;
    ids.push_back(now[i].id);
    events.push_back({.change = is_new ? ContactChange::kBegin : ContactChange::kPersist,
                      .id = now[i].id,
                      .patch = i});
  }
  for (std::size_t i = 0; i < held_.size(); ++i) {
    if (is_known[i]) continue;
    events.push_back({.change = seen.is_all ? ContactChange::kEnd : ContactChange::kUnconfirmed,
                      .id = held_[i].id});
    if (!seen.is_all) now.push_back(std::move(held_[i]));
  }
  held_ = std::move(now);
}

void ContactBook::end(std::vector<ContactEvent>& events) {
  for (const Held& one : held_) events.push_back({.change = ContactChange::kEnd, .id = one.id});
  held_.clear();
}

}  // namespace nearmesh::subscriber
