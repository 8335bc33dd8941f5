// SPDX-License-Identifier: Apache-2.0
#pragma once
// Records a live session: a passive peer that hears every sample of our topics and keeps its bytes
// (takes samples, gives core/recording). It says nothing, and holds up nobody: batches, the one
// stream whose writers wait for readers, it hears best-effort. What it misses it counts, also of
// before it came; peers that it comes to, and those that it has missed batches of, tell it what
// they hold.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"

namespace nearmesh::subscriber {

struct RecorderOptions {
  wire::TransportOptions transport;
  std::string path;  ///< of the first file; must not exist
  /// By their last name, "body_poses"; empty: all that are recorded.
  std::vector<std::string> topics;
  std::uint64_t max_bytes = 0;  ///< of a file with its log, at least kMinFileBytes; 0: no limit
  bool split = false;           ///< at max_bytes go on in another file, instead of ending
  /// What came can be read after so long.
  double commit_period_s = RecordingWriter::kCommitPeriod_s;
};
inline constexpr std::uint64_t kMinFileBytes = 256U << 10;

struct RecorderStats {
  std::uint64_t messages = 0, bytes = 0;  ///< taken, payload bytes of them
  std::uint64_t lost = 0;        ///< never came: seen as gaps in their writers' sequence numbers
  std::uint64_t before = 0;      ///< the same, of before a writer was heard
  std::uint64_t dropped = 0;     ///< came while the disk was too far behind
  std::uint64_t file_bytes = 0;  ///< of the current file with its log
  std::uint32_t parts = 1, writers = 0;
  /// Nothing is written any more: max_bytes was reached, or `status` is not ok.
  bool ended = false;
  Status status;  ///< why the disk failed
  /// Why nothing is heard any more: this program's identity was revoked or has expired.
  Status identity;
};

/// Where a sample stands among others of its topic.
struct SamplePlace {
  EndpointGuid writer{};
  std::uint64_t sequence = 0;
  std::int64_t source_ns = 0;  ///< by its writer's clock, which may be set back
};
/// In which order they are recorded. Of one writer by their numbers, whatever its clock says, for a
/// number that comes too late is taken for a gap; those of several by the latest time that each had
/// told by then. Out: places of `samples`.
[[nodiscard]] std::vector<std::size_t> order_of(const std::vector<SamplePlace>& samples);

/// Threads: all functions, one at a time. One thread inside makes the DDS calls, another writes.
class DdsRecorder {
 public:
  /// From its return on everything is heard that is sent to a matched reader; matching takes some
  /// 100 ms.
  /// Errors: kInvalidArgument naming the option; those of RecordingWriter::create; kIo when Fast
  /// DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<DdsRecorder>> create(const RecorderOptions& options);
  /// As finish(), without its status.
  ~DdsRecorder();

  [[nodiscard]] RecorderStats stats() const;
  /// One line each since the last call: malformed samples, other wire versions, incompatible QoS.
  [[nodiscard]] std::vector<std::string> take_complaints();
  /// Leaves the bus, writes what waits, closes the file. Out: what failed, at any time.
  [[nodiscard]] Status finish();

 private:
  class Impl;
  explicit DdsRecorder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber
