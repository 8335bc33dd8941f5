// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a server of detail believes that one peer holds. Takes a peer's word of its state, gives the
// same state over the model's file, so that the server can ask the peer's own questions. It is
// never believed without the state's digest.

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "core/replica/held_nodes.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh {

/// A peer's state of one model: LocalModel over the file's store.
class Mirror {
 public:
  explicit Mirror(std::shared_ptr<ModelFile> file);

  [[nodiscard]] ModelFile& file() const { return *file_; }
  [[nodiscard]] LocalModel& model() { return model_; }
  [[nodiscard]] const LocalModel& model() const { return model_; }
  [[nodiscard]] std::uint64_t state() const { return model_.mesh.state_hash(); }
  /// Does the splits of these nodes. Out: those done, also those that they rest on. Errors: those
  /// of reading the file.
  [[nodiscard]] Result<std::vector<VertexId>> split(std::span<const NodeSpan> nodes);

 private:
  std::shared_ptr<ModelFile> file_;
  LocalModel model_;
};

/// Makes a mirror that holds what a peer says (replica/held_nodes.hpp), in parts, since a word of a
/// few bytes may take 0.2 s.
class MirrorMaker {
 public:
  /// More is not taken on a peer's word: two bits may stand for a whole model.
  static constexpr std::size_t kMostHeld = 262'144;
  MirrorMaker(std::shared_ptr<ModelFile> file, std::vector<std::uint8_t> held,
              std::size_t most = kMostHeld);
  MirrorMaker(const MirrorMaker&) = delete;  // its walk refers to it

  /// Does so many nodes more, or what is left of them: those that are split, and those that
  /// half-spaces are told of, which takes as long. Out: the mirror once it holds all, else nullptr.
  /// Errors: those of held_batch(); kUnsupported for more than `most` splits in all. It is over
  /// then.
  [[nodiscard]] Result<std::shared_ptr<Mirror>> next(std::size_t nodes);
  /// So many of these were looked at, also where that failed.
  [[nodiscard]] std::size_t told_nodes() const { return told_splits_ + told_of_; }

 private:
  std::shared_ptr<Mirror> mirror_;
  HeldWalk walk_;
  std::size_t most_, told_splits_ = 0,
                     told_of_ = 0;  // the last: nodes that half-spaces are told of
};
/// The same at once.
[[nodiscard]] Result<std::shared_ptr<Mirror>> make_mirror(
    std::shared_ptr<ModelFile> file, std::vector<std::uint8_t> held,
    std::size_t most = MirrorMaker::kMostHeld);

/// The mirrors of all peers of a server. Bounded: the one that was longest without use goes first,
/// and its peer is asked what it holds. Those that were not used of late sleep: what they hold is
/// kept in two or three bits a split, and who asks for one makes it anew of these. One that is
/// awake keeps its file open, one that sleeps does not: where a tile of a world is to be closed,
/// its mirrors are to sleep. No peer takes the others' room: where that is short, the mirrors of a
/// peer that has more than one of kShares go first, and do not sleep.
/// Threads: one at a time.
class Mirrors {
 public:
  /// Together they hold so many splits at most; and so many there are.
  static constexpr std::size_t kMaxSplits = 1'000'000, kMaxMirrors = 4096;
  /// Those awake hold so many at most, some 180 bytes each; each takes as much as so many splits
  /// besides. The one used last, and what somebody works on, is awake in any case.
  static constexpr std::size_t kMaxAwakeSplits = 250'000, kSplitsAMirror = 1'000;
  static constexpr std::size_t kShares = 4;

  /// What is known of a peer's model in the state that it says.
  struct Found {
    std::shared_ptr<Mirror> mirror;  ///< awake; the one used last from now on
    /// It slept, and is here no more: of this a MirrorMaker makes it, which takes as long as a
    /// peer's word does, and then it is to be kept.
    std::vector<std::uint8_t> held;
  };
  /// Out: neither where that state is not known: the peer is to say what it holds.
  [[nodiscard]] Found find(std::uint64_t peer, const std::shared_ptr<ModelFile>& file,
                           std::uint64_t state);
  [[nodiscard]] bool is_asleep(std::uint64_t peer, const ContentHash& content) const;
  /// The peer's mirror of its model from now on.
  void keep(std::uint64_t peer, std::shared_ptr<Mirror> mirror);
  void forget(std::uint64_t peer);
  /// All of that content, of whichever peer; not those that somebody works on.
  void sleep(const ContentHash& content);
  [[nodiscard]] std::size_t awake_count() const;
  /// What those asleep take.
  [[nodiscard]] std::size_t asleep_bytes() const;

 private:
  struct Entry {
    std::uint64_t peer = 0;
    ContentHash content;
    std::shared_ptr<Mirror> mirror = nullptr;  ///< none: asleep, and what follows is what it was
    std::uint64_t asleep_state = 0;
    std::size_t asleep_splits = 0;
    std::vector<std::uint8_t> held;

    [[nodiscard]] std::uint64_t state() const { return mirror ? mirror->state() : asleep_state; }
    [[nodiscard]] std::size_t splits() const {
      return mirror ? mirror->model().mesh.split_count() : asleep_splits;
    }
    void sleep();
  };
  using Entries = std::list<Entry>;
  Entries::iterator erase(Entries::iterator entry);
  void make_room();
  template <class Size>
  void make_room(std::size_t most, Size size, bool may_sleep);

  Entries entries_;  // the one used last in front
  std::map<std::pair<std::uint64_t, ContentHash>, Entries::iterator> by_peer_;
};

}  // namespace nearmesh
