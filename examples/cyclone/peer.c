// SPDX-License-Identifier: Apache-2.0
// cyclone_peer [options]: a look at a nearmesh bus through Eclipse Cyclone DDS, with the types of the installed nearmesh.idl.
// Prints what publishers announce, which bodies there are, where they are or are promised to stay, and each contact report's status as
// it comes. With --model it answers itself, of the whole files, at the poses that it heard, and says whether it agrees. With --own it
// moves a body, so that nearmesh's peers answer about it. It asks for no detail.
#include <dds/dds.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "geometry.h"
#include "nearmesh.h"  // made by idlc from nearmesh.idl

typedef nearmesh_wire_types_HelloSample Hello;
typedef nearmesh_wire_types_BodyDirectorySample Directory;
typedef nearmesh_wire_types_BodyPosesSample Poses;
typedef nearmesh_wire_types_BodyPromisesSample Promises;
typedef nearmesh_wire_types_WantedPosesSample Wanted;
typedef nearmesh_wire_types_ContactReportSample Report;

enum {
  kWireVersion =
      15,  // of the nearmesh.idl that this was written for: nearmesh-subscriber --version
  kNumbersOfMotion = 19,  // time, rotation (9), translation (3), linear and angular velocity
  kNumbersOfPose = 12,    // rotation (9), translation (3)
  kBodiesOfPart = 7,
  kBodiesOfPromise = 32,
  kMaxKnown = 256,
  kMaxWantedParts = 256,
  kPosesKept = 64  // of each body, for reports about them
};

static const char* const kStatus[] = {"free", "contact", "partial", "uncertain", "contained"};

static volatile sig_atomic_t is_stopped;
static void stop(int number) {
  (void)number;
  is_stopped = 1;
}

static dds_entity_t made(dds_entity_t entity, const char* what) {
  if (entity >= 0) return entity;
  fprintf(stderr, "cyclone_peer: %s: %s\n", what, dds_strretcode(-entity));
  exit(1);
}

// ---- Options

typedef struct Options {
  dds_domainid_t domain;
  const char* prefix;
  double seconds;           // 0: until it is stopped
  const char *own, *model;  // body to be moved, and its model's name; NULL for none
  const char* file;         // of that model: its content is pinned; NULL: whatever is served
  double from_m[3], to_m[3];
  double flight_s;
  int wants;  // full poses of all bodies of which only promises are made
} Options;

static void usage(void) {
  fprintf(stderr,
          "usage: cyclone_peer [--domain N] [--prefix TEXT] [--seconds S] [--model FILE.spm]... "
          "[--want]\n"
          "                    [--own BODY MODEL [--pin FILE.spm] --from X Y Z --to X Y Z --flight "
          "S]\n");
  exit(2);
}

static double number(const char* word) {
  char* end = NULL;
  const double value = word ? strtod(word, &end) : NAN;
  if (!word || end == word || *end != 0 || !isfinite(value)) usage();
  return value;
}

static Options parse(char** words) {
  Options options = {.prefix = "nearmesh", .flight_s = 10};
  for (; *words; ++words) {
    const char* const option = *words;
    double* place = NULL;
    if (!strcmp(option, "--domain") && words[1]) {
      options.domain = (dds_domainid_t)number(*++words);
    } else if (!strcmp(option, "--prefix") && words[1]) {
      options.prefix = *++words;
    } else if (!strcmp(option, "--seconds")) {
      options.seconds = number(*++words);
    } else if (!strcmp(option, "--flight")) {
      options.flight_s = number(*++words);
    } else if (!strcmp(option, "--model") && words[1]) {
      uint64_t content[2];
      if (!open_model(*++words, content)) exit(1);
    } else if (!strcmp(option, "--want")) {
      options.wants = 1;
    } else if (!strcmp(option, "--pin") && words[1]) {
      options.file = *++words;
    } else if (!strcmp(option, "--own") && words[1] && words[2]) {
      options.own = *++words;
      options.model = *++words;
    } else if (!strcmp(option, "--from")) {
      place = options.from_m;
    } else if (!strcmp(option, "--to")) {
      place = options.to_m;
    } else {
      usage();
    }
    for (int axis = 0; place && axis < 3; ++axis) place[axis] = number(words[1]), ++words;
  }
  // A name travels with its end of line, and is at most 63 bytes long.
  if (options.own && (strlen(options.own) > 63 || strlen(options.model) > 63)) usage();
  if (options.flight_s <= 0) usage();
  return options;
}

