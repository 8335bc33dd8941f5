// SPDX-License-Identifier: Apache-2.0
#include "child.hpp"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <mutex>

namespace nearmesh::meshio {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kCanLimitMemory = false;
#else
constexpr bool kCanLimitMemory = true;
#endif

/// What goes over the pipe: this, the message or the grid, the positions, the faces, the parts,
/// their names.
struct Preamble {
  std::uint32_t code = 0;
  std::uint32_t message_size = 0;
  std::uint64_t position_count = 0;
  std::uint64_t face_count = 0;
  std::uint64_t part_count = 0;
  FileConvention convention;
  bool has_terrain = false;
};
/// An ImportedTerrain, then the name of its coordinates.
struct TerrainRecord {
  std::uint64_t columns = 0, rows = 0, posts_without_data = 0;
  double fill = 0, unmatched_nodata = 0;
  bool has_fill = false, has_unmatched_nodata = false, height_unit_is_assumed = false;
  TerrainFrame frame = TerrainFrame::kFile;
  std::array<double, 2> enu_origin_deg{};
  std::uint32_t name_size = 0;
};
struct PartRecord {
  Transform to_file;
  std::uint64_t position_count = 0, face_count = 0, name_size = 0;
};
constexpr std::uint32_t kMostMessage = 1 << 16;

Status io_error(const char* action) {
  return {StatusCode::kIo, std::string("cannot ") + action + ": " + std::strerror(errno)};
}

// --- the child's side ---

void set_limits(const ChildLimits& limits) {
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (!kCanLimitMemory) return;
  // The child starts with the parent's address space, which may be large already.
  std::uint64_t pages = 0;
  if (std::FILE* statm = std::fopen("/proc/self/statm", "r")) {
    unsigned long found = 0;
    if (std::fscanf(statm, "%lu", &found) == 1) pages = found;
    std::fclose(statm);
  }
  const std::uint64_t held = pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  const rlimit space{held + limits.memory_bytes, held + limits.memory_bytes};
  setrlimit(RLIMIT_AS, &space);
}

bool write_all(int pipe, const void* data, std::size_t size) {
  const char* at = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t written = write(pipe, at, size);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    at += written;
    size -= static_cast<std::size_t>(written);
  }
  return true;
}

Result<SceneMesh> run_guarded(const std::function<Result<SceneMesh>()>& reader) {
  try {
    return reader();
  } catch (const std::bad_alloc&) {
    return Status(StatusCode::kCorrupt,
                  "the reader needs more memory than a file of this size should: export it in "
                  "another format");
  } catch (const std::exception& e) {
    return Status(StatusCode::kCorrupt, std::string("the reader failed: ") + e.what());
  } catch (...) {
    return Status(StatusCode::kCorrupt, "the reader failed");
  }
}

[[noreturn]] void run_child(int pipe, const std::function<Result<SceneMesh>()>& reader,
                            const ChildLimits& limits) {
  set_limits(limits);
  const Result<SceneMesh> result = run_guarded(reader);
  Preamble preamble;
  bool sent = false;
  if (result.is_ok()) {
    const IndexedMesh& mesh = result.value().mesh;
    const std::vector<ScenePart>& parts = result.value().parts;
    preamble.position_count = mesh.positions_m.size();
    preamble.face_count = mesh.faces.size();
    preamble.part_count = parts.size();
    preamble.convention = result.value().convention;
    const ImportedTerrain terrain = result.value().terrain.value_or(ImportedTerrain{});
    preamble.has_terrain = result.value().terrain.has_value();
    const std::string crs = terrain.stated_crs.substr(0, kMostMessage);
    const TerrainRecord terrain_record{terrain.columns,
                                       terrain.rows,
                                       terrain.posts_without_data,
                                       terrain.fill.value_or(0),
                                       terrain.unmatched_nodata.value_or(0),
                                       terrain.fill.has_value(),
                                       terrain.unmatched_nodata.has_value(),
                                       terrain.height_unit_is_assumed,
                                       terrain.frame,
                                       terrain.enu_origin_deg,
                                       static_cast<std::uint32_t>(crs.size())};
    std::vector<PartRecord> records;
    std::string names;
    for (const ScenePart& part : parts) {
      records.push_back({part.to_file, part.position_count, part.face_count, part.name.size()});
      names += part.name;
    }
    sent = write_all(pipe, &preamble, sizeof preamble) &&
           write_all(pipe, &terrain_record, sizeof terrain_record) &&
           write_all(pipe, crs.data(), crs.size()) &&
           write_all(pipe, mesh.positions_m.data(),
                     mesh.positions_m.size() * sizeof mesh.positions_m[0]) &&
           write_all(pipe, mesh.faces.data(), mesh.faces.size() * sizeof mesh.faces[0]) &&
           write_all(pipe, records.data(), records.size() * sizeof records[0]) &&
           write_all(pipe, names.data(), names.size());
  } else {
    const std::string message = result.status().message().substr(0, kMostMessage);
    preamble.code = static_cast<std::uint32_t>(result.status().code());
    preamble.message_size = static_cast<std::uint32_t>(message.size());
    sent = write_all(pipe, &preamble, sizeof preamble) &&
           write_all(pipe, message.data(), message.size());
  }
  // Not exit(): the parent's buffers and static objects are not the child's to flush and destroy.
  _exit(sent ? 0 : 1);
}

