// SPDX-License-Identifier: Apache-2.0
#pragma once
// Healthy peers inside this process, on one host of a Lan: each with a session, a participant and a
// thread of its own, flying over the terrain until the end. What a bad peer does to them is read
// from the times of their answers.

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/base/stopwatch.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "runs.hpp"

namespace nearmesh::test {

struct FlyersOptions {
  int peers = 8;
  double rate_hz = 4;      ///< frames a second of each; they take turns within a frame's time
  double patience_s = 10;  ///< then a frame is given up, its answer never certified
};

class Flyers {
 public:
  /// Starts them.
  /// Throws std::runtime_error.
  Flyers(const Lan& lan, std::size_t host, const Exercise& exercise, std::vector<Motion> trajectory,
         const FlyersOptions& options);
  ~Flyers();
  Flyers(const Flyers&) = delete;
  Flyers& operator=(const Flyers&) = delete;

  /// One frame's answer. Seconds are those of now_s().
  struct Answer {
    int peer = 0;
    double asked_s = 0;      ///< when the frame began
    double certified_s = 0;  ///< when its answer was certified, or it was given up
    bool certified = false;
    bool waited = false;  ///< it was not certified at once, so something had to come
  };
  /// Those of frames that ended since the last call, in order of time for each peer.
  [[nodiscard]] std::vector<Answer> take_answers();
  [[nodiscard]] double now_s() const { return clock_.seconds(); }

 private:
  void fly(int peer, std::unique_ptr<subscriber::DdsChannel> made);

  const FlyersOptions options_;
  const std::vector<Motion> trajectory_;
  const Stopwatch clock_;
  std::mutex mutex_;
  std::vector<Answer> answers_;
  std::atomic<bool> ending_ = false;
  std::vector<std::thread> threads_;
};

/// A publisher on host 0, peers that fly on host 1, and host 2 for whoever disturbs or watches
/// them.
struct Airspace {
  /// Throws std::runtime_error.
  explicit Airspace(const Exercise& exercise);

  const Lan lan;
  const Folder folder;
  std::unique_ptr<Process> publisher;
  std::unique_ptr<Flyers> flyers;
};

}  // namespace nearmesh::test
