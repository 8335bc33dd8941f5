// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// What travels between publisher and peers, as plain structs: no DDS type is seen outside the rooms
// named dds. Every struct is checked on receipt by check(): sizes, counts, enums and finite
// numbers. A sample that fails is dropped with one line that says why, and nothing else notices.
// Lengths are metres, times seconds, ids 64 bits.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/geometry/pose.hpp"
#include "nearmesh/core/spm/detail/certificate_request.hpp"
#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh {
class ModelFile;
}

namespace nearmesh::wire {

/// Raised with every change of a topic's layout or of the batch codec. Peers of another version are
/// refused loudly.
inline constexpr std::uint16_t kWireVersion = 15;

/// Random per process; tells a restarted publisher from the old one, and names a peer.
using SessionId = std::uint64_t;

inline constexpr std::size_t kMaxNameBytes = 63;
inline constexpr std::size_t kMaxModels = 256;
inline constexpr std::size_t kMaxReportPairs = 64;
/// Times lie within so many seconds of 0: 3,000 years, in which doubles still tell 20 microseconds
/// apart. What counts milliseconds or nanoseconds since 1970 is refused.
inline constexpr double kMaxTime_s = 1e11;
[[nodiscard]] constexpr bool is_time(double time_s) {
  return time_s >= -kMaxTime_s && time_s <= kMaxTime_s;  // false for what is no number
}
/// Who goes on from a time that others say does so from one within so many seconds of 0, 300 years:
/// from there a clock runs for 2,800 years before its times are refused.
inline constexpr double kMaxFollowed_s = 1e10;

/// When a content begins to stand for its name.
struct Epoch {
  /// The greatest one that has begun stands; 0: that of contents without one.
  std::uint32_t number = 0;
  double from_s = 0;  ///< it begins at this time, on the exercise's clock; 0 has no beginning
  bool operator==(const Epoch&) const = default;
  [[nodiscard]] bool has_begun(double time_s) const { return number == 0 || time_s >= from_s; }
};

/// Latest state of one publisher (keyed by session, transient local).
struct Hello {
  std::uint16_t wire_version = kWireVersion;
  SessionId publisher = 0;
  std::string name;  ///< of the process, for people; as in ProcessStatus; "" where it has none
  struct Model {
    std::string name;  ///< unique per publisher, at most kMaxNameBytes
    ContentHash content_hash;
    std::uint64_t mesh_bytes = 0;  ///< header and all blocks: what a whole replica would take
    ContentHash replaces;  ///< peers that hold this content go over to the one above; or none
    Epoch epoch;
  };
  std::vector<Model> models;
};

/// Header of one model (keyed by content hash, transient local): SpmHeader as encoded in the file.
/// The content hash is that of the bytes, so a header needs no other proof.
struct MeshHeader {
  std::uint16_t wire_version = kWireVersion;
  std::string name;
  ContentHash content_hash;
  std::vector<std::uint8_t> bytes;  ///< at most kMaxHeaderBytes
};

/// What a peer lacks, and how much it is ready to take (keyed by peer). It says where its bodies
/// are and what it holds, and the publisher chooses what certifies (`certificate`); or it names
/// what it lacks of one model itself (`region`).
struct RegionSubscription {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::uint32_t request = 0;  ///< counts up per peer; 0: no request, only credit
  ContentHash content_hash;   ///< the region's model; else meaningless
  std::uint8_t priority = 0;  ///< 0 needed now, 1 horizon
  SessionId publisher = 0;    ///< whom it is for; others ignore it
  /// Highest batch sequence received from it: returns credit.
  std::uint32_t acknowledged_sequence = 0;
  std::uint32_t window_bytes = 65536;  ///< the publisher keeps at most this much unacknowledged
  RegionRequest region;
  std::optional<CertificateRequest> certificate;  ///< then the region is empty
};

/// One encoded batch for one peer (a partition per peer), and what else had room beside it.
struct SplitBatchMessage {
  std::uint16_t wire_version = kWireVersion;
  SessionId publisher = 0;
  ContentHash content_hash;
  std::uint32_t request = 0;   ///< which request it answers
  std::uint32_t sequence = 0;  ///< counts up per publisher and peer, from 1: gaps are noticed
  bool last = false;           ///< the request is answered in full with this one
  bool refused = false;        ///< the request was refused; bytes hold the reason as text
  /// Refused, because the publisher does not know the state that the peer says of this content: say
  /// what is held, too.
  bool wants_held = false;
  /// Refused, because the publisher does not choose for bodies of this content (none: of the whole
  /// request): ask for regions.
  bool wants_regions = false;
  /// The bytes are no batch, but a piece of those that the content is the digest of
  /// (core/world/content_bytes.hpp).
  bool is_piece = false;
  /// Sealed (codec.hpp), at most kMaxSealedBytes; may be empty when nothing was needed.
  std::vector<std::uint8_t> bytes;
  /// Further batches of the same answer, mostly of another content, in the same sample: a datagram
  /// less for each. Their sequences follow on. `last` is said of the last of all.
  struct Joined {
    ContentHash content_hash;
    std::vector<std::uint8_t> bytes;
  };
  std::vector<Joined> joined = {};
};

/// A peer numbers the bodies that it moves from 0, each number once, and tells of them in parts of
/// so many neighbours: as many poses as one datagram holds.
inline constexpr std::uint32_t kBodiesPerPart = 7;

/// Where the bodies of a part are (keyed by peer and part; the peer that moves them publishes): all
/// of them that have a pose, as each sample replaces the one before.
struct BodyPoses {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::uint32_t part = 0;
  std::uint64_t frame = 0;
  /// Counts up per peer, over all parts, from 1, and after the highest from 1 again; 0: it does not
  /// count, and nothing that rests on it can be proved.
  std::uint32_t sequence = 0;
  struct Body {
    std::uint32_t number = 0;
    double time_s = 0;  ///< of the pose, on the exercise's clock
    Motion motion;
  };
  std::vector<Body> bodies;  ///< of the part, by number
};

/// Which update of its mover a link's pose is of: the number of the sample that has the robot's
/// first link in that update, by that of the sample with this one. An update sends the parts of a
/// robot one right after the other, so this is the same for all links of one update, and another
/// for each of two updates of one time. Precondition: the sample's number is not 0.
[[nodiscard]] constexpr std::uint32_t first_sample_of_robot(std::uint32_t sequence,
                                                            std::uint32_t number,
                                                            std::uint32_t first_link) {
  const std::uint32_t before = number / kBodiesPerPart - first_link / kBodiesPerPart;
  return sequence - before - (sequence <= before ? 1 : 0);  // 0 is no number
}

/// Poses that go only to the peers that asked for them (WantedPoses), and to recorders: of bodies
/// of which promises are made. On a topic of its own, with sequences of its own.
struct NearPoses : BodyPoses {};

/// Promises are told of so many neighbours at once: by number, as in BodyPoses.
inline constexpr std::uint32_t kBodiesPerPromise = 32;
/// A promise holds for whole steps of this, so many at most; seconds.
inline constexpr double kPromiseStep_s = 0x1p-8, kMaxPromise_s = 255;
/// Places are counted in quanta of 2^exponent metres.
inline constexpr int kMinQuantum = -20, kMaxQuantum = 20;
/// Places lie within so many metres of 0: farther than any pose.
inline constexpr double kMaxPlace_m = 0x1p48;

/// Where the bodies of a part stay (keyed by peer and part, transient local), of each its origin:
/// from `from_s` to until_s(), on the exercise's clock, it is no farther from its place than one
/// quantum and the way that its greatest speed (BodyDirectory) allows since `from_s`. A body that
/// is not in here keeps the promise that was made of it before.
struct BodyPromises {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::uint32_t part = 0;
  double from_s = 0;
  std::uint16_t steps = 0;     ///< it holds so long, kPromiseStep_s each; 1 at least
  std::uint32_t sequence = 0;  ///< counts up per peer, over all parts, from 1; 0: it does not count
  std::int8_t quantum = 0;     ///< exponent of the quantum, kMinQuantum to kMaxQuantum
  struct Body {
    std::uint32_t number = 0;
    std::array<std::int64_t, 3> place{};  ///< in quanta, the world's axes
    bool operator==(const Body&) const = default;
  };
  std::vector<Body> bodies;  ///< of the part, by number

