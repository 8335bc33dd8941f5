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
#include <map>
#include <memory>
#include <string>

#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::subscriber {

/// Numbers are bytes of seven bits, least first; signed ones with the sign in the lowest bit. Times are in milliseconds, each
/// as a difference.
struct Film {
  struct Peer {
    std::string mesh;     ///< what it got and lost
    std::string answers;  ///< frames, poses as it had them, answers, contacts
    std::string bus;      ///< bytes that it was sent, and what it asked for
  };
  std::string models;                 ///< vertices, nodes and faces that any peer held
  std::string world;                  ///< bodies, and their poses as their movers told them
  std::map<std::string, Peer> peers;  ///< by partition
};

struct FilmPlan {
  /// Between two changes of a peer's mesh lies so much, but where it touches something or lacks detail.
  std::int64_t least_step_ms = 0;
};

/// Errors: those of the reader; kUnsupported for another wire version; kIo where there is no memory for replicas.
/// Cost: as verify, and what changed.
[[nodiscard]] Result<Film> make_film(RecordingReader& recording, const FilmPlan& plan = {});

}  // namespace nearmesh::subscriber
