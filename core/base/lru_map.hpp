// SPDX-License-Identifier: Apache-2.0
#pragma once
// A map of bounded size: in weeks more come and go than shall be kept, and what was used longest
// ago makes room.

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <optional>
#include <utility>
#include <variant>

namespace nearmesh {

/// Pinned entries never make room. Entries may be of groups, each bounded as well, so that none
/// takes all of the map. Where there is no memory put() throws std::bad_alloc, and the key has
/// nothing. Threads: one at a time.
template <class Key, class Value, class Group = std::monostate>
class LruMap {
 public:
  LruMap(std::size_t most_of_group, std::size_t most)
      : most_of_group_(most_of_group), most_(most) {}
  explicit LruMap(std::size_t most) : LruMap(most, most) {}

  /// In the place of what the key had: unpinned, used just now. Where its group is full one of that
  /// makes room, else where all is full one of any group. Null where those are all pinned: then the
  /// key has nothing.
  Value* put(const Key& key, Value value, const Group& group = {}) {
    erase(key);
    const auto of_group = groups_.find(group);
    if (of_group != groups_.end() && of_group->second.size() >= most_of_group_) {
      if (!evict(of_group)) return nullptr;
    } else if (entries_.size() >= most_ && !evict(with_least_recently_used())) {
      return nullptr;
    }
    Order made(1);
    Members& members = groups_[group];
    const Place place = entries_.emplace(key, Entry{std::move(value), group, made.begin()}).first;
    made.front() = {&place->first, ++turns_};
    members.unpinned.splice(members.unpinned.end(), made);
    return &place->second.value;
  }
  /// What the key has, used just now unless it is pinned; null for nothing.
  [[nodiscard]] Value* use(const Key& key) {
    const Place place = entries_.find(key);
    if (place == entries_.end()) return nullptr;
    if (place->second.at->turn != kPinned) move_to_end(place, ++turns_);
    return &place->second.value;
  }
  [[nodiscard]] const Value* find(const Key& key) const {
    const auto place = entries_.find(key);
    return place == entries_.end() ? nullptr : &place->second.value;
  }
  [[nodiscard]] const Group* group_of(const Key& key) const {
    const auto place = entries_.find(key);
    return place == entries_.end() ? nullptr : &place->second.group;
  }
  void pin(const Key& key) {
    const Place place = entries_.find(key);
    if (place != entries_.end() && place->second.at->turn != kPinned) move_to_end(place, kPinned);
  }
  /// What was pinned was used until now.
  void unpin(const Key& key) {
    const Place place = entries_.find(key);
    if (place != entries_.end() && place->second.at->turn == kPinned) move_to_end(place, ++turns_);
  }
  std::optional<Value> extract(const Key& key) {
    const Place place = entries_.find(key);
    if (place == entries_.end()) return std::nullopt;
    std::optional<Value> value = std::move(place->second.value);
    drop(place);
    return value;
  }
  void erase(const Key& key) { static_cast<void>(extract(key)); }
  void erase_group(const Group& group) {
    const auto at = groups_.find(group);
    if (at == groups_.end()) return;
    for (const Order* order : {&at->second.pinned, &at->second.unpinned})
      for (const Used& used : *order) entries_.erase(entries_.find(*used.key));
    groups_.erase(at);
  }
  void clear() {
    entries_.clear();
    groups_.clear();
  }
  [[nodiscard]] std::size_t size() const { return entries_.size(); }
  /// By key.
  template <class Use>
  void for_each(const Use& use) const {
    for (const auto& [key, entry] : entries_) use(key, entry.value);
  }

 private:
  static constexpr std::uint64_t kPinned = 0;
  struct Used {
    const Key* key = nullptr;
    std::uint64_t turn = kPinned;  ///< in which it was used last
  };
  using Order = std::list<Used>;  ///< the least recently used first
  struct Entry {
    Value value;
    Group group;
    typename Order::iterator at;  ///< among the members of its group
  };
  using Place = typename std::map<Key, Entry>::iterator;
  struct Members {
    Order pinned, unpinned;
    [[nodiscard]] std::size_t size() const { return pinned.size() + unpinned.size(); }
    [[nodiscard]] Order& with(const Used& used) { return used.turn == kPinned ? pinned : unpinned; }
  };
  using Groups = std::map<Group, Members>;

  void move_to_end(Place place, std::uint64_t turn) {
    Members& members = groups_.find(place->second.group)->second;
    const auto at = place->second.at;
    Order& from = members.with(*at);
    at->turn = turn;
    Order& to = members.with(*at);
    to.splice(to.end(), from, at);
  }
  void drop(Place place) {
    const auto of_group = groups_.find(place->second.group);
    of_group->second.with(*place->second.at).erase(place->second.at);
    if (of_group->second.size() == 0) groups_.erase(of_group);
    entries_.erase(place);
  }
  /// Out: false where all of it are pinned, or nothing is there.
  bool evict(typename Groups::iterator of_group) {
    if (of_group == groups_.end() || of_group->second.unpinned.empty()) return false;
    drop(entries_.find(*of_group->second.unpinned.front().key));
    return true;
  }
  [[nodiscard]] typename Groups::iterator with_least_recently_used() {
    auto longest = groups_.end();
    for (auto at = groups_.begin(); at != groups_.end(); ++at)
      if (const Order& order = at->second.unpinned;
          !order.empty() &&
          (longest == groups_.end() || order.front().turn < longest->second.unpinned.front().turn))
        longest = at;
    return longest;
  }

  const std::size_t most_of_group_, most_;
  std::map<Key, Entry> entries_;
  Groups groups_;
  std::uint64_t turns_ = kPinned;
};

}  // namespace nearmesh
