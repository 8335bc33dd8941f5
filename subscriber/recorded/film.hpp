// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recorded session as a moving picture (takes a recording, gives Film): what each peer held, answered and asked for, and
// where all bodies were, as streams of bytes that only grow. The page of `report` has them in it, the live page is sent them
// as they grow; both draw what they say. Rebuilt by the same code that verify runs, and held against the recorded digests.
//
// Each face, each vertex and each node of a model is told once, in `models`, however many peers hold it; a peer's mesh is
// the moments at which it got or lost one. So a session costs what changed in it, not its frames.
// The format is an agreement between film.cpp and player/film.js of one build, and no file format.

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/spm/model_folder.hpp"
#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::subscriber {

/// Numbers are bytes of seven bits, least first; signed ones with the sign in the lowest bit. Times are in milliseconds, each
/// as a difference.
struct Film {
  struct Stream {
    /// "models": vertices, nodes and faces that any peer held. "world": bodies, and their poses as their movers told them. Of each
    /// peer, with its partition, "mesh-": what it got and lost; "answers-": frames, poses as it had them, answers, contacts;
    /// "bus-": bytes that it was sent, and what it asked for.
    std::string name, bytes;
  };
  std::vector<Stream> streams;
  std::vector<std::string> peers;  ///< partitions
};

struct FilmPlan {
  /// Between two changes of a peer's mesh lies so much, but where it touches something or lacks detail.
  std::int64_t least_step_ms = 0;
  ModelFolder* models = nullptr;  ///< to take peers up where batches are missing
};

/// Of a recording that may still grow.
class FilmMaker {
 public:
  explicit FilmMaker(const FilmPlan& plan);
  ~FilmMaker();
  /// Takes what came since the last call. In: the same recording each time, opened anew. `final`: nothing more comes.
  /// Errors: those of make_film(); after one nothing more may be asked.
  [[nodiscard]] Status go_on(RecordingReader& recording, bool final);
  /// As they are now, in the order in which they must be read. They only grow, by whole records.
  void visit(
      const std::function<void(const std::string& name, const std::string& bytes)>& visit) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Errors: those of the reader; kUnsupported for another wire version; kIo where there is no memory for replicas.
/// Cost: as verify, and what changed.
[[nodiscard]] Result<Film> make_film(RecordingReader& recording, const FilmPlan& plan = {});

}  // namespace nearmesh::subscriber
