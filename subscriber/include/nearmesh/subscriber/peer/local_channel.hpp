// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A peer's channel without a network: serves models straight from their .spm files, chosen as a
// publisher chooses. For hosts' unit tests, and for programs that have the files at hand. Takes
// RegionSubscription, gives SplitBatch; needs no DDS (NEARMESH_WITH_DDS=OFF builds it).

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/subscriber/peer/channel.hpp"

namespace nearmesh {
class Mirrors;
class WorldSource;
}  // namespace nearmesh

namespace nearmesh::subscriber {

/// A request that is sent in one update is answered in full in the next, so a host's test is: add
/// the models, make a Session, update until it is certified; the same numbers of updates on every
/// machine, since no clock is involved. Memory: what the requests touch of the files. Cost: of an
/// answer as in demand/collect.hpp, in the caller's send().
/// Threads: one at a time, the Session's; models of two channels do not share anything.
class LocalChannel final : public Channel {
 public:
  LocalChannel();
  ~LocalChannel() override;

  /// Serves a model under a name, from the next take() on; also later, as a publisher may come that
  /// late.
  /// Errors: kInvalidArgument (name, too many models); kConflict (the name is taken, or the same
  /// content is served).
  [[nodiscard]] Status add_model(const std::string& name, ModelFile file);

  /// Serves a world on disk (docs/worlds.md) as a model of that name: pages, tiles' headers and
  /// detail as they are asked for, as many tiles open as a publisher has.
  /// Errors: as add_model(); kNotFound, kIo, kCorrupt, kUnsupported, naming the file.
  [[nodiscard]] Status add_world(const std::string& name, const std::string& folder);

  /// False: as when the network goes down; the publisher is lost, nothing is answered, who moved
  /// the other bodies has left, and nobody's pose arrives until it is true again. To test what a
  /// host does while answers are uncertain.
  void set_connected(bool connected);

  /// As if another peer had moved one of its bodies. Dropped while not connected.
  /// Errors: those of wire::check.
  [[nodiscard]] Status deliver(const wire::BodyPose& pose);

  [[nodiscard]] wire::SessionId own_id() const override { return kPeer; }
  /// Seconds, of the caller's in this call and in send(). What is left of an answer follows later,
  /// as from a slow link. Too little for a step of the work: nothing is done, but a step in each
  /// eighth such call. Never called: all at once.
  void allow(double seconds) override;
  [[nodiscard]] double needs_s() const override;
  void send(const wire::RegionSubscription& subscription) override;
  void send(const wire::BodyPoses&) override {}      ///< nobody else is there
  void send(const wire::BodyDirectory&) override {}  ///< nobody else is there
  void send(const wire::ContactReport&) override {}  ///< nobody else is there
  [[nodiscard]] Inbox take() override;

 private:
  static constexpr wire::SessionId kPeer = 1, kPublisher = 2;
  struct Model {
    std::string name;
    std::shared_ptr<ModelFile> file;
  };
  struct World;
  void announce();
  [[nodiscard]] std::shared_ptr<ModelFile> file_of(const ContentHash& content) const;
  [[nodiscard]] Result<std::shared_ptr<ModelFile>> open_tile(WorldSource& world,
                                                             const ContentHash& content) const;
  [[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> answer_of_world(
      const wire::RegionSubscription& subscription);
  [[nodiscard]] std::vector<wire::SplitBatchMessage> answer(
      const wire::RegionSubscription& subscription);
  void certify(const wire::RegionSubscription& subscription);
  void go_on();
  void deliver(std::vector<wire::SplitBatchMessage>&& messages);

  std::map<ContentHash, Model> models_;  // by content hash
  std::vector<World> worlds_;
  std::unique_ptr<Mirrors> mirrors_;  // of the peer's state
  struct Begun;                       // an answer
  std::unique_ptr<Begun> begun_;
  struct Pace;  // of the steps
  std::unique_ptr<Pace> pace_;
  int waited_ = 0;                                              // calls in a row, with work to do
  double allowed_s_ = std::numeric_limits<double>::infinity();  // since allow()
  std::set<std::string> delivered_;                             // bodies of others
  Inbox inbox_;
  std::uint32_t sequence_ = 0;
  bool connected_ = true;
};

}  // namespace nearmesh::subscriber
