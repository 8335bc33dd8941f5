// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the files of Session share: session.cpp (a frame), session_bodies.cpp (bodies and pairs that
// come and go, and which are near), session_take.cpp (what comes), session_turns.cpp (whom it
// asks), session_ask.cpp, session_certificates.cpp and session_audit.cpp (what is asked of
// publishers), session_probe.cpp (probes of bodies), session_contacts.cpp (contacts from update to
// update), session_links.cpp (robots of several bodies), session_worlds.cpp (bodies that are
// worlds), session_tell.cpp (what is told), session_bounds.cpp (what is told of pairs that bounds
// prove apart), session_promises.cpp (where bodies stay, and whose full poses are wanted),
// session_mesh.cpp (meshes to be drawn).
// Threads: one.

#include <algorithm>
#include <exception>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <unordered_map>

#include "contact_book.hpp"
#include "core/ask/predict.hpp"
#include "core/base/random.hpp"
#include "core/base/stopwatch.hpp"
#include "core/broadphase/body_place.hpp"
#include "core/broadphase/broad_phase.hpp"
#include "core/broadphase/free_pairs.hpp"
#include "core/query/answer.hpp"
#include "core/query/clearance_left.hpp"
#include "core/world/content_bytes.hpp"
#include "core/world/held_probe.hpp"
#include "core/world/tile_sum.hpp"
#include "frame_budget.hpp"
#include "idl/messages/asked_publishers.hpp"
#include "idl/messages/process_name.hpp"
#include "idl/messages/status_keeper.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "replicas.hpp"

namespace nearmesh::subscriber {

struct Body {
  BodyId id;
  std::string name;
  PeerModel* model = nullptr;
  bool own = false;
  bool is_discovered = false;
  std::uint32_t number = 0;                  // on the bus, at its mover
  std::uint32_t links = 1, first_link = 0;   // own: as others are told
  std::optional<std::uint32_t> heard_robot;  // another's: the first link of the robot that it is of
  wire::SessionId posed_by = 0;              // whose word its pose is; 0: nobody's on the bus
  wire::SessionId mover = 0;        // of the pose; 0: none, or no number on the bus says all of it
  std::uint32_t pose_sequence = 0;  // of the sample that its pose came in; 0: of none that counts
  bool is_near_pose = false;        // that was one of near poses
  bool solid = false;
  std::optional<Motion> motion;
  wire::PoseStamp stamp;           // of the motion's pose
  bool is_placed = false;          // its pose holds at any time
  double published_s = 0;          // own: the time that the others know its pose for
  bool has_gone_back = false;      // its mover's time, as was said
  bool contested = false;          // another peer moves it too, as was said
  std::uint64_t looked_at_in = 0;  // the update that the next two are of; 0: none
  bool is_ready = false;           // why_not_ready() says nothing
  BodyReach reach;

  // Promises that were heard of one that another moves: the latest first, and the one before it,
  // which holds for frames of before the latest.
  std::array<std::optional<wire::BodyPromise>, 2> promises;
  std::vector<wire::BodyPromise> made;  // of an own body, in that order: others may rest on each
  double max_speed_mps = 0;             // own: promised
  wire::Mover promiser = wire::Mover::kNone;  // of another's: who made them
  double wanted_s = -std::numeric_limits<
      double>::infinity();     // the update's time when its full poses were wanted last
  double wanted_since_s = 0;   // without a pause: poses of before do not count
  std::optional<Ball> soon;    // who meets it may be near it before poses of it come
  bool is_by_promise = false;  // in this update: its place follows from a promise

  // For watch_all() and watch_own(): what was told to the broad phase.
  Company company;
  std::optional<BroadPhase::Slot> slot;
  ContentHash bounded;           // the content whose bounds were told
  bool is_new_to_bounds = true;  // motion or model changed since
  BodyPlace place;               // that is near or not; what the broad phase has may be larger
  // What others know of how its place is known (session_bounds.cpp).
  struct Told {
    enum class Known : std::uint8_t { kNot, kByPose, kPromised, kInPlace } known = Known::kNot;
    wire::SessionId mover = 0;
    std::uint32_t number = 0;
    ContentHash content;
    bool operator==(const Told&) const = default;
  } told;

