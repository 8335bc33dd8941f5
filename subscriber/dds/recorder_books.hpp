// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a recorder remembers of those that it hears. In weeks more come and go than it shall keep:
// of those that are gone it forgets whom it has missed for longest. For the rooms named dds alone.

#include <cstddef>
#include <map>
#include <string>
#include <utility>

#include "core/base/lru_map.hpp"
#include "idl/dds/fastdds_api.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// Something of each writer. Threads: one at a time.
template <class Known>
class WriterBook {
 public:
  /// A writer that is gone may be found again, as it was; and samples of it may be taken after it
  /// went.
  explicit WriterBook(std::size_t most_gone) : gone_(most_gone) {}

  /// Made where nothing is known.
  [[nodiscard]] Known& of(const wire::Handle& writer) {
    Known* const known = gone_.use(writer);
    return known != nullptr ? *known : there_[writer];
  }
  [[nodiscard]] const Known* find(const wire::Handle& writer) const {
    const auto at = there_.find(writer);
    return at == there_.end() ? gone_.find(writer) : &at->second;
  }
  void come(const wire::Handle& writer) {
    if (auto known = gone_.extract(writer)) there_.emplace(writer, std::move(*known));
  }
  void leave(const wire::Handle& writer) {
    Known& known = of(writer);
    gone_.put(writer, Known(std::move(known)));
    there_.erase(writer);
  }
  /// With the bus.
  void all_leave() {
    while (!there_.empty()) leave(wire::Handle(there_.begin()->first));
  }
  [[nodiscard]] std::size_t size() const { return there_.size() + gone_.size(); }

 private:
  std::map<wire::Handle, Known> there_;
  LruMap<wire::Handle, Known> gone_;
};

/// A session says its name. Out: it is not among those in the recording, and will be. Where these
/// are too many, the one that was silent for longest makes room: should it speak again, its name is
/// recorded once more.
[[nodiscard]] inline bool tells_name(LruMap<wire::SessionId, std::string>& told,
                                     wire::SessionId session, const std::string& name) {
  if (const std::string* const known = told.use(session); known != nullptr && *known == name)
    return false;
  told.put(session, name);
  return true;
}

}  // namespace nearmesh::subscriber
