// SPDX-License-Identifier: Apache-2.0
#pragma once
// `watch --ros2`: what a looker-on shows to ROS 2's tools (takes what a film is made of, gives what
// Ros2Bridge writes). It has no bodies and asks nothing itself: where they are is what their movers
// say, what touches is what peers report.

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "commands.hpp"
#include "core/base/stopwatch.hpp"
#include "subscriber/dds/ros2_bridge.hpp"
#include "subscriber/recorded/film.hpp"

namespace nearmesh::subscriber::program {

class Ros2Watch final : public FilmOnlooker {
 public:
  /// Errors: those of Ros2Bridge::create.
  [[nodiscard]] static Result<std::unique_ptr<Ros2Watch>> create(const WatchOptions& options);

  void see(const wire::ContactReport& report, std::int64_t received_ns,
           const std::optional<Held>& held) override;
  void see(const std::string& body, const Pose& pose, std::int64_t received_ns) override;
  /// Hands on what was seen since the last call, and what still holds.
  void show();
  /// What is wrong, one line each.
  [[nodiscard]] std::vector<std::string> take_complaints() { return bridge_->take_complaints(); }

 private:
  struct Body {
    Pose pose;
    bool has_mover = false;   ///< somebody says where it is
    bool is_placed = true;    ///< nobody does, and it was always there
    bool is_new = false;      ///< since it was shown
    double since_s = 0;       ///< it is known
    wire::SessionId of = 0;   ///< the peer whose mesh of it is drawn
    std::uint64_t state = 0;  ///< of that mesh
    std::uint64_t readers = 0;
    double drawn_s = -1e9;
  };
  /// What a peer said last of a pair.
  struct Said {
    std::int64_t at_ns = 0;
    bool is_put_off = false;
    std::vector<ros2::Marker> marks;
  };
  struct Peer {
    std::int64_t at_ns = 0;  ///< it said something
    std::map<std::pair<std::string, std::string>, Said> pairs;
  };

  explicit Ros2Watch(const WatchOptions& options) : frame_(options.ros2.frame) {}
  void place(const std::string& name, const wire::ContactReport::Asked& asked);
  [[nodiscard]] std::vector<ros2::Marker> marks_of(const wire::ContactReport& report,
                                                   const std::optional<Held>& held);
  void draw(const std::string& name, wire::SessionId peer, const HeldBody& held);

  const std::string frame_;
  std::unique_ptr<Ros2Bridge> bridge_;
  std::map<std::string, Body> bodies_;
  std::map<wire::SessionId, Peer> peers_;
  std::map<std::tuple<wire::SessionId, std::string, std::string>, std::int32_t> numbers_;
  std::vector<ros2::Marker> meshes_;  ///< drawn and not shown yet
  std::int64_t latest_ns_ = 0;        ///< when something was heard
  const Stopwatch clock_{};
};

}  // namespace nearmesh::subscriber::program