  // Of a tile in its place, which stands for a part of a body that is a world.
  std::optional<Grid> tile_grid;
  double needed_s = 0;  // the update's time when it was near something last

  // Preconditions of both: the model is ready.
  [[nodiscard]] const Grid& grid() const {
    return tile_grid ? *tile_grid : model->replica->header().grid;
  }
  [[nodiscard]] TreeView view() const {
    TreeView view = model->replica->view();
    if (tile_grid) view.grid = &*tile_grid;
    return view;
  }
};

// A request that was sent and not yet answered in full.
inline constexpr std::uint8_t kNeededNow = 0, kHorizon = 1;  // priorities of requests

struct Outstanding : AskedRequest {
  std::uint8_t priority = 0;
  double heard_s = 0;             // when it was sent, or its last batch came
  double patience_s = 0;          // silence after which it counts as lost
  bool is_certificate = false;    // bodies were told, no region
  bool has_told_held = false;     // and what is held of all models
  bool is_counted = false;        // as lost
  std::uint32_t lost_before = 0;  // of the same content in a row, whoever was asked
};

struct Publisher {
  wire::Hello hello;
  std::uint32_t received_sequence = 0;
  // In a row: it may be dead, which DDS tells only when its lease is over.
  std::uint32_t lost_requests = 0;
  std::set<ContentHash> by_region;  // for bodies of these it does not choose
  std::set<ContentHash> announced;  // by the hello: looked at for each pair
  std::set<ContentHash> parts;  // pages and tiles of worlds that it serves, as far as they are used

