// SPDX-License-Identifier: Apache-2.0
#pragma once
// The scene file of nearmesh-subscriber (docs/scene.md): bodies, which of them this peer moves
// along which trajectory, which pairs it asks about, frame rate and budget.

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber::program {

struct BodyOfScene {
  std::string name, model;
  bool solid = false;
  ContentHash content;  ///< pinned; or none
  std::optional<double> max_pose_age_s;
  double max_speed_mps = 0;  ///< where it is moved here
  std::optional<Pose> fixed_pose;
  std::vector<Motion> trajectory;  ///< one per frame; empty when another peer moves the body
};

struct Scene {
  std::vector<BodyOfScene> bodies;
  std::vector<std::vector<std::size_t>> robots;  ///< links that move together: places in `bodies`
  std::vector<std::pair<std::size_t, std::size_t>> pairs;  ///< places in `bodies`
  bool watches_all = false;       ///< all pairs, instead, of all bodies that others tell of too
  bool watches_only_own = false;  ///< of them those of bodies that are moved here
  double frame_rate_hz = 20;
  double budget_s = 0.01;
  double start_timeout_s = 30;
  SessionOptions session;
  static constexpr std::uint64_t kForEver = UINT64_MAX;
  /// Of the longest trajectory, or as the scene says; for ever where neither does.
  std::uint64_t frames = 0;
};

/// What a session refuses of a scene, if anything: the first in its list of bodies, robots or
/// pairs.
struct Refused {
  const char* list = nullptr;
  std::size_t place = 0;
  Status status = Status::ok();
};
/// Declares all of a scene in a session without bodies, which then numbers bodies as the scene
/// does. `moves`: of a body without a trajectory, whether it is moved here all the same.
[[nodiscard]] Refused declare(const Scene& scene, const std::function<bool(std::size_t)>& moves,
                              Session& session);

/// Errors: kIo, kInvalidArgument; each names file, line, key, what was expected and what was found.
/// What a session would refuse is refused here.
[[nodiscard]] Result<Scene> read_scene(const std::string& path);

}  // namespace nearmesh::subscriber::program