// ---- Topics: names and QoS as docs/operate.md and nearmesh's table of topics have them

typedef struct Bus {
  dds_entity_t participant, hellos, directories, poses, near_poses, promises, reports;
  dds_entity_t own_directory, own_poses, wishes;
} Bus;

static dds_qos_t* delivery(int is_latched, int depth) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  // Latched: who comes later is told what holds.
  dds_qset_durability(qos, is_latched ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, depth);
  return qos;
}

static dds_entity_t topic(dds_entity_t participant, const dds_topic_descriptor_t* type,
                          const char* prefix, const char* name, int is_versioned) {
  char whole[200];
  if (is_versioned)
    snprintf(whole, sizeof whole, "%s/v%d/%s", prefix, kWireVersion, name);
  else
    snprintf(whole, sizeof whole, "%s/%s", prefix, name);
  return made(dds_create_topic(participant, type, whole, NULL, NULL), whole);
}

static Bus join(const Options* options) {
  Bus bus = {0};
  bus.participant = made(dds_create_participant(options->domain, NULL, NULL), "participant");
  // hello alone has no version in its name: a publisher of another version is to be heard, and told from ours.
  const dds_entity_t hello =
      topic(bus.participant, &nearmesh_wire_types_HelloSample_desc, options->prefix, "hello", 0);
  const dds_entity_t directory =
      topic(bus.participant, &nearmesh_wire_types_BodyDirectorySample_desc, options->prefix,
            "body_directory", 1);
  const dds_entity_t poses = topic(bus.participant, &nearmesh_wire_types_BodyPosesSample_desc,
                                   options->prefix, "body_poses", 1);
  // Each mover chooses by a filter of its own who gets which of these, by what each peer wants. Who announces no such filter, as this
  // program, gets all that the mover sends to anybody: nothing while nobody wants a body's poses.
  const dds_entity_t near_poses = topic(bus.participant, &nearmesh_wire_types_BodyPosesSample_desc,
                                        options->prefix, "near_poses", 1);
  const dds_entity_t promises = topic(bus.participant, &nearmesh_wire_types_BodyPromisesSample_desc,
                                      options->prefix, "body_promises", 1);
  const dds_entity_t report = topic(bus.participant, &nearmesh_wire_types_ContactReportSample_desc,
                                    options->prefix, "contact_report", 1);
  dds_qos_t* const latched = delivery(1, 1);
  dds_qos_t* const stream = delivery(0, 1);
  // A look at the bus 20 times a second is to find all that came since the last.
  dds_qos_t* const latched_all = delivery(1, kPosesKept);
  dds_qos_t* const all = delivery(0, kPosesKept);
  bus.hellos = made(dds_create_reader(bus.participant, hello, latched, NULL), "reader of hello");
  bus.directories = made(dds_create_reader(bus.participant, directory, latched, NULL),
                         "reader of body_directory");
  bus.poses =
      made(dds_create_reader(bus.participant, poses, latched_all, NULL), "reader of body_poses");
  bus.near_poses =
      made(dds_create_reader(bus.participant, near_poses, all, NULL), "reader of near_poses");
  bus.promises =
      made(dds_create_reader(bus.participant, promises, latched, NULL), "reader of body_promises");
  bus.reports =
      made(dds_create_reader(bus.participant, report, all, NULL), "reader of contact_report");
  if (options->own) {
    bus.own_directory = made(dds_create_writer(bus.participant, directory, latched, NULL),
                             "writer of body_directory");
    bus.own_poses =
        made(dds_create_writer(bus.participant, poses, latched, NULL), "writer of body_poses");
  }
  if (options->wants) {
    const dds_entity_t wanted = topic(bus.participant, &nearmesh_wire_types_WantedPosesSample_desc,
                                      options->prefix, "wanted_poses", 1);
    bus.wishes =
        made(dds_create_writer(bus.participant, wanted, stream, NULL), "writer of wanted_poses");
  }
  dds_delete_qos(latched);
  dds_delete_qos(stream);
  dds_delete_qos(latched_all);
  dds_delete_qos(all);
  return bus;
}