  [[nodiscard]] bool serves(const ContentHash& content) const {
    return announces(content) || parts.contains(content);
  }
  [[nodiscard]] bool announces(const ContentHash& content) const {
    return announced.contains(content);
  }
};

[[nodiscard]] inline std::string called_of(const Publisher& publisher) {
  return wire::called(publisher.hello.publisher, publisher.hello.name);
}

/// Whether a promise is of the body that this mover has under this number. Bodies of one name may
/// follow each other: of another mover, or of the same, which uses no number twice. Where one stays
/// or is says nothing of the next.
[[nodiscard]] inline bool is_promise_of(const wire::BodyPromise& promise, wire::SessionId mover,
                                        std::uint32_t number) {
  return promise.peer == mover && promise.number == number;
}

/// Of the numbers of a mover's samples, of which 10,000 bodies take 2^32 in a day: what follows the
/// highest is 1 again, for 0 is no number. Of two that are less than 2^31 apart it is known which
/// was said later; 0 was said before all.
[[nodiscard]] inline bool is_after(std::uint32_t sequence, std::uint32_t other) {
  return sequence != 0 && (other == 0 || static_cast<std::int32_t>(sequence - other) > 0);
}
[[nodiscard]] inline std::uint32_t count_up(std::uint32_t& sequence) {
  if (++sequence == 0) ++sequence;
  return sequence;
}

[[nodiscard]] Status no_such(BodyId body);

/// Tiles, pages and detail that nothing was near for so long, on the exercise's clock, are given
/// up.
inline constexpr double kUnused_s = 10;

/// Of contents, and who was asked for them, these many that were asked for last: of others nothing
/// is on its way any more.
inline constexpr std::size_t kMaxAskedAbout = 4096;

/// PairAnswer::reason of a pair that is put off. Short, since there may be thousands in a frame.
inline constexpr const char* kOutOfBudget = "out of budget";

[[nodiscard]] inline std::uint32_t part_of(const Body& own) {
  return own.number / wire::kBodiesPerPart;
}

struct Session::Impl {
  std::unique_ptr<Channel> channel;
  SessionOptions options;
  Status options_status;  // of check()
  ReplicaSet replicas;
  // By BodyId; where they are does not change, so pairs may point at them.
  std::map<std::uint32_t, Body> bodies;
  std::vector<Body*> by_id;       // the same; null: was removed
  std::vector<Body*> present;     // the same, for who looks at all of them in each frame
  std::vector<Body*> own_bodies;  // by number on the bus, ascending
  std::uint32_t next_number = 0;
  std::set<std::uint32_t> untold_parts;  // of the directory: others know them otherwise
  bool discovers = false;
  std::map<std::string, wire::BodyDirectory::Body> told_bodies;  // that others move
  bool looks_at_told = false;                     // for those that are to be discovered after all
  std::unordered_map<std::string, BodyId> named;  // for what comes from the bus
  using Reported = std::pair<std::uint64_t, std::uint64_t>;  // frame and digest of the answer
  struct Pair {
    Body* a = nullptr;
    Body* b = nullptr;
    std::optional<Reported> reported;
    bool is_told_put_off = false;  // by the last report
    Readiness last;                // of this pair alone, as of the last update
    // What was last asked of a publisher that chooses.
    struct Asked {
      std::uint32_t request = 0;
      std::uint64_t states = 0;  // of both models, then
      bool is_answered = false;
      int fruitless = 0;  // answers in a row that brought nothing
    } asked;
    bool by_region = false;     // nobody chooses for it
    bool lacks_soon = false;    // of one by region: by this update's look
    bool is_by_name = false;    // watched by name
    bool is_of_tile = false;    // a part of one with a world
    ContentHash of_world;       // of such a part: the world's state
    std::uint64_t near_in = 0;  // the update that found it near last
    double looked_ahead_s = -std::numeric_limits<double>::infinity();
    double look_cost_s = 0;  // then
    // session_turns.cpp
    struct Turn {
      std::uint64_t came_in = 0, asked_in = 0;  // updates; 0: not yet
      double cost_s = 0;                        // of asking it then
      bool is_cut_short = false;  // it took longer since, and was put off: it is to come first
    } turn;
    struct Certified {
      LastCertified said, now;  // then; and what is left of it in this update
      std::uint64_t asked_in = 0;
      double time_s = 0;
      KeptFree kept;  // of an answer without a pair, and the poses of any
      ContentHash content_a, content_b;
      std::uint64_t changes_a = 0, changes_b = 0;  // of the replicas: changes_of()
      ClearanceLeft left;                          // in this update
      // All of it, where neither body moved.
      struct AtRest {
        Answered answered;
        std::optional<std::uint64_t> digest;  // of the answer, once it was needed
      };
      std::optional<AtRest> at_rest;
    };
    std::optional<Certified> certified;
    ContactBook contacts;
    ContentHash content_a, content_b;  // that its contacts are of
    bool is_ready = false;             // in this update: headers and fresh poses are there
    // In this update: neither body has moved since certified->at_rest; or it is free by what was
    // said last.
    bool lies = false;
    std::optional<Answered> still;
    bool is_put_off = false;  // in the last update; stands for `last` then

    /// This update's answer, where it need not be asked; else null.
    [[nodiscard]] const Answered* known() const {
      return lies ? &certified->at_rest->answered : still ? &*still : nullptr;
    }
    [[nodiscard]] bool has(const Body& body) const { return a == &body || b == &body; }
    [[nodiscard]] std::string names() const { return a->name + " and " + b->name; }
  };
  using PairKey = std::pair<std::uint32_t, std::uint32_t>;  // BodyIds, the lower first
  std::map<PairKey, Pair> pairs;                            // watched by name, or near
  std::vector<Pair*> listed;  // all of them: the report's answers, in order
  // Their places there by model, while detail is asked for: there may be as many models as pairs.
  std::unordered_map<const PeerModel*, std::vector<std::uint32_t>> listed_of;

