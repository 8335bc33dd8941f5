// SPDX-License-Identifier: Apache-2.0
#pragma once
// The words of the stability suite: a scene is a list of cases, a case is two bodies and a question
// whose true answer is known, a verdict is what a system answered, and `judge` says whether it was
// right.

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/base/detail/ids.hpp"
#include "nearmesh/core/geometry/pose.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh::stability {

struct Model;  // nearmesh_system.hpp

using MeshPtr = std::shared_ptr<const IndexedMesh>;

struct Body {
  MeshPtr mesh;
  Pose pose;
};

enum class Question : std::uint8_t {
  kTouch,     ///< do the surfaces share a point?
  kPairs,     ///< the same, and how many pairs of triangles share a point?
  kStream,    ///< do the surfaces share a point, when of `a` only the splits `held_a` have come?
  kSolids,    ///< do the closed bodies, taken with their insides, share a point?
  kContacts,  ///< where do the surfaces touch, and with which normal?
  kSweep,     ///< do the surfaces share a point at any time while b moves to `end_b`?
  kLimit,     ///< list at most `limit` pairs; is it plain from the answer whether there are more?
  kInvalid,   ///< a pose or a vertex is no number: only a refusal is right
  kExtreme,   ///< finite but beyond use: a refusal is right, and so is the true answer
  kThreads,   ///< do two threads at once get what one thread gets?
  kBounds,    ///< does every stored bound of a progressive model hold?
  /// Is a refined, coarsened and queried model what it is from scratch, in any order?
  kIncremental,
  kFile,  ///< can this mesh file be read?
};

/// What a mesh file must come to.
enum class FileRule : std::uint8_t { kLoad, kReject, kEither };

struct Case {
  std::string name;
  Question question = Question::kTouch;
  Body a, b;
  bool touches = false;                ///< the truth
  std::optional<std::uint64_t> pairs;  ///< the true number of touching pairs, where it is known
  std::uint32_t base_faces = 16;       ///< of nearmesh's progressive models
  /// kStream, kContacts: the baked a, of which `held_a` have come; none: all has.
  std::shared_ptr<const Model> model_a;
  std::vector<VertexId> held_a;           ///< parents first
  bool solid_a = false, solid_b = false;  ///< kSolids: which have an inside
  std::array<double, 3> normal{};         ///< kContacts: the true one, from a to b
  double position_tolerance_m = 0;        ///< kContacts: how far b is sunk into a, and 2^-16 m
  double normal_tolerance_rad = 0;        ///< kContacts
  Pose end_b;                             ///< kSweep: same rotation unless `half_turn`
  bool half_turn = false;  ///< kSweep: b turns by 180 degrees about its z axis besides
  std::size_t limit = 0;   ///< kLimit
  std::string path;        ///< kFile
  FileRule file_rule = FileRule::kLoad;  ///< kFile
};

struct Scene {
  std::string id;     ///< "F3"
  std::string title;  ///< one line
  std::vector<Case> cases;
  /// Where not empty: the answers are also judged by their number of pairs, as a row of their own
  /// with this title.
  std::string pairs_title;
};

/// One system's answer to one case. Plain bytes: it crosses a pipe.
struct Verdict {
  enum class Kind : std::uint8_t {
    kFree,
    kTouches,
    kUndecided,    ///< says that it cannot know yet
    kRefused,      ///< an error instead of an answer
    kNotOffered,   ///< the system has no such function
    kContradicts,  ///< gave two answers to one question
    kCrashed,
    kHung,
  };
  Kind kind = Kind::kNotOffered;
  bool has_pairs = false;
  std::uint64_t pairs = 0;
  double position_error_m = 0;   ///< kContacts: farthest contact point from either surface
  double normal_error_rad = 0;   ///< kContacts: largest angle to the true normal
  bool says_incomplete = false;  ///< kLimit: the answer itself tells that its list is cut
};

enum class Mark : std::uint8_t { kRight, kUndecided, kWrong, kCrash, kHang, kNotApplicable };

[[nodiscard]] Mark judge(const Case& asked, const Verdict& verdict);
/// The same question put as kPairs. Precondition: the case knows its pairs.
[[nodiscard]] Case as_pairs(Case asked);
[[nodiscard]] const char* to_string(Verdict::Kind kind);
/// What the truth is, in words, for the list of failures.
[[nodiscard]] std::string describe_truth(const Case& asked);
[[nodiscard]] std::string describe(const Verdict& verdict);

}  // namespace nearmesh::stability
