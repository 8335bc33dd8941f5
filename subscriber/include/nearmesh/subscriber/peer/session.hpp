// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A peer: holds replicas of the models its bodies use, asks publishers for the detail that is about
// to be touched, and answers, every frame, whether pairs of bodies touch, with how far each answer
// can be trusted. Polled by the host: update() never blocks and never calls DDS (the channel's own
// thread does).

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "nearmesh/core/base/detail/ids.hpp"
#include "nearmesh/core/query/depth.hpp"
#include "nearmesh/core/query/probe.hpp"
#include "nearmesh/core/query/sweep.hpp"
#include "nearmesh/subscriber/peer/channel.hpp"
#include "nearmesh/subscriber/peer/readiness.hpp"
#include "nearmesh/subscriber/peer/world_answer.hpp"

namespace nearmesh::subscriber {

/// A body of one session: numbers from 0 in the order of add_body(), never used again, so that they
/// may index arrays of the host's. Made by default it stands for none.
using BodyId = Id<struct BodyTag>;

struct BodyOptions {
  /// On the bus and for people, unique in the session; 1 to 63 bytes of printable ASCII, no blanks
  /// at the ends.
  std::string name;
  std::string model;   ///< the publisher's name for it; the same
  bool own = false;    ///< this peer moves it and publishes its pose; else another peer does
  bool solid = false;  ///< it has an inside (core/query/query.hpp)
  /// Pins the model, for all bodies that use it: no other content is ever taken. None: what
  /// publishers agree on.
  ContentHash content;
  /// As SessionOptions::max_pose_age_s, for this body. None: that; for own bodies no limit.
  std::optional<double> max_pose_age_s;
  /// Of an own body: its origin never moves faster, m/s, up to wire::kMaxSpeed_mps (1e6). Then
  /// others are promised where it stays, and its full poses go to those peers alone that it may
  /// come near to (docs/worlds.md, "Promises"). 0: poses go to all, whenever it moves.
  double max_speed_mps = 0;
  /// Which pairs watch_all() and watch_own() watch: those of which the mask of each has a bit of
  /// the other's group.
  std::uint32_t group = 1, mask = 0xffffffffU;
};

/// Calls job(0) to job(count - 1), each once, in any order and on any threads, and returns when all
/// are done.
using RunJobs = std::function<void(std::size_t count, const std::function<void(std::size_t)>& job)>;

/// Ranges stand behind each number; check() holds a session to them.
struct SessionOptions {
  /// Answers are uncertain where the pose of a body that another moves is this far from the frame's
  /// time, seconds; 0 to infinite. Own bodies at rest are published again after a quarter of it, so
  /// let all peers have one value.
  double max_pose_age_s = 2;
  /// Detail is asked for where the other body may be within this time, as soon as some is missing
  /// in the first half of it. Seconds, 0 to 3600.
  double lookahead_s = 0.5;
  /// What is promised of an own body (BodyOptions::max_speed_mps) holds for so long, and is
  /// promised anew after half of it. Seconds on the exercise's clock, 0.1 to wire::kMaxPromise_s
  /// (255).
  double promise_s = 8;
  /// The look-ahead is widened by this on all sides, so that detail also comes where bodies pass
  /// this near. Metres, 0 to 1e9.
  double margin_m = 0;
  double sweep_s = 0;  ///< also answer for all of this time ahead; seconds, 1e-9 to 3600; 0: do not
  /// Batches that may be under way to this peer; 2000 or more. Twice as much overran the default
  /// socket buffer, and 12 % were sent again.
  std::uint32_t window_bytes = 64 * 1024;
  /// A request without an answer is repeated after this, of another publisher where there is one.
  /// Seconds, 1e-4 to 3600.
  double request_timeout_s = 0.5;
  /// Above this, detail far from every body is given up; 0: no limit. All detail of a model that
  /// nothing was near for 10 s of the exercise's time is given up in any case, unless there is a
  /// cache_folder.
  std::uint32_t max_held_splits = 0;
  /// So often, for each model, a block of the publisher's file is asked for with its proof, and
  /// what is held of it compared. Seconds, 0 or more; 0: never. Who lied is named and not asked
  /// again; so is who does not answer three times.
  double audit_s = 0;
  /// Draws which blocks; 0: the system does, so that no publisher can tell.
  std::uint64_t audit_seed = 0;
  /// How the bound of a free answer is sought; without one no safe_horizon_s is known either. With
  /// kBound a pair of bodies without insides is not asked again while both have moved by less than
  /// a quarter of it, and what is held of them is the same: it is as free as before, and its bounds
  /// follow from those of then.
  Clearance clearance = Clearance::kBound;
  /// A folder in which detail is kept from one session to the next, by content, at most 8 MiB each;
  /// none: it is not. Several processes may share one. Whoever can write there is believed as a
  /// publisher is. Read in the update that brings a model's header, written by write_cache() and at
  /// the session's end.
  std::string cache_folder;
  /// Work out where bodies touch, and follow each contact: PairAnswer::contacts,
  /// FrameReport::contact_events.
  bool contacts = false;
  /// Also work out how deep bodies are in each other: PairAnswer::depth. Implies `contacts`. What
  /// it lacks is asked for. Some 0.1 to 5 ms for a pair that touches.
  bool depth = false;
  /// Of each answer, as in QueryOptions (core/query/query.hpp). `max_tests` is some 10 to 50 ms, a
  /// hundred times what an ordinary contact takes: it bounds what one pair may cost, and is no
  /// matter to others.
  bool any = false;
  std::size_t max_pairs = kAllPairs;
  std::uint64_t max_tests = 2'000'000;
  /// Of each swept answer, as SweepOptions::max_tests: some 100 ns each.
  std::uint64_t max_sweep_tests = 50'000;
  /// Of each depth, as DepthOptions::max_tests: some 2 to 5 ns each, so 1 to 2 ms.
  std::uint64_t max_depth_tests = kDepthTests;
  /// Answers of pairs, and looks ahead for them, are jobs: the host's scheduler may run them at
  /// once. Answers and digests are the same whatever it does. None: one after the other, in
  /// update(). It is called in update(), at most twice a frame, and must not call the session; a
  /// job never throws, never waits and calls nothing of the host's. A job that it leaves out is run
  /// afterwards, one that it runs twice is run once. What it throws comes out of update() at the
  /// end: all is done then but the report, which is lost.
  RunJobs run_jobs;
  /// Send a ContactReport of each answer, and again when it changes within a frame. Without them no
  /// recording proves this peer's answers.
  bool publish_reports = true;
};
/// Whether all numbers are in their ranges: certified answers rest on some of them. Of a session
/// with others every update() fails.
/// Errors: kInvalidArgument naming the option, what it is and what is expected.
[[nodiscard]] Status check(const SessionOptions& options);

/// The latest certified answer about a pair, and what it still says. Its pairs are not kept.
struct LastCertified {
  AnswerStatus status = AnswerStatus::kFree;
  Containment contained = Containment::kNone;
  std::uint64_t pair_total = 0;
  double age_s = 0;  ///< the frame's time less that of the frame that it was given in
  /// Free or contained: the surfaces are at least so far apart at this frame's poses, wherever the
  /// bodies were meanwhile: what was certified, less how far both have gone from the poses that it
  /// was about. 0: nothing follows.
  double clearance_m = 0;
  /// Until this much after the frame's time nothing can touch, if the bodies keep within their
  /// speeds from their poses of this frame on, whatever they did before. 0 where nothing follows.
  /// Seconds.
  double safe_s = 0;
};

/// An answer about one pair that is watched by name, or may be near.
struct PairAnswer {
  BodyId a, b;  ///< as they were watched; else the lower first
  Answer answer;
  /// Why nothing can be said (status kUncertain): a header, a publisher or a pose that has not
  /// come; a pose that is too old, or whose mover is gone; or, for ever, a solid with an open
  /// model, or a model of too many parts near a solid; or that its turn did not come. Else empty.
  std::string reason;
  /// Not certified for want of detail: of which model, and whether any publisher is there that
  /// sends it; or since the search was ended by its tests. Else empty.
  std::string awaited;
  /// Headers and fresh poses were there, so the trees were asked, or need not be: it stayed free
  /// (SessionOptions::clearance), or both bodies lie where they lay, on the same detail.
  bool asked = false;
  /// Headers and fresh poses were there, but its turn did not come within the budget, or ended
  /// before it was answered: not asked, and nothing is known of this frame.
  bool put_off = false;
  /// Of a pair that is put off, if it ever was certified.
  std::optional<LastCertified> last_certified;
  /// The frame's time less that for which the body's pose was given: 0 for bodies in place and own
  /// bodies at rest, negative where the mover's clock is ahead, infinite where no pose has come.
  /// Seconds.
  double age_a_s = std::numeric_limits<double>::infinity();
  double age_b_s = std::numeric_limits<double>::infinity();
  Pose pose_a, pose_b;               ///< what was asked about; meaningless unless `asked`
  ContentHash content_a, content_b;  ///< of the models that it is about; none: not known yet
  /// Where one of the bodies is a world: of which tiles the pairs are, and what the answer misses
  /// of the world. `answer` and `swept` then miss nodes of the other body alone, nothing is said of
  /// depth, and contacts have no numbers.
  std::optional<WorldAnswer> world;
  /// With SessionOptions::contacts, when the answer has pairs: where they touch, all exact.
  std::optional<Contacts> contacts;
  /// Of each of its patches: a number that the contact keeps as long as it lasts, and that no other
  /// contact of the session has.
  std::vector<std::uint64_t> contact_ids;
  /// With SessionOptions::depth, when the answer has pairs: how far B must be moved, and which way,
  /// to be free (core/query/depth.hpp).
  std::optional<Depth> depth;
  /// Free or contained: until this much after the frame's time nothing can touch, if the bodies
  /// keep within their speeds from their poses on. Seconds.
  double safe_horizon_s = 0;
  /// With SessionOptions::sweep_s, where the poses are known: the answer for the time from the
  /// frame's on, if both bodies keep their velocities from their poses on. What it misses is asked
  /// for as the look-ahead's detail is.
  std::optional<SweptAnswer> swept;
};

/// What an update says of a contact: a patch (core/query/contacts.hpp) that is followed from update
/// to update.
enum class ContactChange : std::uint8_t {
  kBegin,    ///< it is new
  kPersist,  ///< it is still there
  kEnd,      ///< certified: it is over. Or the model of a body was replaced
  /// It was not found, but the answer is not certified: what is missing may hold it. It goes on as
  /// soon as it is found, and is told so in each update until then.
  kUnconfirmed,
};
/// "begin", "persist", "end", "unconfirmed".
[[nodiscard]] const char* to_string(ContactChange change);
struct ContactEvent {
  ContactChange change = ContactChange::kBegin;
  std::uint64_t id = 0;  ///< as PairAnswer::contact_ids
  BodyId a, b;           ///< as in the pair's answers
  /// Begin, persist: its place among Contacts::patches of the pair's answer.
  std::uint32_t patch = 0;
};

/// What watch_all() and watch_own() say at once of all pairs that are not listed: boxes around the
/// bodies prove them apart. A certified answer (core/THEOREM.md, "Free by bounds").
struct FreeByBounds {
  std::uint64_t pairs = 0;
  double clearance_m = 0;  ///< of each of them at least, at the frame's poses
  /// Until this much after the frame's time none of them can touch, if the bodies keep within their
  /// speeds. Seconds.
  double horizon_s = 0;
  /// Of all bodies that it is about, with poses, motions and contents, and of these numbers. Of
  /// equal worlds it is equal on all peers, whatever came before and in whichever order bodies were
  /// added.
  std::uint64_t digest = 0;
};

/// A body of which nothing can be said, because its header or a fresh pose has not come. None of
/// its pairs is certified.
struct UnknownBody {
  BodyId body;
  std::string reason;
};

/// What one update did. Seconds are wall clock of this call.
struct FrameReport {
  /// Of pairs that are watched by name, and with watch_all() of those that may be near; by the
  /// lower BodyId, then the higher.
  std::vector<PairAnswer> answers;
  /// With SessionOptions::contacts: one event for each contact that there is or was until now, by
  /// pair, then patch; first those of pairs that are not listed any more. Of a pair that is watched
  /// no more, or whose body is removed, no more is told.
  std::vector<ContactEvent> contact_events;
  std::vector<BodyId> came, went;    ///< with discover_bodies()
  FreeByBounds free_by_bounds;       ///< with watch_all() or watch_own()
  std::vector<UnknownBody> unknown;  ///< with watch_all() or watch_own()
  /// Bodies of which no full pose is here, and a promise holds: in the bounds of those two.
  std::uint64_t promised = 0;
  /// That are not listed because one of the two is unknown: uncertain.
  std::uint64_t unknown_pairs = 0;
  double load_s = 0;                    ///< T_L: decoding batches
  double refine_s = 0;                  ///< T_R: vertex splits and collapses
  double tree_s = 0;                    ///< T_B: AB-tree
  double broad_s = 0;                   ///< which pairs may be near
  double query_s = 0;                   ///< T_Q, sweeps and contacts included, the sum over pairs
  std::uint64_t batches_waiting = 0;    ///< left over for want of budget
  std::uint64_t pairs_put_off = 0;      ///< answers that are, for want of budget
  std::vector<std::string> complaints;  ///< one line each, for a log
  /// Digest of the state of refinement that the answers were given in: of all models' active
  /// vertices, in the order of the models' names.
  std::uint64_t state_digest = 0;
  /// Digest of all answers, in order, but their statistics. Peers that were sent the same batches,
  /// in any order, and ask about the same poses have the same two digests.
  std::uint64_t answers_digest = 0;