// --- the parent's side ---

enum class ReadOutcome : std::uint8_t { kDone, kEnded, kTimedOut, kMalformed };

class PipeReader {
 public:
  PipeReader(int pipe, std::chrono::seconds wall_time)
      : pipe_(pipe), deadline_(std::chrono::steady_clock::now() + wall_time) {}

  ReadOutcome read_all(void* data, std::size_t size) {
    char* at = static_cast<char*>(data);
    while (size > 0) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
          deadline_ - std::chrono::steady_clock::now());
      if (left.count() <= 0) return ReadOutcome::kTimedOut;
      pollfd waiting{pipe_, POLLIN, 0};
      const int ready =
          poll(&waiting, 1, static_cast<int>(std::min<std::int64_t>(left.count(), 60000)));
      if (ready < 0 && errno != EINTR) return ReadOutcome::kEnded;
      if (ready <= 0) continue;
      const ssize_t got = read(pipe_, at, size);
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return ReadOutcome::kEnded;
      at += got;
      size -= static_cast<std::size_t>(got);
    }
    return ReadOutcome::kDone;
  }

 private:
  int pipe_;
  std::chrono::steady_clock::time_point deadline_;
};

bool is_sound(const FileConvention& convention) {
  return std::isfinite(convention.unit_m) && convention.unit_m > 0 &&
         convention.unit_source <= OriginSource::kOption && convention.up <= UpAxis::kZ &&
         convention.up_source <= OriginSource::kOption;
}

ReadOutcome receive_parts(PipeReader& pipe, std::uint64_t count, const ChildLimits& limits,
                          SceneMesh& scene) {
  std::vector<PartRecord> records(count);
  if (const auto got = pipe.read_all(records.data(), records.size() * sizeof records[0]);
      got != ReadOutcome::kDone)
    return got;
  std::uint64_t positions = 0, faces = 0, names = 0;
  for (const PartRecord& record : records) {
    if (record.position_count > scene.mesh.positions_m.size() - positions ||
        record.face_count > scene.mesh.faces.size() - faces ||
        record.name_size > limits.memory_bytes - names)
      return ReadOutcome::kMalformed;
    positions += record.position_count;
    faces += record.face_count;
    names += record.name_size;
    ScenePart& part = scene.parts.emplace_back();
    part.to_file = record.to_file;
    part.position_count = record.position_count;
    part.face_count = record.face_count;
    part.name.resize(record.name_size);
  }
  if (count > 0 && (positions != scene.mesh.positions_m.size() || faces != scene.mesh.faces.size()))
    return ReadOutcome::kMalformed;
  for (ScenePart& part : scene.parts)
    if (const auto got = pipe.read_all(part.name.data(), part.name.size());
        got != ReadOutcome::kDone)
      return got;
  return ReadOutcome::kDone;
}

ReadOutcome receive_terrain(PipeReader& pipe, bool has_terrain, SceneMesh& scene) {
  TerrainRecord record;
  if (const auto got = pipe.read_all(&record, sizeof record); got != ReadOutcome::kDone) return got;
  if (record.frame > TerrainFrame::kEcef || record.name_size > kMostMessage)
    return ReadOutcome::kMalformed;
  ImportedTerrain terrain{.columns = record.columns,
                          .rows = record.rows,
                          .posts_without_data = record.posts_without_data,
                          .height_unit_is_assumed = record.height_unit_is_assumed,
                          .frame = record.frame,
                          .enu_origin_deg = record.enu_origin_deg,
                          .stated_crs = std::string(record.name_size, '\0')};
  if (record.has_fill) terrain.fill = record.fill;
  if (record.has_unmatched_nodata) terrain.unmatched_nodata = record.unmatched_nodata;
  const auto got = pipe.read_all(terrain.stated_crs.data(), terrain.stated_crs.size());
  if (has_terrain) scene.terrain = std::move(terrain);
  return got;
}