  bool watches_all = false;       // or
  bool watches_only_own = false;  // of them those of own bodies
  BroadPhase broad;
  std::vector<Body*> by_slot;
  double fastest_mps = 0;       // of the own bodies, as they move now
  bool has_promised = false;    // an own body has, or had, a greatest speed
  bool hears_promises = false;  // or did
  std::uint64_t updates = 0;
  std::uint64_t next_contact = 1;

  // session_links.cpp: poses of robots that others move, until all of an instant are here.
  struct HeardLinks {
    using Update = std::uint32_t;                             // wire::first_sample_of_robot()
    using Instant = std::map<std::uint32_t, wire::BodyPose>;  // by number
    std::map<std::pair<Update, double>, Instant> instants;    // by update and time
    Update taken = 0;                                         // of those that count now
    double taken_s = 0;                                       // their time
  };
  std::map<std::pair<wire::SessionId, std::uint32_t>, HeardLinks> heard_links;  // by first link
  std::uint64_t looked_for_robots_in = 0;  // the update that forget_robots_of_nobody() did

  // session_bounds.cpp
  std::set<std::uint32_t> untold_watched;  // parts of the bodies: others know them otherwise
  std::uint32_t watched_edition = 0;
  std::map<wire::SessionId, std::uint32_t> watched_movers;  // and of how many bodies
  /// The last that came, and the last before it that did not.
  struct HeardSamples {
    std::uint32_t last = 0, lost = 0;  // 0: none
  };
  std::map<wire::SessionId, HeardSamples> last_pose_samples;              // by mover
  std::map<wire::SessionId, std::uint32_t> last_promises;                 // that came, by mover
  std::uint32_t pose_samples = 0, near_samples = 0, promise_samples = 0;  // that went out
  bool has_recorder = false;                                              // in this update

  // session_worlds.cpp
  struct WorldPair {
    Pair* pair = nullptr;
    std::string reason;  // why nothing can be said
    TilesAround around;
    std::uint32_t reach_cells = 0;     // that it is of
    std::vector<WorldEntry> not_here;  // tiles of which no header is, of those near
    std::vector<std::string> why_not_here;
    std::size_t first = 0;  // the pairs of its other tiles: listed[first], ..., as they stand there
    // Once these are answered.
    PairAnswer answer;
    std::uint64_t digest = 0;         // of it
    wire::ContactReport::World told;  // what it rests on
  };
  std::vector<WorldPair> world_pairs;                                // of the update
  std::map<std::pair<std::uint32_t, WorldEntry>, Body> tile_bodies;  // by the world's BodyId
  std::map<std::pair<PairKey, WorldEntry>, Pair> tile_pairs;
  struct WantedBytes {
    ContentReader reader;
    ContentHash of_world;
    bool is_page = false;         // else the header of a tile
    std::uint64_t wanted_in = 0;  // the update that wanted it last
    wire::SessionId asked = 0;    // whose pieces the reader has
  };
  std::map<ContentHash, WantedBytes> wanted_bytes;
  // What probes of worlds lack, or lacked of late: by the world's body; of a page the content alone
  // counts.
  struct ProbedPart {
    WorldEntry entry;
    bool is_page = false;
    auto operator<=>(const ProbedPart&) const = default;
  };
  std::map<std::pair<std::uint32_t, ProbedPart>, double> probed_parts;  // until when, by `clock`

  // session_promises.cpp
  struct Wish {
    wire::WantedPoses wanted;
    double heard_s = 0;
  };
  std::map<wire::SessionId, Wish> wishes;  // of other peers, for poses of own bodies
  std::set<std::uint32_t> unserved_parts;  // that somebody wants since the last update
  struct ToldWish {
    std::vector<wire::WantedPoses::Part> parts;
    double told_s = 0;
  };
  std::map<wire::SessionId, ToldWish> told_wishes;  // by mover

