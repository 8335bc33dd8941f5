// SPDX-License-Identifier: Apache-2.0
#pragma once
// Who speaks through which writer, what each said last, and who is silent. For the rooms named dds
// alone.

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "dds_time.hpp"
#include "fastdds_api.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// Which session speaks through which writer. The first writer that claims a session keeps it, so
/// nobody can speak for, or be lost in the name of, another. Threads: one.
class SessionBook {
 public:
  enum class Claim {
    kNew,    ///< first word of this session
    kKnown,  ///< as before
    kTaken,  ///< the session belongs to another writer, or the writer to another session
    kStale,  ///< received before its writer went: must not bring the session back
  };
  [[nodiscard]] Claim claim(SessionId session, const Handle& writer, Microseconds received);
  /// The session that is lost with this writer.
  [[nodiscard]] std::optional<SessionId> forget(const Handle& writer, Microseconds when);
  /// The writer is found again: what it says from now on counts, whatever the clock says.
  void welcome(const Handle& writer) { gone_.erase(writer); }
  /// The writer that a session speaks through.
  [[nodiscard]] std::optional<Handle> writer_of(SessionId session) const;
  /// Takes back a claim that was new.
  void release(SessionId session);
  [[nodiscard]] std::size_t size() const { return sessions_.size(); }
  /// Forgets everything. Out: the sessions that were known.
  [[nodiscard]] std::vector<SessionId> clear();

 private:
  static constexpr std::size_t kMaxGone = 4096;
  std::map<Handle, SessionId> writers_;
  std::map<SessionId, Handle> sessions_;
  std::map<Handle, Microseconds> gone_;  ///< when; until found again, at most kMaxGone
};

/// What each writer of hellos said last. A reader of Fast DDS remembers what it had of a writer
/// that its lease took, and is not sent it again when the same writer is found again, as after a
/// link was down: what that said last still holds, unless it says something else. Threads: one.
class HelloMemory {
 public:
  void heard(const Hello& hello, const Handle& writer);
  void lost(const Handle& writer);
  /// The writer is matched. Out: what it said last, if it was lost since; nullptr else.
  [[nodiscard]] const Hello* found(const Handle& writer);

 private:
  static constexpr std::size_t kMaxKnown = 256;
  struct Known {
    Hello hello;
    Handle writer;
    bool gone = false;  ///< the writer was lost, and has not been found again
  };
  std::deque<Known> known_;  ///< oldest first
};

/// Notices writers that were matched, but of which nothing comes: discovery gets through, their
/// data does not. Times are of any steady clock. Threads: one.
class SilenceWatch {
 public:
  explicit SilenceWatch(double patience_s) : patience_s_(patience_s) {}
  void matched(const Handle& writer, double now_s);
  void heard(const Handle& writer);
  void gone(const Handle& writer);
  /// Those that have said nothing since they were matched patience_s ago; each once.
  [[nodiscard]] std::vector<Handle> take_silent(double now_s);

 private:
  const double patience_s_;
  std::map<Handle, double> waiting_;  ///< since when
  std::set<Handle> heard_;            ///< may be before the match is told
};
/// What to say of such a writer, behind its name.
inline constexpr const char* kSilentHint =
    " was found and matched, but nothing comes from it: its data does not get through. On one "
    "machine with shared memory, perhaps of another user: use --transport lan on both sides. "
    "Between machines: let UDP ports from 7400 + 250 x domain on pass the firewall";

}  // namespace nearmesh::wire
