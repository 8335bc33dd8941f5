// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which publishers there are, by their hellos and by the matches of those who write them: who
// speaks for which session, what each said last, who was lost, who says nothing. Fast DDS: for the
// rooms named dds alone.

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/base/stopwatch.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/listeners.hpp"
#include "idl/dds/writer_books.hpp"

namespace nearmesh::subscriber {

/// Threads: one. The mailbox must outlive it.
class DdsHellos {
 public:
  struct Heard {
    wire::Hello hello;
    wire::Handle writer;
    wire::Microseconds received;
  };

  DdsHellos(wire::Mailbox& mailbox, std::string topic);

  /// What came since the last call. The matches come first: a publisher that was lost and found
  /// again by now has said hello again, and must be lost before that is heard, or the hello is
  /// forgotten with it. Out: the sessions that were lost.
  [[nodiscard]] std::vector<wire::SessionId> take(
      const std::vector<wire::ReaderListener::Match>& matches, std::vector<Heard> heard);
  /// The hellos of publishers that can hear requests by now: each once, and after the loss of the
  /// one before.
  template <class CanHear>
  [[nodiscard]] std::vector<wire::Hello> release(CanHear can_hear) {
    std::vector<wire::Hello> released;
    std::erase_if(waiting_, [&](Said& waiting) {
      if (!can_hear(waiting.writer)) return false;
      released.push_back(std::move(waiting.hello));
      return true;
    });
    return released;
  }
  /// A sample came from this writer, whatever it says.
  void heard_of(const wire::Handle& writer) { silence_.heard(writer); }
  /// Complains of writers that were matched long ago and have said nothing; of each once.
  void complain_of_silence();
  /// Whose hello names the publisher.
  [[nodiscard]] std::optional<wire::Handle> writer_of(wire::SessionId publisher) const {
    return book_.writer_of(publisher);
  }
  /// Those matched: who has one is a publisher.
  [[nodiscard]] const std::set<wire::Handle>& writers() const { return writers_; }
  /// With a bus: nobody is known any more. Out: the sessions that were.
  [[nodiscard]] std::vector<wire::SessionId> clear();

 private:
  struct Said {
    wire::Hello hello;
    wire::Handle writer;
  };
  void accept(const wire::Hello& hello, const wire::Handle& writer, wire::Microseconds received);
  void welcome(const wire::Handle& writer);
  [[nodiscard]] std::optional<wire::SessionId> lose(const wire::ReaderListener::Match& event);

  wire::Mailbox& mailbox_;
  const std::string topic_;
  const Stopwatch clock_;
  wire::SessionBook book_;
  wire::SilenceWatch silence_;
  std::set<wire::Handle> writers_;
  std::vector<Said> waiting_;
  std::vector<Said> contested_;  ///< of sessions that another writer holds
  wire::HelloMemory memory_;
};

}  // namespace nearmesh::subscriber
