// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a recorder remembers of those that it hears. In weeks more come and go than it shall keep: of those that are gone it forgets whom it has
// missed for longest. For the rooms named dds alone.

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "idl/dds/fastdds_api.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// Something of each writer. Threads: one at a time.
template <class Known>
class WriterBook {
 public:
  /// A writer that is gone may be found again, as it was; and samples of it may be taken after it went.
  explicit WriterBook(std::size_t most_gone) : most_gone_(most_gone) {}

  /// Made where nothing is known.
  [[nodiscard]] Known& of(const wire::Handle& writer) { return known_[writer]; }
  [[nodiscard]] const Known* find(const wire::Handle& writer) const {
    const auto at = known_.find(writer);
    return at == known_.end() ? nullptr : &at->second;
  }
  void come(const wire::Handle& writer) {
    const auto turn = gone_in_.find(writer);
    if (turn == gone_in_.end()) return;
    gone_.erase(turn->second);
    gone_in_.erase(turn);
  }
  void leave(const wire::Handle& writer) {
    come(writer);  // where it went before
    gone_.emplace(++turns_, writer);
    gone_in_.emplace(writer, turns_);
    if (gone_.size() <= most_gone_) return;
    const auto longest = gone_.begin();
    known_.erase(longest->second);
    gone_in_.erase(longest->second);
    gone_.erase(longest);
  }
  /// With the bus.
  void all_leave() {
    std::vector<wire::Handle> there;
    for (const auto& [writer, known] : known_)
      if (!gone_in_.contains(writer)) there.push_back(writer);
    for (const wire::Handle& writer : there) leave(writer);
  }
  [[nodiscard]] std::size_t size() const { return known_.size(); }

 private:
  const std::size_t most_gone_;
  std::map<wire::Handle, Known> known_;
  std::map<std::uint64_t, wire::Handle> gone_;     ///< by turn
  std::map<wire::Handle, std::uint64_t> gone_in_;  ///< in which turn
  std::uint64_t turns_ = 0;
};

/// Which names of sessions are in the recording. Threads: one at a time.
class ToldNames {
 public:
  explicit ToldNames(std::size_t most) : most_(most) {}

  /// A session says its name. Out: it is not in the recording, and will be. Where there are too many, the one that was silent for longest makes room:
  /// should it speak again, its name is recorded once more.
  [[nodiscard]] bool is_new(wire::SessionId session, const std::string& name) {
    const auto [at, is_unknown] = told_.try_emplace(session);
    Told& told = at->second;
    if (!is_unknown) heard_.erase(told.turn);
    told.turn = ++turns_;
    heard_.emplace(told.turn, session);
    const bool is_news = is_unknown || told.name != name;
    told.name = name;
    if (told_.size() > most_) {
      told_.erase(heard_.begin()->second);
      heard_.erase(heard_.begin());
    }
    return is_news;
  }

 private:
  struct Told {
    std::string name;
    std::uint64_t turn = 0;  ///< in which it was heard last
  };
  const std::size_t most_;
  std::map<wire::SessionId, Told> told_;
  std::map<std::uint64_t, wire::SessionId> heard_;  ///< by turn
  std::uint64_t turns_ = 0;
};

}  // namespace nearmesh::subscriber