  [[nodiscard]] double until_s() const { return from_s + steps * kPromiseStep_s; }
};

/// Which bodies of one mover a peer wants full poses of (keyed by peer and mover): said when that
/// changes, and again as long as it wants some, for a mover forgets it after kWantedFor_s.
struct WantedPoses {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;   ///< who wants
  SessionId mover = 0;  ///< whose bodies
  struct Part {
    std::uint32_t part = 0;   ///< as in BodyPoses
    std::uint8_t places = 0;  ///< a bit for each of its bodies, the lowest for the first
    bool operator==(const Part&) const = default;
  };
  std::vector<Part> parts;  ///< by number, at most kMaxWantedParts; none: nothing any more

  [[nodiscard]] bool wants(std::uint32_t number) const;
};
inline constexpr std::size_t kMaxWantedParts = 256;
inline constexpr double kWantedFor_s = 3;  ///< by the machine's clock

/// Who the bodies of a part are (keyed by peer and part, transient local).
struct BodyDirectory {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::uint32_t part = 0;
  struct Body {
    std::uint32_t number = 0;
    std::string name, model;  ///< 1 to kMaxNameBytes
    ContentHash content;      ///< that the peer pins the model to; or none
    bool solid = false;
    std::uint32_t group = 1, mask = 0xffffffffU;
    /// Of its origin, which the peer keeps it to: then promises are told of it, and full poses to
    /// those alone who want them. 0: not so.
    double max_speed_mps = 0;
    /// It is a link of a robot: the bodies of the numbers first_link to first_link + links - 1, in
    /// as many parts as that takes. Their poses count only together, those of one time and one
    /// update (first_sample_of_robot). 1: it is none.
    std::uint32_t links = 1, first_link = 0;
    bool operator==(const Body&) const = default;
  };
  std::vector<Body> bodies;  ///< of the part, by number
};
inline constexpr std::uint32_t kMaxLinks = 256;  ///< of a robot
inline constexpr double kMaxSpeed_mps = 1e6;     ///< that a body may have by its mover's word

/// Where a body is, by the body's name: a pose and the directory, brought together. Does not
/// travel.
struct BodyPose {
  SessionId peer = 0;
  std::string body;
  std::uint64_t frame = 0;
  double time_s = 0;  ///< of the pose, on the exercise's clock
  Pose pose;
  std::array<double, 3> linear_velocity_mps{};
  std::array<double, 3> angular_velocity_radps{};
  std::uint32_t number = 0;                 ///< of the body, at its peer
  std::uint32_t sequence = 0;               ///< of the sample that it came in; 0: it came in none
  bool is_near = false;                     ///< that was of NearPoses
  std::uint32_t links = 1, first_link = 0;  ///< as in BodyDirectory
};

/// Where a body stays, by the body's name: a promise and the directory, brought together. Does not
/// travel.
struct BodyPromise {
  SessionId peer = 0;
  std::uint32_t number = 0;
  std::string body;
  double from_s = 0, until_s = 0;  ///< on the exercise's clock
  std::array<double, 3> place_m{};
  double slack_m = 0;  ///< its origin is so far from there at most at from_s
  double max_speed_mps = 0;
  std::uint32_t sequence = 0;  ///< of the sample that it came in