/// Trusts no count of the child, which may have been talked into anything by the file.
ReadOutcome receive(PipeReader& pipe, const ChildLimits& limits, Status& status, SceneMesh& scene) {
  Preamble preamble;
  if (const auto got = pipe.read_all(&preamble, sizeof preamble); got != ReadOutcome::kDone)
    return got;
  if (preamble.code != static_cast<std::uint32_t>(StatusCode::kOk)) {
    if (preamble.code > static_cast<std::uint32_t>(StatusCode::kConflict) ||
        preamble.message_size > kMostMessage)
      return ReadOutcome::kMalformed;
    std::string message(preamble.message_size, '\0');
    const auto got = pipe.read_all(message.data(), message.size());
    status = Status(static_cast<StatusCode>(preamble.code), std::move(message));
    return got;
  }
  IndexedMesh& mesh = scene.mesh;
  if (preamble.position_count > limits.memory_bytes / sizeof mesh.positions_m[0] ||
      preamble.face_count > limits.memory_bytes / sizeof mesh.faces[0] ||
      preamble.part_count > limits.memory_bytes / sizeof(PartRecord) ||
      !is_sound(preamble.convention))
    return ReadOutcome::kMalformed;
  scene.convention = preamble.convention;
  auto got = receive_terrain(pipe, preamble.has_terrain, scene);
  if (got != ReadOutcome::kDone) return got;
  mesh.positions_m.resize(preamble.position_count);
  mesh.faces.resize(preamble.face_count);
  got =
      pipe.read_all(mesh.positions_m.data(), mesh.positions_m.size() * sizeof mesh.positions_m[0]);
  if (got != ReadOutcome::kDone) return got;
  got = pipe.read_all(mesh.faces.data(), mesh.faces.size() * sizeof mesh.faces[0]);
  if (got != ReadOutcome::kDone) return got;
  return receive_parts(pipe, preamble.part_count, limits, scene);
}

/// A started child and the reading end of its pipe; neither outlives this.
class Child {
 public:
  Child(pid_t id, int pipe) : id_(id), pipe_(pipe) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (id_ > 0) stop();
    close(pipe_);
  }

  /// Ends it, should it still run (it may wait for a reader of its pipe), and says how it ended:
  /// one that has crashed before keeps its own signal.
  std::string stop() {
    kill(id_, SIGKILL);
    int state = 0;
    pid_t got = 0;
    do {
      got = waitpid(id_, &state, 0);
    } while (got < 0 && errno == EINTR);
    const bool crashed = got == id_ && WIFSIGNALED(state);
    id_ = -1;
    return crashed ? std::string("crashed (") + strsignal(WTERMSIG(state)) + ")"
                   : "ended without an answer";
  }

 private:
  pid_t id_;
  int pipe_;
};

}  // namespace

Result<SceneMesh> run_in_child(const std::function<Result<SceneMesh>()>& reader,
                               const ChildLimits& limits) {
  int ends[2] = {-1, -1};
  pid_t child = -1;
  {
    // One at a time, or another thread's child would inherit this pipe's writing end and keep it
    // open.
    static std::mutex forking;
    const std::lock_guard lock(forking);
    if (pipe2(ends, O_CLOEXEC) != 0) return io_error("make a pipe");
    child = fork();
    if (child == 0) {
      close(ends[0]);
      run_child(ends[1], reader, limits);
    }
    close(ends[1]);
  }
  if (child < 0) {
    const Status failed = io_error("start a process");
    close(ends[0]);
    return failed;
  }

  Child running(child, ends[0]);
  PipeReader pipe(ends[0], limits.wall_time);
  Status status;
  SceneMesh scene;
  const ReadOutcome outcome = receive(pipe, limits, status, scene);
  if (outcome == ReadOutcome::kTimedOut)
    return Status(StatusCode::kCorrupt, "the reader was stopped after " +
                                            std::to_string(limits.wall_time.count()) +
                                            " s: export it in another format, or in parts");
  if (outcome == ReadOutcome::kEnded)
    return Status(StatusCode::kCorrupt, "the reader " + running.stop());
  if (outcome == ReadOutcome::kMalformed)
    return Status(
        StatusCode::kCorrupt,
        "the reader gave more than a file of this size should hold: export it in another format");
  NEARMESH_RETURN_IF_ERROR(status);
  return scene;
}

}  // namespace nearmesh::meshio