// ---- What is heard. Whoever writes on the bus may write anything: counts are checked before they are used

/// The next of names that end with a newline each; 0 where there is none of at most 63 bytes.
static int next_name(const dds_sequence_octet* names, uint32_t* at, char name[64]) {
  const uint32_t begin = *at;
  while (*at < names->_length && names->_buffer[*at] != '\n') ++*at;
  const uint32_t length = *at - begin;
  if (*at == names->_length || length == 0 || length > 63) return 0;
  memcpy(name, names->_buffer + begin, length);
  name[length] = 0;
  ++*at;
  return 1;
}

static void on_hello(const Hello* hello) {
  if (hello->wire_version != kWireVersion) {
    printf("publisher %016" PRIx64 " speaks wire version %d, this program %d\n", hello->publisher,
           hello->wire_version, kWireVersion);
    return;
  }
  printf("publisher %016" PRIx64 " '%s'\n", hello->publisher, hello->name);
  char name[64];
  uint32_t at = 0;
  for (uint32_t i = 0; 2 * i + 1 < hello->content_hashes._length && i < hello->mesh_bytes._length;
       ++i) {
    if (!next_name(&hello->names, &at, name)) break;
    printf("model %s %016" PRIx64 "%016" PRIx64 " %" PRIu64 " bytes\n", name,
           hello->content_hashes._buffer[2 * i], hello->content_hashes._buffer[2 * i + 1],
           hello->mesh_bytes._buffer[i]);
  }
}

/// A body by the peer that moves it and its number: poses say no more. Those beyond kMaxKnown are not followed.
typedef struct Body {
  uint64_t peer;
  uint32_t number;
  char name[64];
  double max_speed_mps;  // 0: its poses go to all; else promises do
  // The poses that were heard last, the next one's place, and how many there were.
  double times_s[kPosesKept], poses[kPosesKept][kNumbersOfPose];
  uint64_t heard;
} Body;
static Body bodies[kMaxKnown];
static int body_count;

static Body* find_body(uint64_t peer, uint32_t number_of_body) {
  for (int i = 0; i < body_count; ++i)
    if (bodies[i].peer == peer && bodies[i].number == number_of_body) return &bodies[i];
  return NULL;
}

static void on_directory(const Directory* directory) {
  uint32_t at = 0, listed = 0;
  if (directory->wire_version != kWireVersion) return;
  for (uint32_t place = 0; place < kBodiesOfPart; ++place) {
    if (!(directory->places >> place & 1)) continue;
    char name[64], model[64];
    if (!next_name(&directory->names, &at, name) || !next_name(&directory->names, &at, model))
      return;
    const uint32_t number_of_body = kBodiesOfPart * directory->part + place;
    Body* body = find_body(directory->peer, number_of_body);
    if (!body && body_count < kMaxKnown) body = &bodies[body_count++];
    if (!body) return;
    body->peer = directory->peer;
    body->number = number_of_body;
    memcpy(body->name, name, sizeof name);
    body->max_speed_mps =
        listed < directory->max_speeds_mps._length ? directory->max_speeds_mps._buffer[listed] : 0;
    ++listed;
    printf("body %s of model %s, moved by %016" PRIx64 "\n", name, model, directory->peer);
  }
}

// The exercise's clock is nobody's: it runs with each peer's own, and who hears a later time goes on from there, as
// nearmesh-subscriber run does. So it never falls behind by more than a pose's way.
static double ahead_s;
static dds_time_t begin;
static double elapsed_s(void) { return (double)(dds_time() - begin) * 1e-9; }

static void on_time(double time_s) {
  // Times are within 3,000 years of 0; others are refused by nearmesh too.
  if (fabs(time_s) <= 1e11) ahead_s = fmax(ahead_s, time_s - elapsed_s());
}