  /// At that time its origin is no farther from the place than this, metres, rounded up; nothing
  /// where the promise says nothing of it.
  [[nodiscard]] std::optional<double> radius_m(double time_s) const;
};
/// One of those in a message. Precondition: check() accepted it.
[[nodiscard]] BodyPromise promise_of(const BodyPromises& promises, const BodyPromises::Body& body,
                                     const BodyDirectory::Body& who);

/// Who moves a body, as far as another peer can tell.
enum class Mover : std::uint8_t {
  kNone = 0,    ///< no pose of the body has come
  kThere = 1,   ///< or the body is in place
  kLeft = 2,    ///< it ended, or its participant was lost
  kSilent = 3,  ///< nothing comes from its participant any more
  kBarred = 4,  ///< its identity was revoked or has expired
};

/// When a pose holds.
struct PoseStamp {
  Mover mover = Mover::kNone;
  double time_s = 0;     ///< on the exercise's clock, as the frame's
  double max_age_s = 0;  ///< so far from the frame's time at most; may be infinite
};
/// Negative for a pose of the frame's future; infinite where none has come.
[[nodiscard]] double age_s(const PoseStamp& pose, double frame_time_s);
/// Why nothing can be certified that rests on the body's pose, in a frame of that time; empty where
/// it can. A pose of the future is held to the same limit as one of the past.
[[nodiscard]] std::string why_stale(const PoseStamp& pose, double frame_time_s,
                                    const std::string& body);

/// An answer about a pair of bodies, for whoever listens (keyed by peer and pair). With the batches
/// that the peer was sent it is enough to ask the same again.
struct ContactReport {
  /// One of the two bodies as it was when it was asked about.
  struct Asked {
    ContentHash content_hash;
    std::uint64_t state_digest = 0;  ///< of the model's active vertices
    /// So many of the model, in order of arrival, had been taken in.
    std::uint32_t applied_batches = 0;
    /// What is held of the model was given up, all or in part, when the peer did so for the so
    /// manieth time, of whatever model; 0: never. What it held then a HeldDetail says, and batches
    /// of before do not tell.
    std::uint32_t era = 0;
    bool solid = false;
    Pose pose;
    PoseStamp stamp;  ///< also when nothing was asked
  };
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::string body_a, body_b;
  std::uint64_t frame = 0;
  double time_s = 0;             ///< of the frame, on the exercise's clock
  std::uint8_t status = 0;       ///< AnswerStatus, 0 to 4
  double clearance_m = 0;        ///< lower bound, when free or contained
  double uncertainty_m = 0;      ///< when uncertain
  std::uint32_t pair_count = 0;  ///< all exact pairs
  /// False: a header or a pose was missing, or a pose was stale, or the pair was put off, so
  /// nothing was asked.
  bool asked = false;
  /// It could have been asked; its turn did not come within the frame's budget. Said once, until it
  /// is asked.
  bool put_off = false;
  /// The host's options ended the answer (any, max_pairs, max_tests): what it lists may not be all.
  bool cut = false;
  std::uint64_t answer_digest = 0;  ///< digest(Answer)
  Asked a, b;                       ///< when asked; of a world its content and pose
  /// Where one of the bodies is a world that was asked: with its pages it tells which tiles the
  /// answer rests on.
  struct World {
    bool is_a = false;  ///< which of the two is
    /// Tiles were looked for within so many cells of the other body's grid around its box.
    std::uint32_t reach_cells = 0;
    struct Tile {
      /// Its trees were; else nothing was known of it, or its turn did not come.
      bool asked = false;
      std::uint64_t state_digest = 0;  ///< these three as in Asked
      std::uint32_t applied_batches = 0, era = 0;
      bool operator==(const Tile&) const = default;
    };
    std::vector<Tile> tiles;  ///< found there, in order of place; at most kMaxReportTiles
    /// That were not here, ascending; at most kMaxReportPages.
    std::vector<ContentHash> missing_pages;
    bool operator==(const World&) const = default;
  };
  /// None, too, where there are more tiles or pages: then nothing can be proved.
  std::optional<World> world;
  std::vector<std::array<FaceKey, 2>> pairs;  ///< the first kMaxReportPairs of them
};

inline constexpr std::size_t kMaxReportTiles = 128, kMaxReportPages = 64;

/// Which bodies a peer that watches all pairs knows of, for recorders (keyed by peer and part,
/// transient local): the pairs of these are what its BoundsReports are about. Of a body known by
/// its poses, the mover's directory says the name.
struct WatchedBodies {
  /// What the peer knows a body's place by.
  enum class Known : std::uint8_t {
    kByPose = 0,   ///< the last one that came
    kPromised = 1  ///< promises are made of it: a promise, or a pose of NearPoses
  };
  /// Bodies whose numbers follow each other, alike in all else.
  struct Run {
    Known known = Known::kByPose;
    SessionId mover = 0;  ///< the peer itself: own bodies
    std::uint32_t first = 0, count = 1;
    ContentHash content;  ///< of the model, that the peer holds
    std::uint32_t group = 1, mask = 0xffffffffU;
    /// May be infinite; a pose that is further from the frame's time is none.
    double max_age_s = 0;
    bool operator==(const Run&) const = default;
  };
  /// A body that the host has put in its place.
  struct Placed {
    std::string name;  ///< 1 to kMaxNameBytes
    ContentHash content;
    std::uint32_t group = 1, mask = 0xffffffffU;
    bool own = false;
    Pose pose;
  };
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  std::uint32_t part = 0;
  std::uint32_t edition = 0;  ///< counts up with each change of any part, from 1
  double horizon_s = 0;       ///< the boxes hold what the bodies may do for so long
  double margin_m = 0;        ///< and so much more on each side
  bool only_own = false;      ///< of all pairs those alone of which one is the peer's own
  std::vector<Run> runs;      ///< no body twice
  std::vector<Placed> placed;
};
/// Bodies told of in one part, at most.
inline constexpr std::uint32_t kWatchedPerPart = 64;

/// What bounds prove free in one frame, for recorders (keyed by peer): of how many pairs of its
/// watched bodies (core/THEOREM.md, "Free by bounds"), those that are answered one by one as well
/// among them. With the poses on the bus the same comes out again.
struct BoundsReport {
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  /// Of the watched bodies: each part's last with no greater one counts.
  std::uint32_t edition = 0;
  std::uint64_t frame = 0;
  double time_s = 0;  ///< of the frame, on the exercise's clock
  /// Sum of BodyPlace::digest (core/broadphase) of all that had a box.
  std::uint64_t places_digest = 0;
  std::uint32_t pairs = 0;  ///< from 1; more than 2^32 - 1 are said as that
  float clearance_m = 0;    ///< of each of them at least; rounded down, as horizon_s is
  float horizon_s = 0;      ///< until this much after the frame's time none of them can touch
  /// A body had a box by what is not on the bus, as poses are that the host heard elsewhere: nobody
  /// can prove the report.
  bool rests_on_more = false;
  /// How far one mover of watched bodies had been heard: what each body is known by.
  struct Heard {
    /// The sequence of its last BodyPoses that counted. Each body that is known by poses is where
    /// the last sample of its part up to then has it.
    std::uint32_t poses = 0;
    /// The same of BodyPromises: of the last two of a body up to then, the later one that holds at
    /// the frame's time.
    std::uint32_t promises = 0;
    /// Of the peer itself, whose promised bodies are known by their poses: that of its last
    /// NearPoses. Else 0.
    std::uint32_t near = 0;
    /// Bodies of another that were known by a full pose which `poses` does not name: promised ones,
    /// and where samples were lost that may have held a later one.
    struct Posed {
      std::uint32_t number = 0,
                    sequence = 0;  ///< of the sample that it came in; NearPoses if it is promised
      bool operator==(const Posed&) const = default;
    };
    std::vector<Posed> posed;  ///< by number
    bool operator==(const Heard&) const = default;
  };
  std::vector<Heard> heard;  ///< of each mover of a watched body, in the order of their sessions
};
inline constexpr std::size_t kMaxWatchedMovers = 4096, kMaxWatchedPosed = 4096;

/// What a peer holds of one model, or of a world's tile, for recorders (keyed by peer and content):
/// said when a recorder comes, so that one that missed batches can prove what follows; and when
/// detail was given up. With the model's file it is enough to make the same replica; with what was
/// held before, where that was given up.
struct HeldDetail {
  /// The number of the last batch that had come of a publisher.
  struct Heard {
    SessionId publisher = 0;
    std::uint32_t sequence = 0;
  };
  std::uint16_t wire_version = kWireVersion;
  SessionId peer = 0;
  ContentHash content_hash;
  std::string model;      ///< its name, at most kMaxNameBytes; of a tile that of its world
  std::uint32_t era = 0;  ///< as in ContactReport::Asked
  std::uint32_t applied_batches = 0;  ///< of the model: all that had come by then
  std::uint32_t last_request = 0;     ///< of the peer: what answers a later one came after this
  std::uint64_t state_digest = 0, box_digest = 0;  ///< of what `nodes` says
  /// Of the publishers that it asked last, at most kMaxHeardPublishers; sequence 0: nothing came.
  std::vector<Heard> heard;
  std::vector<std::uint8_t> nodes;  ///< core/replica/held_nodes.hpp, at most kMaxHeldBytes
};
inline constexpr std::size_t kMaxHeardPublishers = 64;
inline constexpr std::size_t kMaxHeldBytes = 1U << 20;

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
  kIdentity,     ///< of an identity that was revoked or has expired
};
inline constexpr std::size_t kDoorRefusals = 9;
/// "header", "submessages", "statistics", "sequence", "fragments", "parameters", "source", "crowd",
/// "identity".
[[nodiscard]] const char* to_string(DoorRefusal refusal);