  std::map<wire::SessionId, Publisher> publishers;
  wire::AskedPublishers asked_publishers;  // also those that are gone
  LruMap<std::pair<ContentHash, wire::SessionId>, std::monostate> asked_about{
      kMaxAskedAbout};           // who was asked for which content
  std::uint32_t recorders = 0;   // that came
  bool has_news = false;         // of publishers or bodies: what names stand for may change
  std::size_t begun_epochs = 0;  // of what publishers serve
  std::map<ContentHash, Outstanding> outstanding;
  std::uint32_t last_request = 0;
  std::string last_served;  // model, of those that name what they lack
  double time_s = 0;        // of the update
  double frame_s = 0;       // since the update before
  double looked_for_use_s = -std::numeric_limits<double>::infinity();  // give_up_unused() did
  std::uint64_t asked_ahead_in = 0;   // the last update that asked by region for what is ahead
  std::uint64_t looked_ahead_in = 0;  // the last update that looked ahead, or had no need to
  std::uint64_t looked_by_region_in = 0;
  // Of this update's time, when the last pair that was asked had been: to put off the others takes
  // time, too.
  double asked_by_s = 0;
  bool has_updated = false;
  bool is_half_way = false;          // an exception has left a change
  std::exception_ptr fault_of_host;  // what its scheduler threw in this update
  std::optional<double> heard_time_s;
  std::uint64_t refused = 0;
  std::vector<wire::BodyPose> heard_by_host;  // since the last update
  bool is_dropping = false;                   // batches, in this update
  std::set<wire::SessionId> refused_of;       // who sent headers that do not count, as was said
  std::set<wire::SessionId> unasked_of;  // who sent batches that it was not asked for, as was said
  SessionStats stats;
  Stopwatch clock;
  Random audits{0};  // which block is next
  wire::StatusKeeper keeper;
  wire::ProcessStatus told;  // the last status