  /// Of all pairs, listed or not.
  [[nodiscard]] bool all_certified() const;
  /// The answer about two bodies, in either order; null where it is not listed: then they are free
  /// by bounds, or one is unknown, or nobody watches them.
  [[nodiscard]] const PairAnswer* find(BodyId a, BodyId b) const;
};

/// Counts since a session began; what it holds are those of now.
struct SessionStats {
  std::uint64_t batches = 0, batch_bytes = 0;  ///< payload of split batches
  std::uint64_t header_bytes = 0;
  std::uint64_t requests = 0;
  /// How often the way of a body against another was followed, to see what detail they may meet.
  std::uint64_t looks_ahead = 0;
  std::uint64_t sequence_gaps = 0;  ///< batches that never came
  std::uint64_t audits = 0,
                audit_bytes = 0;      ///< blocks that were proved and compared; answers to audits
  std::uint64_t refused_headers = 0;  ///< that came from whoever serves no such content
  /// Samples of poses, promises and directories that a stranger sent in a peer's name.
  std::uint64_t refused_poses = 0;
  /// Poses and promises of others for times that heard_time_s() leaves out.
  std::uint64_t strange_times = 0;
  std::uint64_t held_splits = 0, slots = 0, exact_faces = 0, tree_bytes = 0;
  std::uint64_t mesh_bytes = 0;  ///< what whole replicas of the models in use would take
};

/// What probes of a body were answered from.
struct ProbeReport {
  /// Why nothing can be said, as PairAnswer::reason, so that every answer is uncertain; else empty.
  std::string reason;
  /// Some are uncertain for want of detail: of which model, and whether any publisher is there that
  /// sends it. Else empty.
  std::string awaited;
  double age_s = std::numeric_limits<double>::infinity();  ///< of the pose, as PairAnswer::age_a_s
  Pose pose;                  ///< where the body was taken to be; meaningless with a reason
  ContentHash content;        ///< of its model; none: not known yet
  std::uint64_t missing = 0;  ///< nodes that are missing, of all answers together
};

/// A peer. Make a channel and a session, add bodies, watch pairs, then call update() once a frame
/// (docs/embed.md). A call that gives an error has changed nothing, but write_cache(). One that an
/// exception leaves (std::bad_alloc, or what a channel of the host's throws) has changed nothing
/// either, or the session is half-way: then each call that gives a status gives kConflict, so that
/// nothing is certified any more, held_state() is 0, no cache is written, and the session is to be
/// ended.
/// Threads: one at a time, for all functions. None calls DDS or waits for the network;
/// write_cache() and the destructor write files.
class Session {
 public:
  /// Options out of their ranges are refused by each update(): check(options) says so before.
  explicit Session(std::unique_ptr<Channel> channel, SessionOptions options = {});
  /// Writes the cache, if there is one, and ends the channel: with DDS the peer leaves the bus,
  /// within a second.
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Declares a body; at any time: what spawns is uncertain, never free, until it is known. Headers
  /// of models that no body uses are kept for that, up to 256 and 16 MiB. Where the model of a
  /// solid body turns out to be open, no answer about it is ever certified, and each names the
  /// reason. Errors: kConflict (name taken, or the pin contradicts another), kInvalidArgument
  /// (name, max_pose_age_s).
  [[nodiscard]] Result<BodyId> add_body(BodyOptions options);
  /// Fixes a body in place, for scenery that nobody moves. Errors: kNotFound, kInvalidArgument
  /// (pose; a body with a max_speed_mps, a link).
  [[nodiscard]] Status place_body(BodyId body, const Pose& pose);
  /// Makes own bodies the links of one robot: their poses count together. Whoever hears them takes
  /// all of one instant or none, however many samples they come in and whichever are lost; up to
  /// seven come in one. Each update() then gives motions of all links, or of none. Before any of
  /// them has a motion. Errors: kNotFound, kConflict (a link of another robot, one that has a
  /// motion), kInvalidArgument (fewer than 2 or more than wire::kMaxLinks (256), a body that others
  /// move or that has a max_speed_mps).
  [[nodiscard]] Status link_bodies(const std::vector<BodyId>& links);
  /// The body is there no more, nor are its pairs; its name is free again. Detail of a model that
  /// no body uses is given up. A link takes all links of its robot with it. Errors: kNotFound.
  [[nodiscard]] Status remove_body(BodyId body);
  /// Where an own body is cannot be said, as of one that jumped out of where others were promised
  /// it stays: to them its name is another body's from now on, and nothing about it is certified,
  /// here or there, until update() is given its motion. Errors: kNotFound, kInvalidArgument (a body
  /// that others move, a link).
  [[nodiscard]] Status forget_pose(BodyId body);
  /// Whether update() would take the motion of an own body at that time, for all that others were
  /// promised of where it stays. Errors: kNotFound; kInvalidArgument as update().
  [[nodiscard]] Status check_promised(BodyId body, const Motion& motion, double time_s) const;
  /// From now on the body has another model; where it is stays. `content` as in BodyOptions.
  /// Errors: those of add_body, kNotFound.
  [[nodiscard]] Status replace_model(BodyId body, const std::string& model,
                                     const ContentHash& content = {});

