// SPDX-License-Identifier: Apache-2.0
#pragma once
// The models of a peer: which content a name stands for, the replica and its tree, and the batches that wait.

#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <optional>

#include "core/replica/replica.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber {

/// Headers that are kept though no body uses their model yet, so that one may spawn: as many as a publisher serves
/// (kMaxModels), and together no more than this.
inline constexpr std::size_t kMaxSpareHeaderBytes = 16U << 20;

/// A model that bodies of this peer use.
struct PeerModel {
  std::string name;
  std::uint64_t content_hash = 0;  // 0: nobody has announced it yet
  std::uint64_t mesh_bytes = 0;
  std::optional<Replica> replica;                 // from the header on
  std::deque<std::vector<std::uint8_t>> waiting;  // encoded batches, in order of arrival
  /// The session's time when the last look ahead found nothing to ask for.
  double looked_ahead_s = -std::numeric_limits<double>::infinity();

  std::uint32_t told_recorders = 0;  // so many of those that came know what is held

  [[nodiscard]] bool is_ready() const { return replica.has_value(); }
};

/// T_L, T_R and T_B go to the report. A batch that does not decode or contradicts the model is dropped with a complaint.
class ReplicaSet {
 public:
  PeerModel& add(const std::string& name);
  [[nodiscard]] PeerModel* find(const std::string& name);
  [[nodiscard]] PeerModel* find(std::uint64_t content_hash);
  [[nodiscard]] std::map<std::string, PeerModel>& all() { return models_; }
  [[nodiscard]] const std::map<std::string, PeerModel>& all() const { return models_; }

  /// A publisher's announcement: binds names to contents. Content that changes under a name drops the replica. Returns the
  /// size of headers that had waited for it and are used now.
  std::size_t announce(const wire::Hello& hello, std::vector<std::string>& complaints);
  /// The same of what it announces under names whose content is not known yet: for models that came into use after it.
  std::size_t announce_new(const wire::Hello& hello, std::vector<std::string>& complaints);
  /// A header: starts the replica of the model it belongs to, if any body uses it. Returns its size if it was used.
  std::size_t take_header(const wire::MeshHeader& message, std::vector<std::string>& complaints);
  /// Applies the oldest waiting batch of some model; false when none waits.
  bool apply_one(FrameReport& report);

 private:
  std::map<std::string, PeerModel> models_;
  void keep_header(const wire::MeshHeader& message);

  std::map<std::uint64_t, wire::MeshHeader>
      unclaimed_;  // headers that came before the name they belong to, or a body that uses it
  std::size_t unclaimed_bytes_ = 0;
};

}  // namespace nearmesh::subscriber
