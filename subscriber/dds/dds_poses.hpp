// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whose poses of a body count: those of the peer that moved it first, until that is gone. Fast DDS: for the rooms named dds alone.

#include <map>
#include <string>
#include <vector>

#include "idl/dds/body_book.hpp"
#include "idl/dds/dds_support.hpp"

namespace nearmesh::subscriber {

/// Threads: one. The mailbox must outlive it.
class DdsPoses {
 public:
  struct Heard {
    wire::BodyPose pose;
    wire::Handle writer;
  };

  DdsPoses(wire::Mailbox& mailbox, std::string topic, bool is_secured)
      : mailbox_(mailbox), topic_(std::move(topic)), bodies_(is_secured) {}

  /// What came since the last call; `more`: some of it was not read yet. Out: the poses that count, in order. One line for each body
  /// that another claims.
  [[nodiscard]] std::vector<wire::BodyPose> take(
      const std::vector<wire::ReaderListener::Match>& matches, std::vector<Heard> heard, bool more);
  /// With a bus: nobody is known any more.
  void clear();

 private:
  void accept(Heard&& heard, std::vector<wire::BodyPose>& accepted);

  wire::Mailbox& mailbox_;
  const std::string topic_;
  wire::BodyBook bodies_;
  std::vector<wire::Handle> gone_movers_;   ///< not yet forgotten
  std::map<std::string, Heard> contested_;  ///< of bodies that another owns, the latest
};

}  // namespace nearmesh::subscriber