static void on_poses(const Poses* poses) {
  uint32_t at = 0;
  if (poses->wire_version != kWireVersion) return;
  for (uint32_t place = 0; place < kBodiesOfPart; ++place) {
    if (!(poses->places >> place & 1)) continue;
    if (at + kNumbersOfMotion > poses->motions._length) return;
    const double* const motion = poses->motions._buffer + at;
    Body* const body = find_body(poses->peer, kBodiesOfPart * poses->part + place);
    if (body) {
      const uint64_t kept = body->heard++ % kPosesKept;
      body->times_s[kept] = motion[0];
      memcpy(body->poses[kept], motion + 1, sizeof body->poses[kept]);
      printf("pose %s at %.3f s: %.3f %.3f %.3f m\n", body->name, motion[0], motion[10], motion[11],
             motion[12]);
    }
    on_time(motion[0]);
    at += kNumbersOfMotion;
  }
}

/// The next of numbers in groups of seven bits, the lowest first, with the highest bit set in all but the last. 0 where there is none.
static int next_number(const dds_sequence_octet* bytes, uint32_t* at, int64_t* number_at) {
  uint64_t value = 0;
  for (int shift = 0; shift < 63 && *at < bytes->_length; shift += 7) {
    const uint8_t group = bytes->_buffer[(*at)++];
    value |= (uint64_t)(group & 127) << shift;
    if (group & 128) continue;
    *number_at = value & 1 ? -(int64_t)(value >> 1) - 1 : (int64_t)(value >> 1);
    return 1;
  }
  return 0;
}

/// The body stays within its greatest speed times the time since of that place, to the quantum: no pose of it is needed to know that others are far.
static void on_promises(const Promises* promises) {
  enum { kOffset = 64, kStepsOfSecond = 256 };
  const int64_t farthest = (int64_t)1 << 52;
  uint32_t at = 0;
  int64_t quanta[3] = {0, 0, 0};
  if (promises->wire_version != kWireVersion) return;
  on_time(promises->from_s);
  for (uint32_t place = 0; place < kBodiesOfPromise; ++place) {
    if (!(promises->places >> place & 1)) continue;
    for (int axis = 0; axis < 3; ++axis) {
      int64_t step = 0;
      if (!next_number(&promises->bytes, &at, &step) || step > farthest || step < -farthest) return;
      quanta[axis] += step;  // of the body before
      if (quanta[axis] > farthest || quanta[axis] < -farthest) return;
    }
    const Body* const body = find_body(promises->peer, kBodiesOfPromise * promises->part + place);
    if (!body) continue;
    double place_m[3];
    for (int axis = 0; axis < 3; ++axis)
      place_m[axis] = ldexp((double)quanta[axis], promises->quantum - kOffset);
    printf("promise %s from %.3f s for %.3f s: within %.3f m/s of %.3f %.3f %.3f m\n", body->name,
           promises->from_s, promises->steps / (double)kStepsOfSecond, body->max_speed_mps,
           place_m[0], place_m[1], place_m[2]);
  }
}

// ---- An answer of its own, beside the one that is reported

static struct {
  uint64_t own, certified, agreeing, poses_heard, poses_told, poses_differing;
} counts;

/// A report says the pose that it is about, and that pose's time. Out: as it was heard from its mover; NULL where none of that time is
/// among those kept, or the body is in place and nobody moves it. Precondition: `told` is the report's.
static const double* heard_pose(const char* name, double time_s, const double* told) {
  const double* found = NULL;
  for (int i = 0; i < body_count; ++i) {
    if (strcmp(bodies[i].name, name) != 0) continue;
    for (uint64_t k = 0; k < bodies[i].heard && k < kPosesKept; ++k) {
      if (bodies[i].times_s[k] != time_s) continue;
      found = bodies[i].poses[k];
      if (!memcmp(found, told, sizeof bodies[i].poses[k])) return found;
    }
  }
  return found;
}