  // Null where there is no such body.
  [[nodiscard]] Body* find(BodyId body) {
    return body.value < by_id.size() ? by_id[body.value] : nullptr;
  }
  [[nodiscard]] Status check_pin(const std::string& body, const std::string& model_name,
                                 const ContentHash& content) const;
  [[nodiscard]] wire::PoseStamp stamp_of(const Body& body) const;
  [[nodiscard]] Result<BodyId> add_body(BodyOptions options);
  void remove_body(Body& body);
  template <class Use>
  void for_each_of_part(std::uint32_t part, const Use& use);
  void join_tiles(FrameReport& report);
  [[nodiscard]] Status find_tiles(WorldPair& found);
  [[nodiscard]] Result<TilesAround> tiles_around(PeerWorld& tiles, const Body& world,
                                                 const Body& other,
                                                 std::uint32_t reach_cells) const;
  void fetch_coming(const Body& world, const Body& other, std::uint32_t reach_cells);
  void leave_tiles();
  void forget_tiles(const Body& body);
  [[nodiscard]] Body* tile_body(const Body& world, const WorldEntry& tile, std::string& why_not,
                                std::vector<std::string>& complaints);
  void note_part(const ContentHash& part, const ContentHash& of_world);
  void want_bytes(const ContentHash& content, const ContentHash& of_world, bool is_page);
  [[nodiscard]] std::string who_gives(const ContentHash& content);
  void ask_for_bytes();
  void take_piece(const wire::SplitBatchMessage& message, FrameReport& report);
  void fold_worlds(std::uint64_t frame, FrameReport& report);
  void fold_world(WorldPair& found, const FrameReport& report);
  void put_folded(FrameReport& report);
  void tell_directory();
  void publish(std::uint32_t part, std::uint64_t frame, bool only_near = false);
  void note_recorder();
  void take_inbox(FrameReport& report);
  void take_bodies(const Channel::Inbox& inbox, FrameReport& report);
  void take_body(const wire::BodyDirectory::Body& entry, FrameReport& report);
  void lose_told(const std::string& name, FrameReport& report);
  void take_mover(Body& body, wire::Mover mover);
  void hear_time(double said_s, const std::string& body, std::vector<std::string>& complaints);
  void take_poses(const Channel::Inbox& inbox, std::vector<std::string>& complaints);
  void take_pose(const wire::BodyPose& pose, std::vector<std::string>& complaints);
  void forget_gone_movers();
  static void forget_pose(Body& body);
  void take_link(const wire::BodyPose& pose, std::vector<std::string>& complaints);
  void forget_heard(const Body& body);
  void forget_robot(Body& body);
  void forget_robots_of_nobody();
  [[nodiscard]] Status link_bodies(const std::vector<BodyId>& links);
  [[nodiscard]] Status check_links(const std::vector<OwnMotion>& motions) const;
  [[nodiscard]] std::vector<Body*>::iterator own_from(std::uint32_t number);
  void add_parts_of(const Body& own, std::vector<std::uint32_t>& parts) const;
  void take_promises(const Channel::Inbox& inbox, std::vector<std::string>& complaints);
  void take_wishes(const Channel::Inbox& inbox);
  [[nodiscard]] Status check_promised(const Body& own, const Motion& motion, double at_s) const;
  [[nodiscard]] std::vector<wire::SessionId> who_wants(const Body& own) const;
  void make_promises();
  void tell_wishes();
  [[nodiscard]] bool wants_poses(const Body& body) const;
  void note_near(Body& body) const;
  [[nodiscard]] static bool is_near_soon(const Body& a, const Body& b);
  [[nodiscard]] const wire::BodyPromise* promise_of(const Body& body) const;
  [[nodiscard]] std::string why_unpromised(const Body& body) const;
  void bound_promised(Body& body, FrameReport& report);
  void watch_many(bool only_own);
  void take_batch(wire::SplitBatchMessage&& message, FrameReport& report);
  void take_redirection(const wire::SplitBatchMessage& message);
  void close_request(const wire::SplitBatchMessage& message);
  void take_refused_certificate(const wire::SplitBatchMessage& message);
  void ask_anew(Body& body);
  void leave_model(PeerModel& model);
  void bound(Body& body, FrameReport& report);
  void find_near(std::uint64_t frame, FrameReport& report);
  // Of all bodies whose place an update knows.
  struct Bounded {
    FreePairs pairs;
    std::uint64_t places_digest = 0;
    bool rests_on_more = false;  // than a recorder hears
  };
  void note_bounded(const Body& body, Bounded& bounded) const;
  void tell_free(std::uint64_t frame, std::uint64_t near, const Bounded& bounded,
                 FrameReport& report);
  void note_known(Body& body);
  void note_told(Body& body, const Body::Told& now);
  void tell_watched();
  [[nodiscard]] bool is_posed_apart(const Body& body) const;
  [[nodiscard]] std::vector<wire::BoundsReport::Heard> heard_of_movers();
  void tell_bounds(std::uint64_t frame, std::uint64_t free, const Bounded& bounded);
  void add_unbounded(Readiness& all, const Body& body);
  [[nodiscard]] std::string why_unknown(const Body& body) const;
  [[nodiscard]] std::string why_no_bounds(const Body& body) const;
  [[nodiscard]] Status check_whole() const;
  /// While it lives the session is half-way, and what is thrown meanwhile leaves it so.
  class Change {
   public:
    explicit Change(Impl& impl) : is_half_way_(impl.is_half_way), was_(impl.is_half_way) {
      is_half_way_ = true;
    }
    Change(const Change&) = delete;
    Change& operator=(const Change&) = delete;
    ~Change() {
      if (std::uncaught_exceptions() == thrown_) is_half_way_ = was_;
    }

