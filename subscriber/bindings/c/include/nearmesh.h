// SPDX-License-Identifier: Apache-2.0
// nearmesh for C, and for every language that calls C: libnearmesh.so.0, target nearmesh::c,
// pkg-config nearmesh. A guide with a complete program: docs/embed.md, "From C". What the words
// mean: the C++ headers that docs/api.md lists.
//
// Rules that hold for all of it
// * Errors. A function that can fail gives a nearmesh_status and takes, last, a nearmesh_error* for
//   the text; NULL where the text is not wanted. After a failure nothing was changed unless the
//   function says otherwise, and what it was to give is NULL or 0. Nothing is thrown, nothing is
//   printed. NULL for a handle, or a handle of another kind, is NEARMESH_INVALID_ARGUMENT.
// * Memory. Nothing that you allocate is freed here, and nothing of ours by you. What you pass is
//   copied, or used until the call returns. What is given to you as a pointer belongs to the handle
//   that it came from; each function says until when.
// * Threads. One thread at a time uses a handle; two at once are NEARMESH_CONFLICT where that is
//   noticed. Handles share nothing but what a function says. Functions without a handle: any
//   thread.
// * Structs grow at their end only, and what is in them keeps its meaning, as long as the library
//   is libnearmesh.so.0.
//   - Options that you fill begin with `size`. Make them with their init function, then set what
//     you want otherwise. Programs that were compiled with a shorter struct keep working: what they
//     do not know has its default. A newer program on an older library works too, as long as it
//     leaves alone what that library does not know; else NEARMESH_UNSUPPORTED.
//   - Results that you read are given as pointers, of lists one by one. Never copy such a struct by
//     assignment, or rely on its size.
//   - These never change: nearmesh_error, nearmesh_pose, nearmesh_motion, nearmesh_face,
//     nearmesh_face_pair, nearmesh_contact_segment, probes with their answers (nearmesh_ray and so
//     on), and nearmesh_world_tile. They may stand in arrays.
// * Text is UTF-8 that ends with 0. An int32_t that answers a question is 0 for no; else yes.
// * Frames. Right-handed, metres, seconds, radians; x_world = rotation x_model + translation,
//   rotation row by row.
#ifndef NEARMESH_H
#define NEARMESH_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define NEARMESH_API __attribute__((visibility("default")))
#else
#define NEARMESH_API
#endif
#ifdef __cplusplus
#define NEARMESH_NOTHROW noexcept
extern "C" {
#else
#define NEARMESH_NOTHROW
#endif

// ---- Status -------------------------------------------------------------------------------------

typedef int32_t nearmesh_status;
enum {
  NEARMESH_OK = 0,
  NEARMESH_INVALID_ARGUMENT = 1,  ///< a value is outside its stated range
  NEARMESH_NOT_FOUND = 2,         ///< the named thing does not exist
  NEARMESH_CORRUPT = 3,           ///< bytes contradict their checksum or their format
  NEARMESH_UNSUPPORTED = 4,       ///< well formed, but not for this build: a version, a size, DDS
  NEARMESH_IO = 5,                ///< the operating system refused
  NEARMESH_CONFLICT = 6,          ///< contradicts what is there already, or another call that runs
  NEARMESH_OUT_OF_MEMORY = 7,     ///< see the function for what its handle can still do
  NEARMESH_INTERNAL = 8           ///< a fault of nearmesh's; please report the text
};

#define NEARMESH_MESSAGE_BYTES 1020
/// What went wrong, for people: the thing, the place, what was expected and found. Yours; any
/// number of calls may share one.
typedef struct nearmesh_error {
  nearmesh_status status;                ///< as returned
  char message[NEARMESH_MESSAGE_BYTES];  ///< cut where it is longer; empty for NEARMESH_OK
} nearmesh_error;

/// "ok", "invalid_argument", and so on; "unknown" for any other number. Static.
NEARMESH_API const char* nearmesh_status_name(nearmesh_status status) NEARMESH_NOTHROW;

/// Of this header. That of the library may be later: nearmesh_version().
#define NEARMESH_VERSION "0.1.0"
/// "MAJOR.MINOR.PATCH" of the library. Static.
NEARMESH_API const char* nearmesh_version(void) NEARMESH_NOTHROW;
/// Whether the library was built with DDS.
NEARMESH_API int32_t nearmesh_has_dds(void) NEARMESH_NOTHROW;

// ---- Where bodies are ---------------------------------------------------------------------------

/// A rigid placement. The rotation must be one to within 1e-5, the translation within 1e9 m.
typedef struct nearmesh_pose {
  double rotation[9];  ///< row by row
  double translation_m[3];
} nearmesh_pose;
#define NEARMESH_POSE_IDENTITY {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}}

/// A placement and how it moves. World frame; the body turns about the origin of its model.
typedef struct nearmesh_motion {
  nearmesh_pose pose;
  double linear_velocity_mps[3];     ///< each within 1e9
  double angular_velocity_radps[3];  ///< each within 1e9
} nearmesh_motion;
#define NEARMESH_MOTION_IDENTITY {NEARMESH_POSE_IDENTITY, {0, 0, 0}, {0, 0, 0}}

// ---- Models -------------------------------------------------------------------------------------

typedef struct nearmesh_bake_options {
  size_t size;            ///< set by nearmesh_bake_options_init()
  uint32_t base_faces;    ///< of the coarsest mesh, at most; 16
  int32_t grid_bits;      ///< a cell is the size of the mesh / 2^grid_bits; 4 to 31; 21
  uint32_t threads;       ///< 0, the default: one for each core; no influence on the result
  uint32_t reserved;      ///< 0
} nearmesh_bake_options;

/// `size`: sizeof of your struct. Errors: NEARMESH_INVALID_ARGUMENT.
NEARMESH_API nearmesh_status nearmesh_bake_options_init(nearmesh_bake_options* options,
                                                        size_t size) NEARMESH_NOTHROW;

/// Makes a model of a mesh, and writes it to a .spm file, which appears under its name only when it
/// is whole.
/// In: `positions_m`: 3 numbers a vertex; `faces`: 3 places of vertices a face, counter-clockwise
/// from outside. `options`: NULL for the defaults.
/// Errors: NEARMESH_INVALID_ARGUMENT naming the vertex or the face; NEARMESH_UNSUPPORTED (hundreds
/// of faces at one edge, a mesh too large); NEARMESH_IO; NEARMESH_CONFLICT where something is there
/// that is no model.
/// Cost: some seconds a million faces, 250 bytes a vertex. Threads: any.
NEARMESH_API nearmesh_status nearmesh_bake(const double* positions_m, size_t vertex_count,
                                           const uint32_t* faces, size_t face_count,
                                           const char* path, const nearmesh_bake_options* options,
                                           nearmesh_error* error) NEARMESH_NOTHROW;

/// An open .spm file. Queries that were made of it, and it, are used by one thread at a time; open
/// the file once for each thread.
typedef struct nearmesh_model nearmesh_model;

/// What the header says.
typedef struct nearmesh_model_facts {
  /// Names the whole content, 32 hexadecimal digits; equal names, equal models.
  const char* content;
  uint32_t vertex_count;
  uint32_t face_count;
  uint32_t component_count;    ///< connected parts
  uint32_t boundary_edges;     ///< with one face
  uint32_t disagreeing_edges;  ///< with more, not passed equally often both ways
  int32_t is_closed;           ///< it has an inside: may be solid
  double cell_m;               ///< of the grid on which its vertices lie
  double grid_origin_m[3];
  /// Vertices lie within 2^grid_bits cells of the origin, on each axis.
  int32_t grid_bits;
  int32_t reserved;
  double rounding_error_m;     ///< how far a vertex was moved onto the grid at most
  /// What a whole replica would be sent; 0 where only the header is here.
  uint64_t mesh_bytes;
  uint64_t file_bytes;         ///< 0 where only the header is here
} nearmesh_model_facts;

/// Errors: NEARMESH_IO, NEARMESH_CORRUPT, NEARMESH_UNSUPPORTED (version), naming path and place.
NEARMESH_API nearmesh_status nearmesh_model_open(const char* path, nearmesh_model** model,
                                                 nearmesh_error* error) NEARMESH_NOTHROW;
/// Queries that were made of it go on. NULL: nothing.
NEARMESH_API void nearmesh_model_close(nearmesh_model* model) NEARMESH_NOTHROW;
/// Valid until the model is closed. NULL for no model.
NEARMESH_API const nearmesh_model_facts* nearmesh_model_get_facts(const nearmesh_model* model)
    NEARMESH_NOTHROW;
/// Checks every digest of the file; with `deep` also all that certified answers rest on, at the
/// cost of decoding everything.
/// Errors: NEARMESH_CORRUPT naming the place, NEARMESH_IO.
NEARMESH_API nearmesh_status nearmesh_model_check(nearmesh_model* model, int32_t deep,
                                                  nearmesh_error* error) NEARMESH_NOTHROW;

/// No split: a face of the coarsest mesh. No body.
#define NEARMESH_NONE 0xffffffffU
/// Names a face of a full mesh, the same on all peers: the split that it comes with, and its place
/// there.
typedef struct nearmesh_face {
  uint32_t split;
  uint32_t index;
} nearmesh_face;
typedef struct nearmesh_face_pair {
  nearmesh_face a, b;
} nearmesh_face_pair;

/// Which face of the mesh that was baked a face is, counted from 0. The first call decodes the
/// whole file.
/// Errors: NEARMESH_NOT_FOUND where the model has no such face; NEARMESH_CORRUPT, NEARMESH_IO.
NEARMESH_API nearmesh_status nearmesh_model_face_number(nearmesh_model* model, nearmesh_face face,
                                                        uint32_t* number, nearmesh_error* error)
    NEARMESH_NOTHROW;

// ---- Answers ------------------------------------------------------------------------------------

/// nearmesh_answer.status, nearmesh_swept.status
enum {
  NEARMESH_FREE = 0,       ///< certified: nothing touches
  NEARMESH_CONTACT = 1,    ///< certified: `pairs` touch, and no others
  NEARMESH_PARTIAL = 2,    ///< `pairs` touch, there may be more
  NEARMESH_UNCERTAIN = 3,  ///< nothing can be said yet
  /// Certified: nothing touches, but one is inside the other, which is solid.
  NEARMESH_CONTAINED = 4
};
/// "free", "contact", "partial", "uncertain", "contained"; "unknown" for any other number. Static.
NEARMESH_API const char* nearmesh_answer_status_name(int32_t status) NEARMESH_NOTHROW;

/// nearmesh_answer.contained
enum {
  NEARMESH_NOT_CONTAINED = 0,
  NEARMESH_A_IN_B = 1,
  NEARMESH_B_IN_A = 2,
  NEARMESH_IN_EACH_OTHER = 3  ///< each has a part inside the other
};

/// How near to the distance the bound of a free answer is sought.
enum {
  NEARMESH_CLEARANCE_NONE = 0,   ///< not at all: the bound is 0
  NEARMESH_CLEARANCE_BOUND = 1,  ///< to three quarters of what is known at least
  NEARMESH_CLEARANCE_EXACT = 2   ///< the greatest that what is held allows
};

/// A point (p = q) or segment that two faces have in common. World frame.
typedef struct nearmesh_contact_segment {
  double p_m[3], q_m[3];
  nearmesh_face_pair pair;
  int32_t approximate;  ///< one of the faces is not one of the full mesh
  int32_t reserved;
} nearmesh_contact_segment;

/// Segments that hang together.
typedef struct nearmesh_contact_patch {
  uint32_t first, count;    ///< segments first to first + count - 1
  double length_m;          ///< of the segments; 0: nothing but points
  double centroid_m[3];
  double normal[3];         ///< unit vector from A to B, the way B has to move to get away
  double normal_error_rad;  ///< faces here are within this of it; pi: nothing is known
  double uncertainty_m;     ///< 0 unless approximate
  int32_t normal_is_of_a;   ///< whose faces it was taken of
  int32_t approximate;
  /// For solvers that take few points: at most four ends of its segments that span it.
  double manifold_m[4][3];
  uint32_t manifold_count, reserved;
  double manifold_error_m;  ///< every point of its segments is within this of their convex hull
} nearmesh_contact_patch;

/// Where two bodies touch.
typedef struct nearmesh_contacts {
  size_t segment_count;
  const nearmesh_contact_segment* segments;  ///< by patch
  size_t patch_count;                        ///< nearmesh_contacts_patch()
  double position_error_m;  ///< every point of a segment is within this of both posed faces
  uint64_t pair_total;      ///< as in the answer
  int32_t truncated;        ///< as in the answer: there are more, and patches may be torn
  int32_t reserved;
} nearmesh_contacts;

/// NULL beyond patch_count. Valid as long as the contacts.
NEARMESH_API const nearmesh_contact_patch* nearmesh_contacts_patch(
    const nearmesh_contacts* contacts, size_t index) NEARMESH_NOTHROW;

/// How deep two bodies are in each other along a direction: how far B has to be moved until it is
/// free of A. Both bounds are proofs.
typedef struct nearmesh_depth {
  double direction[3];     ///< unit vector, world: the way B is moved
  double at_least_m;       ///< moved less along it B touches A all the way; 0: nothing is proved
  double at_most_m;        ///< moved so far it is free; infinite where no free place was found
  /// Add it to the translation of B's pose: then they are certified free, where at_most_m is finite
  double separation_m[3];
  uint64_t missing_a, missing_b;  ///< nodes whose detail would narrow the bracket
  int32_t exhausted;       ///< the search was ended by its length
  int32_t reserved;
} nearmesh_depth;

typedef struct nearmesh_answer {
  int32_t status;                   ///< NEARMESH_FREE and so on
  int32_t is_certified;             ///< free, contact or contained
  int32_t contained;                ///< NEARMESH_NOT_CONTAINED and so on
  int32_t truncated;                ///< `pairs` are the first max_pairs alone
  size_t pair_count;
  const nearmesh_face_pair* pairs;  ///< exact, ascending
  uint64_t pair_total;              ///< how many touch
  /// Free or contained: a lower bound of the distance of the surfaces, metres; infinite where one
  /// has no face. Else 0.
  double clearance_m;
  /// The bound is at least this share of what is held allows; 0: no bound.
  double clearance_share;
  /// Not certified: full surfaces are within this of those that are held, where it matters.
  /// Infinite: nothing is known.
  double uncertainty_m;
  uint64_t missing_a, missing_b;    ///< nodes whose detail the answer lacks
  uint64_t digest;                  ///< equal answers, equal digests, on every peer and build
  /// Where they were asked for and something touches; else NULL.
  const nearmesh_contacts* contacts;
  int32_t exhausted;  ///< max_tests were spent: partial or uncertain, with what was found by then
  int32_t reserved;
  /// The full meshes are at most so far apart, metres; 0 where faces touch, infinite where nothing
  /// is known.
  double distance_at_most_m;
  /// Where it is positive and finite: points of the full meshes that are; world.
  double nearest_a_m[3], nearest_b_m[3];
  /// Where it was asked for and something touches; else NULL.
  const nearmesh_depth* depth;
} nearmesh_answer;

// ---- Queries of two files at hand ---------------------------------------------------------------

typedef struct nearmesh_query_options {
  size_t size;         ///< set by nearmesh_query_options_init()
  /// Stop at the first pair that touches: contact then says "touches", not "these are all".
  int32_t any;
  int32_t clearance;   ///< NEARMESH_CLEARANCE_BOUND
  uint64_t max_pairs;  ///< list so many at most; UINT64_MAX, the default: all
  /// It has an inside, so is the other one in it? Its model must be closed.
  int32_t solid_a, solid_b;
  int32_t contacts;    ///< work out where they touch
  int32_t depth;       ///< and how deep they are in each other; then also `contacts`
  uint64_t max_tests;  ///< end after so many tests, of 2 to 25 ns; UINT64_MAX, the default: do not
  /// Of each depth, of 2 to 5 ns: its bracket is as wide as it is then; 500000.
  uint64_t max_depth_tests;
} nearmesh_query_options;

/// `size`: sizeof of your struct. Errors: NEARMESH_INVALID_ARGUMENT.
NEARMESH_API nearmesh_status nearmesh_query_options_init(nearmesh_query_options* options,
                                                         size_t size) NEARMESH_NOTHROW;

/// Two models that are asked about in one pose after the other. Detail is read as answers need it,
/// and kept for later ones.
typedef struct nearmesh_query nearmesh_query;

/// `a` and `b` may be one. They may be closed before the query. `options`: NULL for the defaults.
/// Errors: NEARMESH_INVALID_ARGUMENT, also where a model that is not closed is to be solid.
NEARMESH_API nearmesh_status nearmesh_query_create(nearmesh_model* a, nearmesh_model* b,
                                                   const nearmesh_query_options* options,
                                                   nearmesh_query** query, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// NULL: nothing.
NEARMESH_API void nearmesh_query_destroy(nearmesh_query* query) NEARMESH_NOTHROW;
/// The answer about the full meshes: certified, but where no detail settles it (a solid of too many
/// parts).
/// Out: `answer`, valid until the next call with this query.
/// Errors: NEARMESH_INVALID_ARGUMENT naming the body and what is wrong with its pose;
/// NEARMESH_UNSUPPORTED where the two sizes or places are too far apart; NEARMESH_CORRUPT,
/// NEARMESH_IO of the files. After NEARMESH_OUT_OF_MEMORY both files must be opened again: every
/// later call with them gives NEARMESH_CONFLICT.
NEARMESH_API nearmesh_status nearmesh_query_ask(nearmesh_query* query, const nearmesh_pose* pose_a,
                                                const nearmesh_pose* pose_b,
                                                const nearmesh_answer** answer,
                                                nearmesh_error* error) NEARMESH_NOTHROW;

// ---- Sessions -----------------------------------------------------------------------------------

/// Runs one of a number of jobs; throws nothing.
typedef void (*nearmesh_job)(void* jobs, size_t index);
/// Yours: calls job(jobs, 0) to job(jobs, count - 1), each once, in any order and on any threads,
/// and returns when all are done. It must not call nearmesh for the session that it serves. An
/// index that was left out is run by the session afterwards, one that comes twice or is too large
/// does nothing; neither job nor jobs may be used once it has returned.
typedef void (*nearmesh_run_jobs)(void* user, size_t count, nearmesh_job job, void* jobs);

typedef struct nearmesh_session_options {
  size_t size;                ///< set by nearmesh_session_options_init()
  /// Answers about older poses of others are uncertain; 0 to infinite; 2.
  double max_pose_age_s;
  /// Detail is asked for where a body may be within this time; 0 to 3600; 0.5.
  double lookahead_s;
  double margin_m;            ///< and this much further; 0 to 1e9; 0
  /// Also answer for all of this time ahead; 0, the default: do not; else 1e-9 to 3600.
  double sweep_s;
  /// A request without an answer is repeated after this; 1e-4 to 3600; 0.5.
  double request_timeout_s;
  /// So often, in seconds, a publisher must prove a block of its file; 0, the default: never.
  double audit_s;
  uint64_t audit_seed;        ///< draws which; 0, the default: the system does
  uint32_t window_bytes;      ///< that may be under way to this peer, at least 2000; 65536
  /// Above this, detail far from every body is given up; 0, the default: no limit. What nothing was
  /// near for 10 s is given up in any case.
  uint32_t max_held_splits;
  /// Where detail is kept from one session to the next; NULL, the default: it is not.
  const char* cache_folder;
  /// NEARMESH_CLEARANCE_BOUND; without one no safe_horizon_s is known either.
  int32_t clearance;
  int32_t contacts;           ///< work out where bodies touch; 0
  int32_t publish_reports;    ///< tell the bus each answer; 1
  int32_t any;                ///< as in nearmesh_query_options, of each answer; 0
  /// Answers of pairs, on threads of yours; NULL, the default: in update(), one by one.
  nearmesh_run_jobs run_jobs;
  void* run_jobs_user;        ///< given to run_jobs
  uint64_t max_pairs;         ///< list so many of each answer at most; UINT64_MAX, the default: all
  uint64_t max_tests;         ///< of each answer, 10 to 50 ms; 2000000
  uint64_t max_sweep_tests;   ///< of each swept answer, of some 100 ns; 50000
  /// Work out how deep bodies are in each other; then also `contacts`; 0.
  int32_t depth;
  int32_t reserved;           ///< 0
  uint64_t max_depth_tests;   ///< of each depth, of 2 to 5 ns; 500000
  /// What is promised of own bodies (max_speed_mps) holds for so long; 0.1 to 255; 8.
  double promise_s;
} nearmesh_session_options;

/// `size`: sizeof of your struct. Errors: NEARMESH_INVALID_ARGUMENT.
NEARMESH_API nearmesh_status nearmesh_session_options_init(nearmesh_session_options* options,
                                                           size_t size) NEARMESH_NOTHROW;

/// How a session joins the bus. Text that is NULL, and numbers that are 0, stand for what
/// `transport` has built in. What each setting does, and its range: docs/operate.md, "Settings".
typedef struct nearmesh_dds_options {
  size_t size;             ///< set by nearmesh_dds_options_init()
  const char* transport;   ///< "lan" (NULL too), "thin", "tcp", "udp-only" or "same-host"
  /// Of this process, for people, 1 to 63 printable bytes; NULL: HOST/PROCESS.
  const char* name;
  const char* prefix;      ///< of every topic; NULL: "nearmesh"
  const char* network_interface;  ///< one IPv4 address or name of an interface; NULL: all
  const char* security;           ///< folder of this program's identity; NULL: none
  /// Where else to look for others: IPv4 addresses, of "tcp" also ADDRESS:PORT.
  const char* const* initial_peers;
  size_t initial_peer_count;
  const char* discovery_server;   ///< "ADDRESS" or "ADDRESS:PORT"; NULL: none
  uint32_t domain;                ///< 0 to 232
  uint32_t listen_port;           ///< of "tcp"; 0: does not listen
  uint32_t participants_per_peer;
  uint32_t reserved;              ///< 0
  double lease_s, silence_s, announcement_s, identity_period_s, heartbeat_s;  ///< seconds
} nearmesh_dds_options;

/// `size`: sizeof of your struct. Errors: NEARMESH_INVALID_ARGUMENT.
NEARMESH_API nearmesh_status nearmesh_dds_options_init(nearmesh_dds_options* options, size_t size)
    NEARMESH_NOTHROW;

/// A peer: its bodies, the pairs that it watches, what it holds of their models.
typedef struct nearmesh_session nearmesh_session;
/// A body of one session: numbers from 0 in the order of nearmesh_session_add_body(), never used
/// again.
typedef uint32_t nearmesh_body;

/// A session that is fed from .spm files (nearmesh_session_add_model): no network, no DDS, no
/// thread. `options`: NULL for the defaults.
/// Errors: NEARMESH_INVALID_ARGUMENT naming the option.
NEARMESH_API nearmesh_status nearmesh_session_create_local(const nearmesh_session_options* options,
                                                           nearmesh_session** session,
                                                           nearmesh_error* error) NEARMESH_NOTHROW;
/// A session on a DDS participant of its own. Takes some ten milliseconds. It has a thread, and
/// Fast DDS has others.
/// Errors: NEARMESH_INVALID_ARGUMENT naming the option; NEARMESH_IO where Fast DDS refuses;
/// NEARMESH_UNSUPPORTED where the library was built without DDS.
NEARMESH_API nearmesh_status nearmesh_session_create_dds(const nearmesh_dds_options* dds,
                                                         const nearmesh_session_options* options,
                                                         nearmesh_session** session,
                                                         nearmesh_error* error) NEARMESH_NOTHROW;
/// Leaves the bus, within a second. NULL: nothing.
NEARMESH_API void nearmesh_session_destroy(nearmesh_session* session) NEARMESH_NOTHROW;

/// Of a local session: serves a model from its file, now or later, under the name that bodies call
/// it by.
/// Errors: those of nearmesh_model_open; NEARMESH_CONFLICT where the name is taken or the content
/// is served already; NEARMESH_INVALID_ARGUMENT (name); NEARMESH_UNSUPPORTED of a session with DDS.
NEARMESH_API nearmesh_status nearmesh_session_add_model(nearmesh_session* session, const char* name,
                                                        const char* path, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// Of a local session: serves a world on disk (docs/worlds.md) as a model of that name; a body of
/// it is a world.
/// Errors: as nearmesh_session_add_model(); NEARMESH_NOT_FOUND, NEARMESH_IO, NEARMESH_CORRUPT,
/// NEARMESH_UNSUPPORTED, naming the file.
NEARMESH_API nearmesh_status nearmesh_session_add_world(nearmesh_session* session, const char* name,
                                                        const char* folder, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// Of a local session: 0 as when the network goes down, else as when it is back. To test what your
/// program does while answers are uncertain. Errors: NEARMESH_UNSUPPORTED of a session with DDS.
NEARMESH_API nearmesh_status nearmesh_session_set_connected(nearmesh_session* session,
                                                            int32_t connected,
                                                            nearmesh_error* error) NEARMESH_NOTHROW;
/// Of a local session: as if another peer had moved the body of this name, at this time. Nothing
/// while it is not connected.
/// Errors: NEARMESH_INVALID_ARGUMENT; NEARMESH_UNSUPPORTED of a session with DDS.
NEARMESH_API nearmesh_status nearmesh_session_deliver(nearmesh_session* session,
                                                      const char* body_name,
                                                      const nearmesh_motion* motion, double time_s,
                                                      nearmesh_error* error) NEARMESH_NOTHROW;

typedef struct nearmesh_body_options {
  size_t size;            ///< set by nearmesh_body_options_init()
  /// On the bus and for people, unique in the session; 1 to 63 bytes of printable ASCII, no blanks
  /// at the ends.
  const char* name;
  const char* model;      ///< the publisher's name for it; the same
  /// 32 digits: no other content is ever taken; NULL, the default: what publishers agree on.
  const char* content;
  /// As in the session's options, for this body; below 0, the default: the session's.
  double max_pose_age_s;
  int32_t own;            ///< this peer moves it; 0: another does, or it stands in its place
  int32_t solid;          ///< it has an inside; 0
  /// 1 and all: a pair counts where the mask of each has a bit of the other's group.
  uint32_t group, mask;
  /// Of an own body: its origin never moves faster, m/s, up to 1e6. Then others are promised where
  /// it stays, and full poses go to those alone that it may come near to. 0, the default: poses go
  /// to all.
  double max_speed_mps;
} nearmesh_body_options;

/// `size`: sizeof of your struct. Errors: NEARMESH_INVALID_ARGUMENT.
NEARMESH_API nearmesh_status nearmesh_body_options_init(nearmesh_body_options* options, size_t size)
    NEARMESH_NOTHROW;

/// At any time. Errors: NEARMESH_INVALID_ARGUMENT (name, content, max_pose_age_s, max_speed_mps);
/// NEARMESH_CONFLICT (name taken, or the content contradicts another body's).
NEARMESH_API nearmesh_status nearmesh_session_add_body(nearmesh_session* session,
                                                       const nearmesh_body_options* options,
                                                       nearmesh_body* body, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// Fixes a body in place, for scenery that nobody moves. Errors: NEARMESH_NOT_FOUND,
/// NEARMESH_INVALID_ARGUMENT (pose; a body with a max_speed_mps, a link).
NEARMESH_API nearmesh_status nearmesh_session_place_body(nearmesh_session* session,
                                                         nearmesh_body body,
                                                         const nearmesh_pose* pose,
                                                         nearmesh_error* error) NEARMESH_NOTHROW;
/// Makes own bodies the links of one robot: whoever hears them takes all poses of one instant or
/// none. Each update then gives motions of all links, or of none. Before any of them has a motion.
/// Errors: NEARMESH_NOT_FOUND, NEARMESH_CONFLICT (a link of another robot, one that has a motion),
/// NEARMESH_INVALID_ARGUMENT (fewer than 2, too many, a body that others move or that has a
/// max_speed_mps).
NEARMESH_API nearmesh_status nearmesh_session_link_bodies(nearmesh_session* session,
                                                          const nearmesh_body* bodies, size_t count,
                                                          nearmesh_error* error) NEARMESH_NOTHROW;
/// The body is there no more, nor are its pairs. A link takes all links of its robot with it.
/// Errors: NEARMESH_NOT_FOUND.
NEARMESH_API nearmesh_status nearmesh_session_remove_body(nearmesh_session* session,
                                                          nearmesh_body body,
                                                          nearmesh_error* error) NEARMESH_NOTHROW;
/// From now on the body has another model; where it is stays. `content`: as in
/// nearmesh_body_options.
/// Errors: NEARMESH_NOT_FOUND, and those of nearmesh_session_add_body.
NEARMESH_API nearmesh_status nearmesh_session_replace_model(nearmesh_session* session,
                                                            nearmesh_body body, const char* model,
                                                            const char* content,
                                                            nearmesh_error* error) NEARMESH_NOTHROW;
/// Watches all pairs of bodies, now and later, but those of which both are in place and those that
/// groups and masks leave out. A frame lists those that may be near, and says of all others
/// together that they are free (nearmesh_frame.free_*).
NEARMESH_API nearmesh_status nearmesh_session_watch_all(nearmesh_session* session,
                                                        nearmesh_error* error) NEARMESH_NOTHROW;
/// As nearmesh_session_watch_all(), but of the pairs of own bodies alone: with each other, and with
/// all that others move.
NEARMESH_API nearmesh_status nearmesh_session_watch_own(nearmesh_session* session,
                                                        nearmesh_error* error) NEARMESH_NOTHROW;
/// Declares each body that another peer moves and that is not declared here, with the name, model,
/// content, group and mask that its mover tells, and whether it is solid (nearmesh_session_came).
/// One that its mover removes is removed here (nearmesh_session_went). Of one whose mover has left
/// nothing is known: it stays, and none of its pairs is certified.
NEARMESH_API nearmesh_status nearmesh_session_discover_bodies(nearmesh_session* session,
                                                              nearmesh_error* error) NEARMESH_NOTHROW;
/// Lists the answer about two bodies in every frame, whatever their groups. Errors:
/// NEARMESH_NOT_FOUND, NEARMESH_INVALID_ARGUMENT (the same body).
NEARMESH_API nearmesh_status nearmesh_session_watch(nearmesh_session* session, nearmesh_body a,
                                                    nearmesh_body b, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// Takes nearmesh_session_watch() back. Errors: NEARMESH_NOT_FOUND.
NEARMESH_API nearmesh_status nearmesh_session_unwatch(nearmesh_session* session, nearmesh_body a,
                                                      nearmesh_body b, nearmesh_error* error)
    NEARMESH_NOTHROW;

// ---- A frame ------------------------------------------------------------------------------------

/// What one update did and said. Seconds are wall clock of that call.
typedef struct nearmesh_frame {
  size_t answer_count;     ///< nearmesh_session_answer()
  size_t unknown_count;    ///< nearmesh_session_unknown()
  size_t complaint_count;  ///< nearmesh_session_complaint()
  int32_t all_certified;   ///< of all pairs, listed or not
  int32_t reserved;
  /// With watch_all or watch_own: so many pairs are not listed, because boxes prove them apart; a
  /// certified answer.
  uint64_t free_by_bounds;
  double free_clearance_m;  ///< of each of them at least
  /// So long after the frame's time none of them can touch, if bodies keep within their speeds.
  double free_horizon_s;
  uint64_t free_digest;
  /// That are not listed since nothing is known of one of the two: uncertain.
  uint64_t unknown_pairs;
  double load_s, refine_s, tree_s;  ///< decoding batches, refining meshes, following with trees
  double broad_s;           ///< finding the pairs that may be near
  double query_s;           ///< answering, the sum over pairs
  uint64_t batches_waiting; ///< left over for want of budget
  uint64_t state_digest;    ///< of the detail that is held
  uint64_t answers_digest;  ///< of all answers; equal on peers that know the same
  uint64_t pairs_put_off;   ///< answers that are, for want of budget
  size_t contact_event_count;  ///< nearmesh_session_contact_event()
  /// With discover_bodies: nearmesh_session_came(), nearmesh_session_went().
  size_t came_count, went_count;
  uint64_t promised;        ///< bodies of which no full pose is here, and a promise holds
} nearmesh_frame;

/// nearmesh_contact_event.change
enum {
  NEARMESH_CONTACT_BEGIN = 0,
  NEARMESH_CONTACT_PERSIST = 1,
  NEARMESH_CONTACT_END = 2,         ///< certified, or a body's model was replaced
  NEARMESH_CONTACT_UNCONFIRMED = 3  ///< not found, but the answer is not certified: it may be there
};
/// What an update says of a contact, a patch that is followed from update to update.
typedef struct nearmesh_contact_event {
  int32_t change;
  uint32_t patch;      ///< begin, persist: its place among the patches of the pair's answer
  uint64_t id;         ///< that it keeps; no other contact of the session has it
  nearmesh_body a, b;  ///< as in the pair's answers
} nearmesh_contact_event;

/// With sweep_s: the answer for all of the time ahead, if both bodies keep their velocities.
typedef struct nearmesh_swept {
  int32_t status;       ///< free for all of sweep_s; contact, partial, uncertain
  int32_t exhausted;    ///< the search was ended by its length
  double free_until_s;  ///< certified free for so long, from the frame's time on
  double hit_s;         ///< faces touch then; infinite where no such time was found
  uint64_t missing_a, missing_b;  ///< nodes whose detail would narrow it
} nearmesh_swept;

/// The latest certified answer about a pair, and what it still says.
typedef struct nearmesh_last_certified {
  int32_t status;      ///< NEARMESH_FREE, NEARMESH_CONTACT or NEARMESH_CONTAINED
  int32_t contained;   ///< NEARMESH_NOT_CONTAINED and so on
  uint64_t pair_total;
  double age_s;        ///< the frame's time less that of the frame that it was given in
  /// The surfaces are at least so far apart at this frame's poses; 0: nothing follows.
  double clearance_m;
  /// So long nothing can touch, if the bodies keep within their speeds of this frame; 0: nothing
  /// follows.
  double safe_s;
} nearmesh_last_certified;

/// A tile of a world, in one of its places.
typedef struct nearmesh_world_tile {
  /// Of its model, 32 hexadecimal digits; of a probe's answer empty where no face was met.
  char content[33];
  int32_t place[3];      ///< where its grid begins, in cells from the world's origin
} nearmesh_world_tile;
/// A tile that pages do not prove apart from the other body, now or within the look-ahead.
typedef struct nearmesh_near_tile {
  nearmesh_world_tile tile;
  int32_t is_here;   ///< its header is; else nothing is known of it but its box
  int32_t asked;     ///< its trees were asked; else its turn did not come, or it is not here
  int32_t status;    ///< as nearmesh_answer.status
  /// So many of the answer's pairs are of this tile: first come those of the first tile, and so on.
  uint64_t pairs;
  uint64_t missing;  ///< nodes of its model that the answer misses
} nearmesh_near_tile;
/// What an answer says of a body that is a world (docs/worlds.md).
typedef struct nearmesh_world_answer {
  const char* content;        ///< of the world, 32 digits
  size_t tile_count;          ///< see nearmesh_world_answer_tile
  /// Pages that are not here, of which nothing is known but their boxes.
  size_t missing_page_count;
} nearmesh_world_answer;
/// By place. Valid as long as the answer. NULL beyond its tile_count.
NEARMESH_API const nearmesh_near_tile* nearmesh_world_answer_tile(
    const nearmesh_world_answer* answer, size_t index) NEARMESH_NOTHROW;

/// An answer about a pair that is watched by name, or may be near.
typedef struct nearmesh_pair_answer {
  nearmesh_body a, b;             ///< as they were watched; else the lower first
  const nearmesh_answer* answer;
  /// Why nothing can be said: something that has not come, or is too old; else empty.
  const char* reason;
  /// Not certified for want of detail: of which model, and who sends it; else empty.
  const char* awaited;
  int32_t asked;        ///< headers and fresh poses were there
  /// They were there, but the budget ended before its turn, or in it: not asked.
  int32_t put_off;
  /// Of the poses at the frame's time; infinite where none has come.
  double age_a_s, age_b_s;
  nearmesh_pose pose_a, pose_b;   ///< what was asked about; meaningless unless `asked`
  /// Of the models that it is about, 32 digits; empty: not known yet.
  const char* content_a;
  const char* content_b;
  /// So long nothing can touch, if the bodies keep within their speeds.
  double safe_horizon_s;
  const nearmesh_swept* swept;    ///< with sweep_s, where the poses are known; else NULL
  /// Of a pair that is put off, if it ever was certified; else NULL.
  const nearmesh_last_certified* last_certified;
  /// Of each patch of answer->contacts, where there are some: a number that lasts with the contact.
  const uint64_t* contact_ids;
  /// Where one of the bodies is a world, and was asked; else NULL.
  const nearmesh_world_answer* world;
} nearmesh_pair_answer;

/// A body of which nothing can be said; none of its pairs is certified.
typedef struct nearmesh_unknown_body {
  nearmesh_body body;
  uint32_t reserved;
  const char* reason;
} nearmesh_unknown_body;

/// One frame: publishes the motions of own bodies, takes in what arrived, answers the watched
/// pairs, and asks for what is missing. May be called again for the same frame. Never blocks. All
/// of it ends within `budget_s`, by the wall clock, but for one batch, one pair, one look ahead,
/// and some microseconds a body and pair. Pairs take turns, who may touch soonest first; whose turn
/// did not come is `put_off`. A budget decides which pairs are asked, never what an answer says.
/// In: `count` own bodies and their motions, side by side; those that rest need not be passed
/// again. `time_s`: the frame's time on the clock that the whole exercise has, at most 1e11 from 0.
/// Out: `frame`; it, and all that the functions below give, is valid until the next call of this,
/// nearmesh_session_wait_ready() or nearmesh_session_destroy().
/// Errors: NEARMESH_NOT_FOUND, NEARMESH_INVALID_ARGUMENT naming the body or what is wrong; the last
/// frame stays then. After NEARMESH_OUT_OF_MEMORY or NEARMESH_INTERNAL no frame is left, and every
/// later call gives NEARMESH_CONFLICT: destroy the session. So it is with every function that
/// changes a session.
NEARMESH_API nearmesh_status nearmesh_session_update(nearmesh_session* session, uint64_t frame_number,
                                                     double time_s, const nearmesh_body* bodies,
                                                     const nearmesh_motion* motions, size_t count,
                                                     double budget_s, const nearmesh_frame** frame,
                                                     nearmesh_error* error) NEARMESH_NOTHROW;
/// Of the last frame. NULL beyond its answer_count. By the lower body, then the higher.
NEARMESH_API const nearmesh_pair_answer* nearmesh_session_answer(const nearmesh_session* session,
                                                                 size_t index) NEARMESH_NOTHROW;
/// The answer about two bodies, in either order; NULL where it is not listed: then they are free by
/// bounds, or one is unknown, or nobody watches them.
NEARMESH_API const nearmesh_pair_answer* nearmesh_session_find(const nearmesh_session* session,
                                                               nearmesh_body a, nearmesh_body b)
    NEARMESH_NOTHROW;
/// With `contacts`: one for each contact that there is or was until now. Of the last frame. NULL
/// beyond contact_event_count.
NEARMESH_API const nearmesh_contact_event* nearmesh_session_contact_event(
    const nearmesh_session* session, size_t index) NEARMESH_NOTHROW;
/// With watch_all or watch_own: bodies of which nothing is known. Of the last frame. NULL beyond
/// unknown_count.
NEARMESH_API const nearmesh_unknown_body* nearmesh_session_unknown(const nearmesh_session* session,
                                                                   size_t index) NEARMESH_NOTHROW;
/// With discover_bodies: bodies that came, or went, in the last frame. NEARMESH_NONE beyond
/// came_count and went_count.
NEARMESH_API nearmesh_body nearmesh_session_came(const nearmesh_session* session,
                                                 size_t index) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_body nearmesh_session_went(const nearmesh_session* session,
                                                 size_t index) NEARMESH_NOTHROW;
/// One line for a log. NULL beyond complaint_count.
NEARMESH_API const char* nearmesh_session_complaint(const nearmesh_session* session, size_t index)
    NEARMESH_NOTHROW;

// ---- What a session knows -----------------------------------------------------------------------

/// nearmesh_readiness.stage
enum {
  NEARMESH_WAITING = 0,    ///< for some pair of the body nothing can be asked yet
  NEARMESH_ANSWERING = 1,  ///< every pair is asked, some answer is not certified
  NEARMESH_CERTIFIED = 2   ///< every watched pair of the body was certified by the last update
};
/// How far a body is.
typedef struct nearmesh_readiness {
  int32_t stage;
  int32_t reserved;
  uint64_t pairs, certified;  ///< watched pairs of the body, and how many are certified
  const char* reason;         ///< of the first pair that is least far; empty when certified
} nearmesh_readiness;
/// As of the last update.
/// Out: valid until the next call of this or nearmesh_session_wait_ready(). Errors:
/// NEARMESH_NOT_FOUND.
NEARMESH_API nearmesh_status nearmesh_session_readiness(nearmesh_session* session,
                                                        nearmesh_body body,
                                                        const nearmesh_readiness** readiness,
                                                        nearmesh_error* error) NEARMESH_NOTHROW;
/// Calls update() each 2 ms until every watched pair of the body is certified, or `timeout_s` is
/// over (0: one update). The one call that blocks. The rest as for nearmesh_session_update(), of
/// which the last is the frame, with the complaints of all.
NEARMESH_API nearmesh_status nearmesh_session_wait_ready(
    nearmesh_session* session, nearmesh_body body, double timeout_s, uint64_t frame_number,
    double time_s, const nearmesh_body* bodies, const nearmesh_motion* motions, size_t count,
    const nearmesh_readiness** readiness, const nearmesh_frame** frame,
    nearmesh_error* error) NEARMESH_NOTHROW;

/// How far a part of a body's model is.
typedef struct nearmesh_region_readiness {
  int32_t resolved;  ///< all that the full mesh has there is here
  int32_t reserved;
  uint64_t unresolved_nodes, missing_vertices;
  double uncertainty_m;  ///< infinite: no header
  const char* reason;    ///< empty when resolved
} nearmesh_region_readiness;
/// Of the box from lo_m to hi_m in the body's model frame.
/// Out: valid until the next call of this.
/// Errors: NEARMESH_NOT_FOUND; NEARMESH_INVALID_ARGUMENT where the box is empty or not finite.
NEARMESH_API nearmesh_status nearmesh_session_region_readiness(
    nearmesh_session* session, nearmesh_body body, const double lo_m[3], const double hi_m[3],
    const nearmesh_region_readiness** readiness, nearmesh_error* error) NEARMESH_NOTHROW;

/// Where a body was last known to be, and how it moves. Errors: NEARMESH_NOT_FOUND, also where no
/// pose has come.
NEARMESH_API nearmesh_status nearmesh_session_motion_of(const nearmesh_session* session,
                                                        nearmesh_body body, nearmesh_motion* motion,
                                                        nearmesh_error* error) NEARMESH_NOTHROW;
/// The body's name.
/// Out: valid until the next call of this. Errors: NEARMESH_NOT_FOUND.
NEARMESH_API nearmesh_status nearmesh_session_name_of(nearmesh_session* session, nearmesh_body body,
                                                      const char** name, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// A body as it was declared, here or by its mover.
typedef struct nearmesh_body_facts {
  const char* name;
  const char* model;
  const char* content;    ///< that it is pinned to, 32 digits; empty: none
  int32_t own, solid;
  uint32_t group, mask;
  double max_speed_mps;   ///< 0: no promises are made of it
} nearmesh_body_facts;
/// Out: valid until the next call of this. Errors: NEARMESH_NOT_FOUND.
NEARMESH_API nearmesh_status nearmesh_session_body_facts(nearmesh_session* session,
                                                         nearmesh_body body,
                                                         const nearmesh_body_facts** facts,
                                                         nearmesh_error* error) NEARMESH_NOTHROW;
/// What is held of a body's model, to be drawn: 9 numbers a face, its three corners, metres, the
/// body's model frame.
typedef struct nearmesh_held_mesh {
  size_t exact_count, coarse_count;
  const double* exact_m;   ///< faces of the full mesh
  const double* coarse_m;  ///< faces that stand for what is missing
} nearmesh_held_mesh;
/// Out: valid until the next call of this. Errors: NEARMESH_NOT_FOUND, also while its header has
/// not come. Cost: some 100 ns a face.
NEARMESH_API nearmesh_status nearmesh_session_held_mesh(nearmesh_session* session,
                                                        nearmesh_body body,
                                                        const nearmesh_held_mesh** mesh,
                                                        nearmesh_error* error) NEARMESH_NOTHROW;
/// The same number while that mesh is the same; 0 where it is not found. Cost: some nanoseconds.
NEARMESH_API uint64_t nearmesh_session_held_state(const nearmesh_session* session,
                                                  nearmesh_body body) NEARMESH_NOTHROW;
/// The header of a body's model.
/// Out: valid until the next call of this. Errors: NEARMESH_NOT_FOUND, also where it has not come.
NEARMESH_API nearmesh_status nearmesh_session_model_facts(nearmesh_session* session,
                                                          nearmesh_body body,
                                                          const nearmesh_model_facts** facts,
                                                          nearmesh_error* error) NEARMESH_NOTHROW;
/// The latest time that a pose of another peer had: for who has no clock of the exercise and
/// follows that of the others.
/// Errors: NEARMESH_NOT_FOUND where none has come.
NEARMESH_API nearmesh_status nearmesh_session_heard_time(const nearmesh_session* session,
                                                         double* time_s, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// Brings the files of cache_folder up to date, as the session's end does. Errors: NEARMESH_IO,
/// NEARMESH_CONFLICT.
NEARMESH_API nearmesh_status nearmesh_session_write_cache(nearmesh_session* session,
                                                          nearmesh_error* error) NEARMESH_NOTHROW;

/// Since the session began.
typedef struct nearmesh_session_stats {
  uint64_t batches, batch_bytes;  ///< of detail that came
  uint64_t header_bytes;
  uint64_t requests, looks_ahead;
  uint64_t sequence_gaps;  ///< batches that never came
  uint64_t audits, audit_bytes, refused_headers;
  uint64_t held_splits, slots, exact_faces, tree_bytes;  ///< now
  uint64_t mesh_bytes;     ///< what whole replicas of the models in use would take
  uint64_t refused_poses;  ///< samples about bodies that a stranger sent in a peer's name
  uint64_t strange_times;  ///< of poses and promises, that no clock of an exercise has
} nearmesh_session_stats;
/// Out: valid until the next call of this. Errors: NEARMESH_INVALID_ARGUMENT.
NEARMESH_API nearmesh_status nearmesh_session_get_stats(nearmesh_session* session,
                                                        const nearmesh_session_stats** stats,
                                                        nearmesh_error* error) NEARMESH_NOTHROW;

// ---- Probes -------------------------------------------------------------------------------------

// Rays, heights, points, balls and boxes against one body: certified, or uncertain. What they mean:
// core/query/probe.hpp.

/// status of the answers to probes
enum {
  NEARMESH_MISS = 0,             ///< certified: nothing of the full mesh is met
  NEARMESH_HIT = 1,              ///< certified
  NEARMESH_PROBE_UNCERTAIN = 2   ///< what is missing may be met
};

/// From a point of the world in a direction of any length, as far as range_m, which may be
/// INFINITY. Straight down: 0, 0, -1.
typedef struct nearmesh_ray {
  double origin_m[3];
  double direction[3];
  double range_m;
} nearmesh_ray;
/// The first face that a ray meets.
typedef struct nearmesh_ray_answer {
  int32_t status;
  /// A face is known that is met; uncertain: what is missing may be met before it.
  int32_t has_face;
  /// Nothing is met before; hit: the distance of the face but for rounding. Miss: infinite.
  double at_least_m;
  double at_most_m;      ///< something is met by then; hit: the distance of the face
  double point_m[3];     ///< world; where has_face
  /// Of the face, where its corners run counter-clockwise; 0, 0, 0: it has none.
  double normal[3];
  nearmesh_face face;
  uint32_t missing;      ///< nodes whose detail this answer lacks
  uint32_t reserved;
} nearmesh_ray_answer;

/// Whether a point lies in a solid.
typedef struct nearmesh_point_answer {
  int32_t status;        ///< hit: inside, or on the surface
  int32_t on_surface;
  uint32_t missing;
  uint32_t reserved;
} nearmesh_point_answer;

typedef struct nearmesh_ball {
  double center_m[3];
  double radius_m;
} nearmesh_ball;
/// About the origin of its own frame.
typedef struct nearmesh_box {
  nearmesh_pose pose;
  double half_m[3];
} nearmesh_box;
/// Whether a ball or a box, filled, meets a surface.
typedef struct nearmesh_shape_answer {
  int32_t status;
  int32_t has_face;      ///< 0 for a hit: a part of the body is inside the box
  nearmesh_face face;    ///< one that is met
  uint32_t missing;
  uint32_t reserved;
} nearmesh_shape_answer;

/// What probes of a body were answered from.
typedef struct nearmesh_probe_report {
  const char* reason;    ///< why nothing can be said, so that every answer is uncertain; else empty
  const char* awaited;   ///< some lack detail: of which model, and who sends it; else empty
  double age_s;          ///< of the pose
  nearmesh_pose pose;    ///< where the body was taken to be; meaningless with a reason
  uint64_t missing;      ///< nodes that are missing, of all answers together
} nearmesh_probe_report;

/// Probes of a body where it was as of the last update. What they lack the next updates ask for:
/// probe, update, probe again.
/// In: `count` probes. Out: as many answers; `report`, which may be NULL, valid until the next
/// probe of this session.
/// Errors: NEARMESH_NOT_FOUND; NEARMESH_INVALID_ARGUMENT naming the probe, or for points in a body
/// whose model is open.
NEARMESH_API nearmesh_status nearmesh_session_probe_rays(
    nearmesh_session* session, nearmesh_body body, const nearmesh_ray* rays, size_t count,
    nearmesh_ray_answer* answers, const nearmesh_probe_report** report,
    nearmesh_error* error) NEARMESH_NOTHROW;
/// `points_m`: 3 numbers a point.
NEARMESH_API nearmesh_status nearmesh_session_probe_points(
    nearmesh_session* session, nearmesh_body body, const double* points_m, size_t count,
    nearmesh_point_answer* answers, const nearmesh_probe_report** report,
    nearmesh_error* error) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_status nearmesh_session_probe_balls(
    nearmesh_session* session, nearmesh_body body, const nearmesh_ball* balls, size_t count,
    nearmesh_shape_answer* answers, const nearmesh_probe_report** report,
    nearmesh_error* error) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_status nearmesh_session_probe_boxes(
    nearmesh_session* session, nearmesh_body body, const nearmesh_box* boxes, size_t count,
    nearmesh_shape_answer* answers, const nearmesh_probe_report** report,
    nearmesh_error* error) NEARMESH_NOTHROW;

/// The same of a file at hand, in a place: certified, as detail is read where answers need it, and
/// kept for later ones. (A box that holds a part of a model of more than 256 parts stays
/// uncertain.)
/// Errors: NEARMESH_INVALID_ARGUMENT naming the probe or the pose; NEARMESH_CORRUPT, NEARMESH_IO.
NEARMESH_API nearmesh_status nearmesh_model_probe_rays(
    nearmesh_model* model, const nearmesh_pose* pose, const nearmesh_ray* rays, size_t count,
    nearmesh_ray_answer* answers, nearmesh_error* error) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_status nearmesh_model_probe_points(
    nearmesh_model* model, const nearmesh_pose* pose, const double* points_m, size_t count,
    nearmesh_point_answer* answers, nearmesh_error* error) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_status nearmesh_model_probe_balls(
    nearmesh_model* model, const nearmesh_pose* pose, const nearmesh_ball* balls, size_t count,
    nearmesh_shape_answer* answers, nearmesh_error* error) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_status nearmesh_model_probe_boxes(
    nearmesh_model* model, const nearmesh_pose* pose, const nearmesh_box* boxes, size_t count,
    nearmesh_shape_answer* answers, nearmesh_error* error) NEARMESH_NOTHROW;

/// A world of tiles on disk, made by `nearmesh-model build-world` (docs/worlds.md), as if it were
/// one mesh.
typedef struct nearmesh_world nearmesh_world;
/// Holds at most `most_tiles` tiles open, the least recently used going first; 0: 64.
/// Errors: NEARMESH_NOT_FOUND (no world's record is there), NEARMESH_IO, NEARMESH_CORRUPT,
/// NEARMESH_UNSUPPORTED, naming the file.
NEARMESH_API nearmesh_status nearmesh_world_open(const char* folder, size_t most_tiles,
                                                 nearmesh_world** world,
                                                 nearmesh_error* error) NEARMESH_NOTHROW;
/// NULL: nothing.
NEARMESH_API void nearmesh_world_close(nearmesh_world* world) NEARMESH_NOTHROW;
/// Probes of a world in a place: certified. Faces are the tile's; `tiles` says whose, and may be
/// NULL. There are no probes of points, since tiles are not closed: to learn whether a point is
/// below a ground, send a ray.
/// Errors: NEARMESH_INVALID_ARGUMENT naming the probe or the pose; NEARMESH_CORRUPT, NEARMESH_IO,
/// NEARMESH_CONFLICT, naming a file; NEARMESH_OUT_OF_MEMORY. What was read of tiles is forgotten
/// after the latter ones, and the world may be asked again.
NEARMESH_API nearmesh_status nearmesh_world_probe_rays(
    nearmesh_world* world, const nearmesh_pose* pose, const nearmesh_ray* rays, size_t count,
    nearmesh_ray_answer* answers, nearmesh_world_tile* tiles, nearmesh_error* error) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_status nearmesh_world_probe_balls(
    nearmesh_world* world, const nearmesh_pose* pose, const nearmesh_ball* balls, size_t count,
    nearmesh_shape_answer* answers, nearmesh_world_tile* tiles,
    nearmesh_error* error) NEARMESH_NOTHROW;
NEARMESH_API nearmesh_status nearmesh_world_probe_boxes(
    nearmesh_world* world, const nearmesh_pose* pose, const nearmesh_box* boxes, size_t count,
    nearmesh_shape_answer* answers, nearmesh_world_tile* tiles,
    nearmesh_error* error) NEARMESH_NOTHROW;

/// Poses of bodies that others move, as the host heard them on a topic of its own: the next update
/// takes them in, they age as those of the bus, and are not sent again. `times_s`: for when each
/// holds, on the exercise's clock.
/// Errors: NEARMESH_NOT_FOUND, NEARMESH_INVALID_ARGUMENT (an own body, a motion, a time); nothing
/// is taken then.
NEARMESH_API nearmesh_status nearmesh_session_hear(nearmesh_session* session,
                                                   const nearmesh_body* bodies,
                                                   const double* times_s,
                                                   const nearmesh_motion* motions, size_t count,
                                                   nearmesh_error* error) NEARMESH_NOTHROW;

// ---- Recordings ---------------------------------------------------------------------------------

/// A recording, all its parts in turn, also while it is being written. Reads forward from a place
/// that can be set.
typedef struct nearmesh_recording nearmesh_recording;

typedef struct nearmesh_recording_facts {
  uint64_t session;        ///< the same in all parts
  uint32_t parts;
  uint32_t wire_version;
  const char* prefix;      ///< of the topics' names
  const char* idl;         ///< text of the types, for who decodes the bytes
  int64_t message_count;   ///< when it was opened; messages are numbered from 1
  /// When the first and the last came, since 1970; 0 where there is none.
  int64_t begin_ns, end_ns;
  uint64_t topic_count, writer_count, gap_count, model_count;
} nearmesh_recording_facts;

/// A sample as it was on the wire.
typedef struct nearmesh_recorded_message {
  int64_t id;
  const char* topic;
  const char* type;
  const char* partition;  ///< empty for none
  uint8_t writer[16];     ///< GUID of the endpoint
  uint64_t sequence;      ///< of its writer
  int64_t received_ns;    ///< since 1970, by the recorder's clock
  int64_t source_ns;      ///< since 1970, by the writer's clock
  size_t cdr_bytes;
  const uint8_t* cdr;     ///< with its encapsulation
} nearmesh_recorded_message;

/// An answer that a peer reported.
typedef struct nearmesh_recorded_report {
  int64_t id;             ///< of the message
  int64_t received_ns;
  uint64_t peer;
  const char* body_a;
  const char* body_b;
  uint64_t frame;
  double time_s;          ///< of the frame, on the exercise's clock
  int32_t status;         ///< NEARMESH_FREE and so on
  int32_t asked;          ///< 0: a header or a fresh pose was missing
  double clearance_m;     ///< lower bound, when free or contained
  double uncertainty_m;   ///< when uncertain
  uint64_t pair_total;    ///< how many touch
  uint64_t answer_digest;
  size_t pair_count;      ///< the first of them, 64 at most
  const nearmesh_face_pair* pairs;
  int32_t put_off;        ///< not asked: its turn did not come within the frame's budget
  int32_t cut;            ///< the host's options ended the answer (any, max_pairs, max_tests)
} nearmesh_recorded_report;

/// Errors: NEARMESH_NOT_FOUND; NEARMESH_CORRUPT where it is no recording, or a damaged one;
/// NEARMESH_UNSUPPORTED for a later version; NEARMESH_IO.
NEARMESH_API nearmesh_status nearmesh_recording_open(const char* path, nearmesh_recording** recording,
                                                     nearmesh_error* error) NEARMESH_NOTHROW;
/// NULL: nothing.
NEARMESH_API void nearmesh_recording_close(nearmesh_recording* recording) NEARMESH_NOTHROW;
/// Valid until the recording is closed. NULL for no recording.
NEARMESH_API const nearmesh_recording_facts* nearmesh_recording_get_facts(
    const nearmesh_recording* recording) NEARMESH_NOTHROW;
/// The next message is the one of this number, from 1; beyond the last one: none. Errors:
/// NEARMESH_INVALID_ARGUMENT below 1.
NEARMESH_API nearmesh_status nearmesh_recording_seek(nearmesh_recording* recording, int64_t id,
                                                     nearmesh_error* error) NEARMESH_NOTHROW;
/// The next message is the first that came at this time or later. Errors: NEARMESH_CORRUPT,
/// NEARMESH_IO.
NEARMESH_API nearmesh_status nearmesh_recording_seek_time(nearmesh_recording* recording,
                                                          int64_t received_ns, nearmesh_error* error)
    NEARMESH_NOTHROW;
/// Out: `message`, valid until the next call with this recording; NULL after the last one.
/// Errors: NEARMESH_CORRUPT, NEARMESH_IO; the place stays then.
NEARMESH_API nearmesh_status nearmesh_recording_next(nearmesh_recording* recording,
                                                     const nearmesh_recorded_message** message,
                                                     nearmesh_error* error) NEARMESH_NOTHROW;
/// The next message that is a report of an answer; others are passed over, and so are reports that
/// do not decode.
/// Out: `report`, valid until the next call with this recording; NULL after the last one.
/// Errors: NEARMESH_CORRUPT, NEARMESH_IO; NEARMESH_UNSUPPORTED for a recording of another wire
/// version, and where the library was built without DDS, whose codec this needs.
NEARMESH_API nearmesh_status nearmesh_recording_next_report(nearmesh_recording* recording,
                                                            const nearmesh_recorded_report** report,
                                                            nearmesh_error* error) NEARMESH_NOTHROW;

#ifdef __cplusplus
}
#endif

#endif  // NEARMESH_H