  /// Watches all pairs of bodies, now and later, but those of which both are in place, and those
  /// that groups and masks leave out. Pairs that bounds prove apart are told of together:
  /// FrameReport::free_by_bounds.
  void watch_all();
  /// As watch_all(), but of the pairs of own bodies alone: with each other, and with all that
  /// others move. What many peers each ask of their own bodies is together all that one would ask.
  void watch_own();
  /// Declares each body that another peer moves and that is not declared here, with the name,
  /// model, pin, group and mask that its mover tells, and whether it is solid: FrameReport::came.
  /// One that its mover removes is removed here: FrameReport::went. Of one whose mover has left
  /// nothing is known: it stays, and none of its pairs is certified.
  void discover_bodies();
  /// Lists the answer about two bodies in every update, near or not, whatever their groups. (a, b)
  /// and (b, a) are one pair.
  /// Errors: kNotFound, kInvalidArgument (the same body).
  [[nodiscard]] Status watch(BodyId a, BodyId b);
  /// Takes watch() back; watch_all() stays. Errors: kNotFound.
  [[nodiscard]] Status unwatch(BodyId a, BodyId b);
  /// For people; empty where no such body is declared.
  [[nodiscard]] std::string name_of(BodyId body) const;
  /// As it was declared, here or by its mover. Errors: kNotFound.
  [[nodiscard]] Result<BodyOptions> options_of(BodyId body) const;

