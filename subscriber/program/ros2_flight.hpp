// SPDX-License-Identifier: Apache-2.0
#pragma once
// `run --ros2`, `--ros2-poses`: what a flight shows to ROS 2's tools, and the bodies that ROS 2's
// programs move.

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "commands.hpp"
#include "core/base/stopwatch.hpp"
#include "scene.hpp"
#include "subscriber/dds/ros2_bridge.hpp"

namespace nearmesh::subscriber::program {

/// The stamp of what is shown: the newest that was heard, 0 for none. One that is older by more
/// than a second is of a clock that has begun anew, as a simulator's does that is reset, or follows
/// one that was ahead of it.
[[nodiscard]] std::int64_t stamp_after(std::int64_t shown_ns, std::int64_t heard_ns);

/// Bodies that ROS 2 has farther from where they were than others were promised, as where a robot
/// finds out that it is elsewhere, or a simulator is reset. Threads: one.
class Ros2Jumps {
 public:
  /// Takes these out of the motions: of such a body nothing is certified until its motions are in
  /// keeping with all that was promised, at the latest when the last of the promises has ended. One
  /// line where it begins.
  void take_out(Session& session, double time_s, std::vector<Session::OwnMotion>& motions,
                std::vector<std::string>& complaints);

 private:
  std::set<BodyId> jumped_;
};

class Ros2Flight {
 public:
  /// Nothing where neither flag was given. Errors: kInvalidArgument naming the body; those of
  /// Ros2Bridge::create.
  [[nodiscard]] static Result<std::unique_ptr<Ros2Flight>> create(const RunOptions& options,
                                                                  const Scene& scene);

  /// The body, by its place in the scene, is moved by ROS 2.
  [[nodiscard]] bool moves(std::size_t body) const;
  /// Adds those that were heard since the last call.
  void add_motions(std::vector<Session::OwnMotion>& motions);
  /// Before each update: as Ros2Jumps.
  void take_out_jumps(Session& session, double time_s, std::vector<Session::OwnMotion>& motions) {
    jumps_.take_out(session, time_s, motions, complaints_);
  }
  /// After each update. Shows it, at most `kMostShown_hz` times a second.
  void show(const FrameReport& report, const Session& session);
  /// What is wrong, one line each.
  [[nodiscard]] std::vector<std::string> take_complaints();
  [[nodiscard]] Ros2Bridge::Counts counts() const { return bridge_->counts(); }

 private:
  struct Shown {
    std::uint64_t state = 0, readers = 0;
    double at_s = -1e9;
    Pose pose;
    bool has_pose = false;
  };
  Ros2Flight(const RunOptions& options, const Scene& scene) : options_(options), scene_(scene) {}
  [[nodiscard]] std::vector<BodyId> fresh_bodies(const FrameReport& report, const Session& session);
  void add_marks(const PairAnswer& pair, const Session& session, Ros2View& view);
  void add_cross(BodyId body, const Session& session, Ros2View& view) const;
  void add_mesh(const Session& session, Ros2View& view);

  const RunOptions& options_;
  const Scene& scene_;
  std::unique_ptr<Ros2Bridge> bridge_;
  std::map<std::size_t, std::size_t> moved_;  ///< place in the scene: place in --ros2-poses
  Ros2Jumps jumps_;
  std::vector<std::string> complaints_;
  std::map<BodyId, Shown> bodies_;
  std::map<std::pair<BodyId, BodyId>, std::int32_t> pairs_;  ///< numbers of markers
  std::int32_t numbered_ = 0;
  std::int64_t heard_stamp_ns_ = 0;
  std::uint32_t next_mesh_ = 0;  ///< bodies have their turn
  const Stopwatch clock_{};
  double shown_s_ = -1;
};

}  // namespace nearmesh::subscriber::program
