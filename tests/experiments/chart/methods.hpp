// SPDX-License-Identifier: Apache-2.0
#pragma once
// The methods that the chart compares, as streams: bytes arrive, the method answers with what it
// holds. All run on the same engine, codec and framing. Metres, seconds, bytes.

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "tests/experiments/perf/workloads.hpp"

namespace nearmesh::chart {

/// Two bodies and their places. The peer holds nothing of a streamed body at first, and all of one
/// that is its own.
struct Scene {
  std::string name;
  perf::Model a, b;
  bool b_streamed = false;
  /// In order; frames follow each other in time and detail stays, poses each start afresh.
  std::vector<perf::PosePair> poses;
  bool frames = false;
  /// Where `a` is a tile of a world: its faces, and by pose the pages that lead to what the body
  /// may meet.
  std::uint64_t world_faces = 0;
  struct Pages {
    std::uint64_t count = 0, bytes = 0;
  };
  std::vector<Pages> pages{};
};

/// Where the bodies are, and how they move: in a flight as from the frame before (of the first: to
/// the next), else not at all.
struct Bodies {
  Motion a, b;
};
inline constexpr double kFrame_s = 0.05;     ///< of a flight
inline constexpr double kLookahead_s = 0.5;  ///< of methods that look ahead: a session's by default

/// What a method knows after it has received so much. Times are sums since start().
struct State {
  std::uint64_t bytes = 0;  ///< received, with headers and framing
  std::uint64_t request_bytes = 0;
  /// Each a round trip; joining, which brings base meshes, is one more.
  std::uint32_t requests = 0;
  std::uint64_t splits = 0;
  double refine_s = 0, tree_s = 0, query_s = 0, load_s = 0;  ///< the paper's T_R, T_B, T_Q, T_L
  /// What the method claims to be sure of; nothing: it never is, or cannot answer yet.
  std::optional<AnswerStatus> claim;
  bool answers = false;         ///< has something to answer with
  std::vector<FacePair> pairs;  ///< touching faces, as far as known or guessed, ascending
  Contacts contacts;
  std::uint64_t faces_held = 0;  ///< of streamed bodies, in what the query walks
  std::uint64_t tree_bytes = 0;  ///< of streamed bodies, in memory
  bool finished = false;         ///< nothing more would come
};

class Method {
 public:
  virtual ~Method() = default;
  /// A peer that has just joined.
  virtual void start() = 0;
  /// Receives what comes for the poses until `max_bytes` since start() are reached, then answers.
  /// max_bytes never falls.
  [[nodiscard]] virtual State receive(const Bodies& bodies, const PosedPair& posed,
                                      std::uint64_t max_bytes) = 0;
};

struct MethodInfo {
  std::string name;
  /// Whose word a certified answer is: "client" (proved by the peer itself), "server", or "none".
  std::string proof;
  std::unique_ptr<Method> (*make)(const Scene& scene);
  bool looks_ahead = false;  ///< then only flights are played
};
/// All of them, in the order of the charts. The scene must outlive a method.
[[nodiscard]] const std::vector<MethodInfo>& methods();

/// Bytes of a message in datagrams: payload and framing.
[[nodiscard]] std::uint64_t framed(std::uint64_t payload);

// The rivals without a progressive mesh (rivals.cpp).
[[nodiscard]] std::unique_ptr<Method> make_checked_rival(const Scene& scene);
[[nodiscard]] std::unique_ptr<Method> make_chosen_rival(const Scene& scene);
[[nodiscard]] std::unique_ptr<Method> make_rival_ahead(const Scene& scene);
[[nodiscard]] std::unique_ptr<Method> make_trusted_rival(const Scene& scene);

/// Faces of streamed bodies without which no one could know which faces touch: those whose posed
/// box meets that of a face of the other body. At least 1.
class NeededFaces {
 public:
  explicit NeededFaces(const Scene& scene);
  ~NeededFaces();
  [[nodiscard]] std::uint64_t count(const PosedPair& posed) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::chart