static void answer_itself(const Report* report) {
  enum { kAsked = 1, kSolidA = 4, kSolidB = 8, kCut = 16, kContained = 4 };
  if (!(report->flags & kAsked)) return;
  double poses[2 * kNumbersOfPose];
  const char* const names[2] = {report->body_a, report->body_b};
  int heard[2], differ[2];
  for (int k = 0; k < 2; ++k) {
    const double* const told = report->poses + kNumbersOfPose * k;
    const double* const pose = heard_pose(names[k], report->pose_times_s[k], told);
    heard[k] = pose != NULL;
    differ[k] = pose && memcmp(pose, told, kNumbersOfPose * sizeof *told) != 0;
    memcpy(poses + kNumbersOfPose * k, pose ? pose : told, kNumbersOfPose * sizeof *told);
  }
  const int is_solid[2] = {(report->flags & kSolidA) != 0, (report->flags & kSolidB) != 0};
  OwnAnswer own;
  if (!ask(report->content_hashes, is_solid, poses, &own)) return;
  ++counts.own;
  for (int k = 0; k < 2; ++k) {
    counts.poses_heard += (uint64_t)(heard[k] && !differ[k]);
    counts.poses_told += (uint64_t)!heard[k];
    counts.poses_differing += (uint64_t)differ[k];
  }
  const int is_certified = report->status <= 1 || report->status == kContained;
  const char* verdict = "the reported one is not certified";
  if (is_certified && own.is_certified && !(report->flags & kCut)) {
    const int agrees = own.digest == report->answer_digest;
    ++counts.certified;
    counts.agreeing += (uint64_t)agrees;
    verdict = agrees ? "agrees" : "DISAGREES";
  }
  printf("own answer frame %" PRIu64 ": %s %s %s, %" PRIu64
         " pairs of faces touch, %.3f m apart at least: %s\n",
         report->frame, names[0], names[1], own.status, own.pair_total, own.clearance_m, verdict);
}

static void on_report(const Report* report) {
  if (report->wire_version != kWireVersion) return;
  if (report->status >= sizeof kStatus / sizeof *kStatus) return;
  printf("answer of %016" PRIx64 " frame %" PRIu64 ": %s %s %s", report->peer, report->frame,
         report->body_a, report->body_b, kStatus[report->status]);
  if (report->status == 0 || report->status == 4)
    printf(", %.3f m apart at least", report->clearance_m);
  if (report->status == 1 || report->status == 2)
    printf(", %" PRIu32 " pairs of faces touch", report->pair_count);
  if (report->status == 3) printf(", unsure within %.3f m", report->uncertainty_m);
  printf("\n");
  answer_itself(report);
}

/// Takes all that has come; use(sample) of each that has data.
#define TAKE_ALL(reader, Type, use)                        \
  do {                                                     \
    void* sample[1] = {NULL};                              \
    dds_sample_info_t info[1];                             \
    while (dds_take(reader, sample, info, 1, 1) > 0) {     \
      if (info[0].valid_data) use((const Type*)sample[0]); \
      dds_return_loan(reader, sample, 1);                  \
    }                                                      \
  } while (0)

// ---- A body of its own

typedef struct Own {
  uint64_t peer;
  uint64_t frame;
} Own;

/// A peer is a random number, never 0.
static Own begin_own(void) {
  Own own = {0, 0};
  FILE* const random = fopen("/dev/urandom", "rb");
  if (!random || fread(&own.peer, sizeof own.peer, 1, random) != 1 || own.peer == 0) {
    fprintf(stderr, "cyclone_peer: no random number\n");
    exit(1);
  }
  fclose(random);
  return own;
}

static void written(dds_return_t code, const char* what) {
  if (code == DDS_RETCODE_OK || code == DDS_RETCODE_TIMEOUT) return;
  fprintf(stderr, "cyclone_peer: %s: %s\n", what, dds_strretcode(-code));
  exit(1);
}

static void write_directory(const Bus* bus, const Options* options, const Own* own) {
  char names[130];
  uint64_t content[2] = {0, 0};  // not pinned
  uint32_t company[2] = {1, 0xffffffffU};
  double any_speed = 0;  // nothing is promised
  if (options->file && !open_model(options->file, content)) exit(1);
  const int length = snprintf(names, sizeof names, "%s\n%s\n", options->own, options->model);
  Directory directory = {.wire_version = kWireVersion, .places = 1, .part = 0, .peer = own->peer};
  directory.names._length = directory.names._maximum = (uint32_t)length;
  directory.names._buffer = (uint8_t*)names;
  directory.content_hashes._length = directory.content_hashes._maximum = 2;
  directory.content_hashes._buffer = content;
  directory.companies._length = directory.companies._maximum = 2;
  directory.companies._buffer = company;
  directory.max_speeds_mps._length = directory.max_speeds_mps._maximum = 1;
  directory.max_speeds_mps._buffer = &any_speed;
  written(dds_write(bus->own_directory, &directory), "body_directory");
}

