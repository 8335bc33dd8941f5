// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recorded session as a moving picture (takes a recording, gives Film): what each peer held,
// answered and asked for, and where all bodies were, as streams of bytes that only grow. The page
// of `report` has them in it, the live page is sent them as they grow; both draw what they say.
// Rebuilt by the same code that verify runs, and held against the recorded digests.
//
// Each face, each vertex and each node of a model is told once, in `models`, however many peers
// hold it; a peer's mesh is the moments at which it got or lost one. So a session costs what
// changed in it, not its frames. The format is an agreement between film.cpp and player/film.js of
// one build, and no file format.

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/replica/replica.hpp"
#include "detail_folder.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// Numbers are bytes of seven bits, least first; signed ones with the sign in the lowest bit. Times
/// are in milliseconds, each as a difference.
struct Film {
  struct Stream {
    /// "models": vertices, nodes and faces that any peer held. "world": bodies, and their poses as
    /// their movers told them. Of each peer, with its partition, "mesh-": what it got and lost;
    /// "answers-": frames, poses as it had them, answers, contacts; "bus-": bytes that it was sent,
    /// and what it asked for.
    std::string name, bytes;
  };
  std::vector<Stream> streams;
  std::vector<std::string> peers;  ///< partitions
};

/// Sees what a film is made of, as it comes: of each peer in order.
class FilmOnlooker {
 public:
  FilmOnlooker() = default;
  FilmOnlooker(const FilmOnlooker&) = delete;
  FilmOnlooker& operator=(const FilmOnlooker&) = delete;
  virtual ~FilmOnlooker() = default;

  /// What a peer held of a body when it answered.
  class HeldBody {
   public:
    explicit HeldBody(const Replica& replica) : replica_(replica) {}
    [[nodiscard]] int exponent() const;         ///< of the grid
    [[nodiscard]] std::uint64_t state() const;  ///< a digest
    /// As core/replica/triangles.hpp.
    void add_triangles(std::vector<std::array<double, 3>>& exact_m,
                       std::vector<std::array<double, 3>>& coarse_m) const;

   private:
    const Replica& replica_;
  };
  /// Of both, and where they touch: of an answer in contact or not certified.
  struct Held {
    HeldBody a, b;
    const Contacts* contacts = nullptr;
  };
  /// `held`: none where that cannot be rebuilt.
  virtual void see(const wire::ContactReport& report, std::int64_t received_ns,
                   const std::optional<Held>& held) = 0;
  /// A body's pose, as its mover told it.
  virtual void see(const std::string& body, const Pose& pose, std::int64_t received_ns) = 0;
};

struct FilmPlan {
  /// Between two changes of a peer's mesh lies so much, but where it touches something or lacks
  /// detail.
  std::int64_t least_step_ms = 0;
  DetailFolder* models = nullptr;    ///< to take peers up where batches are missing
  FilmOnlooker* onlooker = nullptr;  ///< none: nobody else
};

/// Of a recording that may still grow.
class FilmMaker {
 public:
  explicit FilmMaker(const FilmPlan& plan);
  ~FilmMaker();
  /// Takes what came since the last call. In: the same recording each time, opened anew. `final`:
  /// nothing more comes.
  /// Errors: those of make_film(); after one nothing more may be asked.
  [[nodiscard]] Status go_on(RecordingReader& recording, bool final);
  /// As they are now, in the order in which they must be read. They only grow, by whole records.
  void visit(
      const std::function<void(const std::string& name, const std::string& bytes)>& visit) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Errors: those of the reader; kUnsupported for another wire version; kIo where there is no memory
/// for replicas.
/// Cost: as verify, and what changed.
[[nodiscard]] Result<Film> make_film(RecordingReader& recording, const FilmPlan& plan = {});

}  // namespace nearmesh::subscriber