/// What one process knows of itself (keyed by session, transient local, renewed each second): for
/// operators, who cannot see it from outside.
struct ProcessStatus {
  std::uint16_t wire_version = kWireVersion;
  SessionId session = 0;
  bool is_publisher = false;
  std::string name;  ///< of the process, for people: 1 to kMaxNameBytes of printable ASCII
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
  std::uint32_t moved_bodies = 0;  ///< by a peer
  std::uint32_t heard_bodies = 0;  ///< that a peer looks at and others move
  /// Of those: with a pose on which nothing certified can rest, or none.
  std::uint32_t stale_bodies = 0;
  std::string oldest_body;  ///< of those: whose pose is oldest; "" where there is none
  double oldest_age_s = 0;  ///< that pose's, on the exercise's clock; infinite where none has come
  std::vector<std::string> moved;  ///< the first kMaxStatusBodies bodies of those it moves
  bool has_door = false;           ///< before Fast DDS, on the participant of this session
  std::array<std::uint64_t, kDoorRefusals> door_refused{};  ///< messages, by DoorRefusal
  struct Model {
    std::string name;
    ContentHash content_hash;
    std::uint64_t faces = 0, held_splits = 0, splits = 0;  ///< 0 until the header has come
  };
  std::vector<Model> models;            ///< served, or used
  std::vector<std::string> complaints;  ///< the newest kMaxStatusLines of the last minute
};
inline constexpr std::size_t kMaxStatusBodies = 16;
inline constexpr std::size_t kMaxStatusLines = 16;
inline constexpr std::size_t kMaxStatusLineBytes = 255;