  struct OwnMotion {
    BodyId body;
    Motion motion;
  };
  /// One frame: publishes the own bodies' motions, takes in what arrived, answers the watched
  /// pairs, and asks for what is missing. May be called again for the same frame.
  /// `budget_s`: all of it ends by then, by the wall clock, except for what is done in any case:
  /// one batch, one pair that is expected to take longer, one look ahead, and what takes
  /// microseconds a body and pair, such as pairs that stayed free. Pairs take turns, who may touch
  /// soonest first; one whose turn did not come is put_off, and so is one whose question is cut
  /// short since the time is over: that one is asked to its end as soon as it comes first. None
  /// waits for more than some updates and the others. A budget decides which pairs are asked, never
  /// what an answer says. Infinite: no end.
  /// In: `time_s` is the frame's time on the clock that the whole exercise has, seconds, at most
  /// wire::kMaxTime_s (1e11) from 0: poses of this peer go out with it, those of others are as old
  /// as it says. Where it is before the last one, a complaint says so. A body that is farther than
  /// its max_speed_mps allows from where others were promised it stays is refused: a jump is a body
  /// that is removed, and another, or one whose pose was forgotten until the promises have ended.
  /// So are motions of some links of a robot, without the others'.
  /// Errors: kNotFound or kInvalidArgument naming the body, kInvalidArgument for such a time, a
  /// budget below 0, and the options that check() refuses; nothing was changed then. kConflict
  /// where the session is half-way, see above.
  /// Threads: one at a time. Never blocks.
  [[nodiscard]] Result<FrameReport> update(std::uint64_t frame, double time_s,
                                           const std::vector<OwnMotion>& motions, double budget_s);

