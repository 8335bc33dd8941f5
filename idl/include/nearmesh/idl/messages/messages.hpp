// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// What travels between publisher and peers, as plain structs: no DDS type is seen outside the rooms named dds.
// Every struct is checked on receipt (check_*): sizes, counts, enums and finite numbers; a sample that
// fails is dropped with one line that says why, and nothing else notices.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/geometry/pose.hpp"
#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh {
class ModelFile;
}

namespace nearmesh::wire {

/// Raised with every change of a topic's layout or of the batch codec. Peers of another version are refused loudly.
inline constexpr std::uint16_t kWireVersion = 6;

/// Random per process; tells a restarted publisher from the old one, and names a peer.
using SessionId = std::uint64_t;

inline constexpr std::size_t kMaxNameBytes = 63;
inline constexpr std::size_t kMaxModels = 256;
inline constexpr std::size_t kMaxReportPairs = 64;

/// Latest state of one publisher (keyed by session, transient local).
struct Hello {
  std::uint16_t wire_version = kWireVersion;
  SessionId publisher = 0;
  struct Model {
    std::string name;  ///< unique per publisher, at most kMaxNameBytes
    std::uint64_t content_hash = 0;
    std::uint64_t mesh_bytes = 0;  ///< header and all blocks: what a whole replica would take
  };
  std::vector<Model> models;
};

/// Header of one model (keyed by content hash, transient local): SpmHeader as encoded in the file.
struct MeshHeader {
  std::uint16_t wire_version = kWireVersion;
  std::string name;
  std::uint64_t content_hash = 0;
  std::vector<std::uint8_t> bytes;  ///< at most kMaxHeaderBytes
};

/// What a peer lacks, and how much it is ready to take (keyed by peer).
struct RegionSubscription {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::uint32_t request = 0;       ///< counts up per peer; 0: no request, only credit
  std::uint64_t content_hash = 0;  ///< the model; meaningless when request is 0
  std::uint8_t priority = 0;       ///< 0 needed now, 1 horizon
  SessionId publisher = 0;         ///< whom it is for; others ignore it
  std::uint32_t acknowledged_sequence =
      0;                               ///< highest batch sequence received from it: returns credit
  std::uint32_t window_bytes = 65536;  ///< the publisher keeps at most this much unacknowledged
  RegionRequest region;
};

/// One encoded batch for one peer (a partition per peer).
struct SplitBatchMessage {
  std::uint16_t wire_version = kWireVersion;
  SessionId publisher = 0;
  std::uint64_t content_hash = 0;
  std::uint32_t request = 0;   ///< which request it answers
  std::uint32_t sequence = 0;  ///< counts up per publisher and peer, from 1: gaps are noticed
  bool last = false;           ///< the request is answered in full with this one
  bool refused = false;        ///< the request was refused; bytes hold the reason as text
  std::vector<std::uint8_t>
      bytes;  ///< at most kMaxBatchBytes; may be empty when nothing was needed
};

/// Where a body is (keyed by body name; the peer that moves it publishes).
struct BodyPose {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::string body;
  std::uint64_t frame = 0;
  double time_s = 0;
  Pose pose;
  std::array<double, 3> linear_velocity_mps{};
  std::array<double, 3> angular_velocity_radps{};
};

/// An answer about a pair of bodies, for whoever listens (keyed by peer and pair). With the batches that the peer was sent it
/// is enough to ask the same again.
struct ContactReport {
  /// One of the two bodies as it was when it was asked about.
  struct Asked {
    std::uint64_t content_hash = 0;
    std::uint64_t state_digest = 0;  ///< of the model's active vertices
    std::uint32_t applied_batches =
        0;  ///< so many of the model, in order of arrival, had been taken in
    bool solid = false;
    Pose pose;
  };
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::string body_a, body_b;
  std::uint64_t frame = 0;
  double time_s = 0;
  std::uint8_t status = 0;       ///< AnswerStatus, 0 to 4
  double clearance_m = 0;        ///< lower bound, when free or contained
  double uncertainty_m = 0;      ///< when uncertain
  std::uint32_t pair_count = 0;  ///< all exact pairs
  bool asked = false;            ///< false: a header or a pose was missing, so nothing was asked
  bool gave_up_detail =
      false;  ///< of one of the models, at some time: applied_batches do not tell the state
  std::uint64_t answer_digest = 0;            ///< digest(Answer)
  Asked a, b;                                 ///< when asked
  std::vector<std::array<FaceKey, 2>> pairs;  ///< the first kMaxReportPairs of them
};

/// Why the door before Fast DDS refused a message (docs/network.md).
enum class DoorRefusal : std::uint8_t {
  kHeader,       ///< is no RTPS message
  kSubmessages,  ///< lengths that do not add up, something behind the end
  kStatistics,   ///< a statistics submessage that is malformed, or not the last
  kSequence,     ///< sequence numbers that no writer reaches
  kFragments,    ///< fragments of a sample that cannot be
  kParameters,   ///< malformed discovery, inline QoS or handshake
  kSource,       ///< in the name of a participant that speaks from elsewhere
  kCrowd,        ///< one unknown participant of too many; is let in when it speaks again
};
inline constexpr std::size_t kDoorRefusals = 8;
/// "header", "submessages", "statistics", "sequence", "fragments", "parameters", "source", "crowd".
[[nodiscard]] const char* to_string(DoorRefusal refusal);

/// What one process knows of itself (keyed by session, transient local, renewed each second): for operators, who cannot see
/// it from outside. Nothing else depends on it.
struct ProcessStatus {
  std::uint16_t wire_version = kWireVersion;
  SessionId session = 0;
  bool is_publisher = false;
  std::string host;
  std::uint32_t process_id = 0;
  double uptime_s = 0;
  double bytes_per_s = 0;    ///< of batches, over the last second: sent, or received
  double uncertainty_m = 0;  ///< a peer's largest bound of an answer that is not certified
  std::uint32_t peers = 0;   ///< that a publisher serves
  std::uint32_t watched_pairs = 0, certified_pairs = 0;
  std::uint64_t requests = 0, refused = 0;  ///< since the start
  std::uint64_t batches = 0, bytes = 0;     ///< sent, or received, since the start
  std::uint64_t lost_batches = 0;           ///< never came
  std::uint64_t waiting_batches = 0;        ///< to be sent, or to be taken in
  std::uint64_t resident_bytes = 0;
  bool has_door = false;  ///< before Fast DDS, on the participant of this session
  std::array<std::uint64_t, kDoorRefusals> door_refused{};  ///< messages, by DoorRefusal
  struct Model {
    std::string name;
    std::uint64_t content_hash = 0;
    std::uint64_t faces = 0, held_splits = 0, splits = 0;  ///< 0 until the header has come
  };
  std::vector<Model> models;            ///< served, or used
  std::vector<std::string> complaints;  ///< the newest kMaxStatusLines of the last minute
};
inline constexpr std::size_t kMaxStatusLines = 16;
inline constexpr std::size_t kMaxStatusLineBytes = 255;

/// One line as it may stand in a ProcessStatus: cut, with other bytes than printable ASCII replaced.
[[nodiscard]] std::string status_line(std::string line);

/// Bytes of a self-test, to be sent back (nearmesh-subscriber doctor).
struct Echo {
  std::uint16_t wire_version = kWireVersion;
  SessionId from = 0;
  SessionId to = 0;  ///< 0: whoever listens
  std::uint32_t number = 0;
  bool is_reply = false;
  std::vector<std::uint8_t> bytes;
};
inline constexpr std::size_t kMaxEchoBytes = 1U << 20;
/// An Echo that may be lost: on a topic of its own.
struct Probe : Echo {};

/// Whether who serves `served` models may serve another under this name. Errors: kInvalidArgument naming the limit.
[[nodiscard]] Status check_new_model(const std::string& name, std::size_t served);

/// What is told of a model that is served: adds it to the hello. Out: its header.
[[nodiscard]] MeshHeader announce_model(const std::string& name, const ModelFile& file,
                                        Hello& hello);

/// The batches of an answer, or of a part of one, as messages to the peer that asked; their sequence is the channel's to count.
/// `last`: the request is answered in full with these. That nothing was needed is an answer too: one message without bytes.
[[nodiscard]] std::vector<SplitBatchMessage> answer_messages(
    SessionId publisher, const RegionSubscription& request,
    std::vector<std::vector<std::uint8_t>> batches, bool last);
/// The same of a request that is refused, with as much of the reason as a batch holds.
[[nodiscard]] SplitBatchMessage refusal_message(SessionId publisher,
                                                const RegionSubscription& request,
                                                const std::string& why);

[[nodiscard]] Status check(const Hello& message);
[[nodiscard]] Status check(const MeshHeader& message);
[[nodiscard]] Status check(const RegionSubscription& message);
[[nodiscard]] Status check(const SplitBatchMessage& message);
[[nodiscard]] Status check(const BodyPose& message);
[[nodiscard]] Status check(const ContactReport& message);
[[nodiscard]] Status check(const ProcessStatus& message);
[[nodiscard]] Status check(const Echo& message);

}  // namespace nearmesh::wire