   private:
    bool& is_half_way_;
    const bool was_;
    const int thrown_ = std::uncaught_exceptions();
  };
  void run_jobs(std::size_t count, const std::function<void(std::size_t)>& job);
  struct AskedPair {
    std::vector<std::string> complaints;
    double query_s = 0;
    double ended_s = 0;  // of the update's time; 0: was not asked
    bool is_cut_short = false;
  };
  // What updates took of late: a batch; a pair; what follows the batches; what follows the answers;
  // a look ahead; giving up.
  ExpectedCost batch_cost{0.25}, pair_cost{0.125}, answers_cost, rest_cost{1, 1.0 / 64},
      look_cost{0.125}, region_cost, ahead_cost{0.125}, give_up_cost;
  // By how much updates would have run over, had nothing been set aside for that.
  ExpectedCost overrun{1, 1.0 / 256};
  [[nodiscard]] double margin_of(const FrameBudget& budget) const {
    return std::min(overrun.seconds(), budget.seconds() / 8);
  }
  void note_overrun(const FrameBudget& budget) {
    const double margin_s = margin_of(budget);
    overrun.add(std::clamp(margin_s - budget.left_s(), 0.0, budget.seconds() / 8));
  }
  bool asked_none = false;  // by the update before, of those that were to be asked
  [[nodiscard]] double ending_s(const FrameBudget& budget) const;
  void answer_pairs(std::uint64_t frame, const FrameBudget& budget, FrameReport& report);
  enum class Turn : std::uint8_t {
    kPutOff,
    kTimed,  // is asked until the time is over
    kWhole   // is asked, whatever it takes
  };
  void ask_pair(const Pair& pair, PairAnswer& result, AskedPair& asked,
                const std::function<Turn()>& take_turn, const IsOver& is_over) const;
  void look_at_pairs();
  [[nodiscard]] std::vector<std::uint32_t> take_turns(double left_s) const;
  [[nodiscard]] double due_of(const Pair& pair) const;
  [[nodiscard]] double cost_of(const Pair& pair) const;
  [[nodiscard]] LastCertified last_certified_of(const Pair& pair, ClearanceLeft& left) const;
  [[nodiscard]] bool is_as_then(const Pair& pair) const;
  [[nodiscard]] std::optional<Answered> still_free_of(const Pair& pair) const;
  void find_known(Pair& pair) const;
  [[nodiscard]] static std::uint64_t digest_of(Pair& pair, const PairAnswer& result);
  [[nodiscard]] AnswerOptions answer_options_of(const Pair& pair) const;
  [[nodiscard]] AskedBody asked_body_of(const Body& body) const;
  void put_off(const Pair& pair, PairAnswer& result) const;
  void note_turn(Pair& pair, const PairAnswer& result, const AskedPair& asked);
  void note_known(Pair& pair);
  void settle_pair(Pair& pair, PairAnswer& result, const AskedPair& asked, std::uint64_t frame,
                   FrameReport& report);
  void follow_contacts(Pair& pair, PairAnswer& answer, FrameReport& report);
  void end_contacts(Pair& pair, FrameReport& report);
  void ask_for_depth(const Pair& pair, const PairAnswer& answer);
  void note_lacking(PeerModel& model, const std::vector<NodeSpan>& missing,
                    std::vector<GridBox> where);
  void report_pair(Pair& pair, const PairAnswer& answer, const Reported& now,
                   wire::ContactReport::World* world = nullptr);
  void give_up(PeerModel& model, const std::vector<RegionPart>& kept, FrameReport& report);
  void give_up_unused(FrameReport& report);
  [[nodiscard]] bool may_meet(const Pair& pair) const;
  template <class Probe, class Answer>
  [[nodiscard]] Result<ProbeReport> probe(BodyId body, std::span<const Probe> probes,
                                          std::span<Answer> answers);
  template <class Probe, class Answer>
  [[nodiscard]] Result<ProbeReport> probe_world(Body& body, std::span<const Probe> probes,
                                                std::span<Answer> answers, ProbeReport report);
  void want_probed(FrameReport& report);
  void ask_for_probes();
  void give_up(const FrameBudget& budget, FrameReport& report);
  void tell_held(FrameReport& report);
  void ask(const FrameBudget& budget, FrameReport& report);
  void ask_certificates(const FrameBudget& budget, const FrameReport& report);
  enum class Need : std::uint8_t {
    kNothing,
    kNow,
    kAhead,
    kLook
  };  // the last: who looks ahead finds out
  struct Candidate {
    Pair* pair;
    Need need;
  };
  [[nodiscard]] std::vector<Candidate> find_candidates(const FrameReport& report);
  void look_ahead(const FrameBudget& budget, std::vector<Candidate>& candidates,
                  std::uint64_t& looked_in);
  void look_ahead_by_region(const FrameBudget& budget, const FrameReport& report);
  [[nodiscard]] Need need_of(const Pair& pair, const PairAnswer& answer) const;
  [[nodiscard]] bool is_lacking_soon(const Pair& pair, std::uint64_t max_tests) const;
  void request_certificate(const Publisher& publisher, std::span<Pair* const> asked,
                           std::uint8_t priority);
  [[nodiscard]] bool has_open(const ContentHash& content) const;
  [[nodiscard]] std::set<wire::SessionId> told_of_bodies() const;
  enum class Scope : std::uint8_t { kAll, kByRegion, kUncertified };  // the last: by region, too
  [[nodiscard]] RegionMaker region_of(const PeerModel& model, double lookahead_s,
                                      const FrameReport& report, Scope scope);
  [[nodiscard]] bool stays_certified(const PairAnswer& answer, double lookahead_s) const;
  void sort_listed();
  [[nodiscard]] std::span<const std::uint32_t> places_of(const PeerModel& model) const;
  [[nodiscard]] std::vector<RegionPart> kept_of(const PeerModel& model, const FrameReport& report);
  [[nodiscard]] std::vector<NodeSpan> missing_of(const PeerModel& model, const FrameReport& report,
                                                 bool ahead) const;
  [[nodiscard]] double horizon_s() const { return std::max(options.lookahead_s, options.sweep_s); }
  [[nodiscard]] LookAhead ahead() const { return {horizon_s(), options.margin_m}; }
  /// What is lacked this soon is asked for with all of the horizon: fewer and fuller answers than a
  /// little in each frame. Three frames at least, since an answer that comes in the next is there
  /// for the one after. By region it takes more than one.
  [[nodiscard]] double soon_s(const Pair& pair) const {
    const double at_least_s = pair.by_region ? horizon_s() / 2 : horizon_s() / 4;
    return std::clamp(3 * frame_s, at_least_s, horizon_s());
  }
  [[nodiscard]] bool may_ask_for(const PeerModel& model);
  void request_ahead(PeerModel& model, const FrameReport& report);
  bool request(PeerModel& model, const RegionMaker& region, std::vector<NodeSpan> missing,
               std::uint8_t priority);
  void send_request(const Publisher& publisher, std::uint8_t priority,
                    wire::RegionSubscription request);
  void audit(PeerModel& model);
  void settle_audit(PeerModel& model, FrameReport& report);
  void tell_bodies(wire::ProcessStatus& now) const;
  void tell_status(const FrameReport& report, const SessionStats& counted);
  [[nodiscard]] Publisher* publisher_of(const ContentHash& content,
                                        const ContentHash& and_too = {});
  [[nodiscard]] bool is_contradicted(const PeerModel& model) const;
  [[nodiscard]] bool is_lost(const Outstanding& open) const {
    return clock.seconds() - open.heard_s >= open.patience_s;
  }
  void count_lost(const Outstanding& lost);
  [[nodiscard]] double patience_after(std::uint32_t lost_requests) const;
  void open_request(const ContentHash& content, const Publisher& publisher, Outstanding open);
  [[nodiscard]] std::string why_no_mesh(const PeerModel& model) const;
  [[nodiscard]] std::string why_not_ready(const Body& body) const;
  void take_hello(const wire::Hello& hello);
  void take_header(const Channel::Header& header, std::vector<std::string>& complaints);
  void note_epochs();
  void settle_contents(std::vector<std::string>& complaints);
  [[nodiscard]] std::string awaited_of(const PeerModel& model, std::size_t missing);
};

}  // namespace nearmesh::subscriber
