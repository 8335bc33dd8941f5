// SPDX-License-Identifier: Apache-2.0
#pragma once
// A peer inside this process that can be told where to be: finds out whether detail still comes.

#include <memory>
#include <string>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "runs.hpp"

namespace nearmesh::test {

class ProbePeer {
 public:
  /// On the host. The exercise's models: a terrain, and an aircraft that is the peer's own. Throws
  /// std::runtime_error.
  ProbePeer(const Lan& lan, std::size_t host, const Exercise& exercise);

  /// Goes to the number-th of many places on the terrain, far from the others, where it touches the
  /// ground: no such answer is certified without detail that came since. Waits for one so long.
  /// Out: how long it took, or -1.
  double certify_at(std::uint32_t number, double seconds);
  /// Certified answers that the full meshes contradict.
  [[nodiscard]] std::uint64_t wrong() const { return wrong_; }
  /// Of the last answer that was not certified; may be empty.
  [[nodiscard]] const std::string& reason() const { return reason_; }

 private:
  struct Full {
    std::unique_ptr<ModelFile> file;
    TriangleTree tree;
  };
  [[nodiscard]] static Full load(const std::string& path);
  void check(const subscriber::PairAnswer& answer);

  Full ground_, aircraft_;
  std::unique_ptr<subscriber::Session> session_;
  subscriber::BodyId own_;
  const Stopwatch clock_;
  std::uint64_t frame_ = 0, wrong_ = 0;
  std::string reason_;
};

}  // namespace nearmesh::test