/// Along a line and then at rest at its end.
static void write_pose(const Bus* bus, const Options* options, Own* own) {
  const double time_s = elapsed_s();
  double motion[kNumbersOfMotion] = {ahead_s + time_s, 1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double share = time_s < options->flight_s ? time_s / options->flight_s : 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double way_m = options->to_m[axis] - options->from_m[axis];
    motion[10 + axis] = options->from_m[axis] + share * way_m;
    motion[13 + axis] = share < 1 ? way_m / options->flight_s : 0;
  }
  Poses poses = {.wire_version = kWireVersion,
                 .places = 1,
                 .part = 0,
                 .peer = own->peer,
                 .frame = own->frame,
                 .sequence_number = (uint32_t)++own->frame};
  poses.motions._length = poses.motions._maximum = kNumbersOfMotion;
  poses.motions._buffer = motion;
  written(dds_write(bus->own_poses, &poses), "body_poses");
}

/// To each mover: of which of its bodies poses are wanted. It forgets that after three seconds.
static void write_wishes(const Bus* bus, const Own* own) {
  for (int first = 0; first < body_count; ++first) {
    const uint64_t mover = bodies[first].peer;
    uint32_t parts[kMaxWantedParts], count = 0;
    uint8_t places[kMaxWantedParts];
    int is_told = mover == own->peer;
    for (int i = 0; i < first; ++i) is_told |= bodies[i].peer == mover;
    if (is_told) continue;
    for (int i = first; i < body_count; ++i) {
      if (bodies[i].peer != mover || bodies[i].max_speed_mps <= 0) continue;
      const uint32_t part = bodies[i].number / kBodiesOfPart;
      uint32_t at = 0;
      while (at < count && parts[at] != part) ++at;
      if (at == kMaxWantedParts) break;
      if (at == count) parts[count] = part, places[count++] = 0;
      places[at] = (uint8_t)(places[at] | 1U << bodies[i].number % kBodiesOfPart);
    }
    if (count == 0) continue;
    Wanted wanted = {.wire_version = kWireVersion, .peer = own->peer, .mover = mover};
    wanted.parts._length = wanted.parts._maximum = count;
    wanted.parts._buffer = parts;
    wanted.places._length = wanted.places._maximum = count;
    wanted.places._buffer = places;
    written(dds_write(bus->wishes, &wanted), "wanted_poses");
  }
}

int main(int argc, char** argv) {
  (void)argc;
  const Options options = parse(argv + 1);
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  setvbuf(stdout, NULL, _IOLBF, 0);
  const Bus bus = join(&options);
  Own own = {0, 0};
  if (options.own || options.wants) own = begin_own();
  if (options.own) write_directory(&bus, &options, &own);
  begin = dds_time();
  double wished_s = -1;
  while (!is_stopped) {
    if (options.seconds > 0 && elapsed_s() > options.seconds) break;
    if (options.own) write_pose(&bus, &options, &own);
    TAKE_ALL(bus.hellos, Hello, on_hello);
    TAKE_ALL(bus.directories, Directory, on_directory);
    TAKE_ALL(bus.poses, Poses, on_poses);
    TAKE_ALL(bus.near_poses, Poses, on_poses);
    TAKE_ALL(bus.promises, Promises, on_promises);
    TAKE_ALL(bus.reports, Report, on_report);
    if (options.wants && elapsed_s() - wished_s > 0.5) {
      wished_s = elapsed_s();
      write_wishes(&bus, &own);
    }
    dds_sleepfor(DDS_MSECS(50));
  }
  made(dds_delete(bus.participant), "leaving");
  close_models();
  printf("own answers: %" PRIu64 "; certified on both sides: %" PRIu64 ", of which %" PRIu64
         " agree; poses: %" PRIu64 " as heard, %" PRIu64 " as told, %" PRIu64
         " otherwise than heard\n",
         counts.own, counts.certified, counts.agreeing, counts.poses_heard, counts.poses_told,
         counts.poses_differing);
  return counts.agreeing == counts.certified && counts.poses_differing == 0 ? 0 : 1;
}
