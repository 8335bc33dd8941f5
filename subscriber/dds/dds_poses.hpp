// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whose poses of a body count: those of the peer that moved it first, until that is gone; and whether that peer is there, which the
// machine's clock decides: it gave a sign of life each second, a ProcessStatus, and has given none for some. Who never gave one is
// taken to be there until its writer goes. Fast DDS: for the rooms named dds alone.

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "core/base/stopwatch.hpp"
#include "idl/dds/body_book.hpp"
#include "idl/dds/dds_support.hpp"
#include "idl/messages/status_keeper.hpp"

namespace nearmesh::subscriber {

/// Threads: one. The mailbox must outlive it.
class DdsPoses {
 public:
  struct Heard {
    wire::BodyPose pose;
    wire::Handle writer;
  };

  /// `silence_s`: without a sign of life for so long a mover is silent; two missed ones at least.
  DdsPoses(wire::Mailbox& mailbox, std::string topic, bool is_secured, double silence_s)
      : mailbox_(mailbox),
        topic_(std::move(topic)),
        silence_s_(std::max(silence_s, 2 * wire::kStatusPeriod_s)),
        bodies_(is_secured) {}

  /// What came since the last call; `more`: some of it was not read yet. Out: the poses that count, in order. One line for each body
  /// that another claims.
  [[nodiscard]] std::vector<wire::BodyPose> take(
      const std::vector<wire::ReaderListener::Match>& matches, std::vector<Heard> heard, bool more);
  /// A sign of life of a session, from a writer of its participant's.
  void hear_sign(wire::SessionId session, const wire::Handle& writer);
  /// With a bus: nobody is known any more.
  void clear();
  /// What became of the bodies' movers since the last call: of each what holds now.
  [[nodiscard]] std::map<std::string, wire::Mover> take_changes();

 private:
  struct Moved {
    wire::Handle writer;
    wire::Mover mover = wire::Mover::kNone;  ///< as was told
  };
  /// Who writes poses.
  struct Source {
    wire::SessionId session = 0;
    double heard_s = 0;  ///< a pose or a sign of life
    bool gives_signs = false;
  };
  void accept(Heard&& heard, std::vector<wire::BodyPose>& accepted);
  void tell(const std::string& body, Moved& moved, wire::Mover now);
  void look_for_silent();
  void lose(const wire::Handle& writer, wire::Mover how);

  wire::Mailbox& mailbox_;
  const std::string topic_;
  const double silence_s_;
  wire::BodyBook bodies_;
  std::vector<std::pair<wire::Handle, wire::Mover>>
      gone_movers_;                         ///< not yet forgotten, and how they went
  std::map<std::string, Heard> contested_;  ///< of bodies that another owns, the latest
  const Stopwatch clock_;
  double looked_s_ = 0;                     ///< for silent ones, the last time
  std::map<wire::Handle, Source> sources_;  ///< by writer
  std::map<std::string, Moved> moved_;      ///< bodies whose poses count
  std::map<std::string, wire::Mover> changes_;
};

}  // namespace nearmesh::subscriber