  /// Where another peer's body is, as the host heard on a topic of its own.
  struct HeardPose {
    BodyId body;
    double time_s = 0;  ///< for which the motion's pose holds, on the exercise's clock
    Motion motion;
  };
  /// Poses of bodies that others move: the next update() takes them in after those of the bus, and
  /// they age alike. They are not sent again. Of one body the last counts. Errors: kNotFound,
  /// kInvalidArgument (an own body, a motion, a time), naming the body; nothing is taken then.
  [[nodiscard]] Status hear(std::span<const HeardPose> heard);

  /// How far a body is, as of the last update. A pair that was watched, or a body that was placed,
  /// since then is not certified. Cost: O(watched pairs). Errors: kNotFound.
  [[nodiscard]] Result<Readiness> readiness(BodyId body) const;
  /// How far the part of a body's model within a box is: metres, the body's model frame.
  /// Errors: kNotFound; kInvalidArgument where the box is empty or not finite.
  [[nodiscard]] Result<RegionReadiness> region_readiness(BodyId body,
                                                         const std::array<double, 3>& lo_m,
                                                         const std::array<double, 3>& hi_m) const;
  /// Probes of one body where it was as of the last update, from what is held of its model
  /// (core/query/probe.hpp): rays, points, balls, boxes, in the world. What certified answers lack
  /// is asked for in the next updates: probe, update, probe again. Of the calls since an update all
  /// is asked for that has room in a request; what was probed in the last second is not given up
  /// (max_held_splits). A body of which nothing is known gives uncertain answers and a reason.
  /// Probes are neither published nor reported. Of a body that is a world what is missing may be
  /// pages and tiles, too; a face has its name in its tile's model. Points in it have no answer.
  /// In: as many answers as probes. Errors: kNotFound; kInvalidArgument naming the probe, or for
  /// points in a body whose model is open.
  /// Cost: probe()'s; nothing is allocated for certified answers but for a batch.
  [[nodiscard]] Result<ProbeReport> probe(BodyId body, std::span<const RayProbe> rays,
                                          std::span<RayAnswer> answers);
  [[nodiscard]] Result<ProbeReport> probe(BodyId body,
                                          std::span<const std::array<double, 3>> points_m,
                                          std::span<PointAnswer> answers);
  [[nodiscard]] Result<ProbeReport> probe(BodyId body, std::span<const BallProbe> balls,
                                          std::span<ShapeAnswer> answers);
  [[nodiscard]] Result<ProbeReport> probe(BodyId body, std::span<const BoxProbe> boxes,
                                          std::span<ShapeAnswer> answers);