/// One line as it may stand in a ProcessStatus: cut, with other bytes than printable ASCII
/// replaced.
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

/// Whether a body or a model may be called so. Names go to logs, file names and JSON: 1 to
/// kMaxNameBytes of printable ASCII without blanks at the ends, so that nothing can be hidden in
/// them. Errors: kInvalidArgument beginning with `field`.
[[nodiscard]] Status check_name(std::string_view name, const char* field);
/// Whether who serves `served` models may serve another under this name. Errors: kInvalidArgument
/// naming the limit.
[[nodiscard]] Status check_new_model(const std::string& name, std::size_t served);

/// What is told of a model that is served, in place of another content or of none: adds it to the
/// hello. Out: its header.
[[nodiscard]] MeshHeader announce_model(const std::string& name, const ModelFile& file,
                                        ContentHash replaces, const Epoch& epoch, Hello& hello);
/// The same of a world: its record takes a header's place. In: bytes that have that digest.
[[nodiscard]] MeshHeader announce_world(const std::string& name, const ContentHash& content,
                                        std::vector<std::uint8_t> record, ContentHash replaces,
                                        const Epoch& epoch, Hello& hello);

/// The batches of an answer, or of a part of one, as messages to the peer that asked; their
/// sequence is the channel's to count. `last`: the request is answered in full with these. That
/// nothing was needed is an answer too: one message without bytes. `are_pieces`: instead of batches
/// (SplitBatchMessage::is_piece).
[[nodiscard]] std::vector<SplitBatchMessage> answer_messages(
    SessionId publisher, std::uint32_t request, const ContentHash& content,
    std::vector<std::vector<std::uint8_t>> batches, bool last, bool are_pieces = false);
/// The same of a request that is refused, with as much of the reason as a batch holds.
[[nodiscard]] SplitBatchMessage refusal_message(SessionId publisher,
                                                const RegionSubscription& request,
                                                const std::string& why);
/// The same where the peer is to ask otherwise about one content of the request (none: about all):
/// for regions, or else to say what it holds of it.
[[nodiscard]] SplitBatchMessage redirection_message(SessionId publisher,
                                                    const RegionSubscription& request,
                                                    const std::string& why,
                                                    const ContentHash& content, bool wants_regions);
/// Puts `next` into the sample of `message` where both are batches of the same answer, and there is
/// room. Out: whether it was done.
[[nodiscard]] bool join(SplitBatchMessage& message, SplitBatchMessage& next);
/// Each batch of the sample as a message of its own.
[[nodiscard]] std::vector<SplitBatchMessage> take_apart(SplitBatchMessage&& message);
/// What a sample carries beside its fixed fields (kBatchFramingBytes), all that is joined included.
[[nodiscard]] std::size_t sample_bytes(const SplitBatchMessage& message);
/// That of the last batch.
[[nodiscard]] inline std::uint32_t last_sequence(const SplitBatchMessage& message) {
  return message.sequence + static_cast<std::uint32_t>(message.joined.size());
}

/// Whether a message may go out, or be believed as far as its own fields tell. Errors: kUnsupported
/// for another wire version, kInvalidArgument naming the field, what was expected and what was
/// found. Cost: linear in the message.
[[nodiscard]] Status check(const Hello& message);
[[nodiscard]] Status check(const MeshHeader& message);
[[nodiscard]] Status check(const RegionSubscription& message);
[[nodiscard]] Status check(const SplitBatchMessage& message);
[[nodiscard]] Status check(const BodyPoses& message);
[[nodiscard]] Status check(const BodyPromises& message);
[[nodiscard]] Status check(const WantedPoses& message);
[[nodiscard]] Status check(const BodyDirectory& message);
[[nodiscard]] Status check(const BodyPose& pose);
[[nodiscard]] Status check(const ContactReport& message);
[[nodiscard]] Status check(const WatchedBodies& message);
[[nodiscard]] Status check(const BoundsReport& message);
[[nodiscard]] Status check(const HeldDetail& message);
[[nodiscard]] Status check(const ProcessStatus& message);
[[nodiscard]] Status check(const Echo& message);

}  // namespace nearmesh::wire