  /// What is held of a body's model, to be drawn: the current mesh, three corners a face, metres,
  /// the body's model frame.
  struct HeldMesh {
    std::vector<std::array<double, 3>> exact_m;   ///< faces of the full mesh
    std::vector<std::array<double, 3>> coarse_m;  ///< faces that stand for what is missing
  };
  /// Errors: kNotFound, also while its header has not come. Cost: O(its faces), some 100 ns each.
  [[nodiscard]] Result<HeldMesh> held_mesh(BodyId body) const;
  /// The same number while held_mesh() is the same; 0 where that is not found. Cost: O(1).
  [[nodiscard]] std::uint64_t held_state(BodyId body) const;

  /// Brings the files of SessionOptions::cache_folder up to date. Errors: kIo; kConflict where a
  /// file of another kind stands in a place; the other files are written all the same.
  [[nodiscard]] Status write_cache();
  /// Counts since the session began, and what it holds now.
  [[nodiscard]] SessionStats stats() const;
  /// Where a body was last known to be, and how it moves; none where no pose has come, or no such
  /// body is declared.
  [[nodiscard]] std::optional<Motion> motion_of(BodyId body) const;
  /// The latest time that a pose of another peer had, whatever its body: for who has no clock of
  /// the exercise and follows that of the others. Within wire::kMaxFollowed_s (1e10) of 0: later
  /// ones are counted and complained of, and may be anybody's mistake.
  [[nodiscard]] std::optional<double> heard_time_s() const;
  /// As of the last full second of update(), which also sends it to whoever asks on the bus.
  [[nodiscard]] const wire::ProcessStatus& status() const;
  /// The mesh header of a body's model: how large it is, whether it is closed, where it came from.
  /// Null until it is here. Valid until the next call that is not const.
  [[nodiscard]] const SpmHeader* header_of(BodyId body) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber
