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

/// What goes over the pipe: this, the message, the positions, the faces.
struct Preamble {
  std::uint32_t code = 0;
  std::uint32_t message_size = 0;
  std::uint64_t position_count = 0;
  std::uint64_t face_count = 0;
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

Result<IndexedMesh> run_guarded(const std::function<Result<IndexedMesh>()>& reader) {
  try {
    return reader();
  } catch (const std::bad_alloc&) {
    return Status(StatusCode::kCorrupt,
                  "the reader needs more memory than a file of this size should");
  } catch (const std::exception& e) {
    return Status(StatusCode::kCorrupt, std::string("the reader failed: ") + e.what());
  } catch (...) {
    return Status(StatusCode::kCorrupt, "the reader failed");
  }
}

[[noreturn]] void run_child(int pipe, const std::function<Result<IndexedMesh>()>& reader,
                            const ChildLimits& limits) {
  set_limits(limits);
  const Result<IndexedMesh> result = run_guarded(reader);
  Preamble preamble;
  bool sent = false;
  if (result.is_ok()) {
    const IndexedMesh& mesh = result.value();
    preamble.position_count = mesh.positions_m.size();
    preamble.face_count = mesh.faces.size();
    sent = write_all(pipe, &preamble, sizeof preamble) &&
           write_all(pipe, mesh.positions_m.data(),
                     mesh.positions_m.size() * sizeof mesh.positions_m[0]) &&
           write_all(pipe, mesh.faces.data(), mesh.faces.size() * sizeof mesh.faces[0]);
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

/// Trusts no count of the child, which may have been talked into anything by the file.
ReadOutcome receive(PipeReader& pipe, const ChildLimits& limits, Status& status,
                    IndexedMesh& mesh) {
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
  if (preamble.position_count > limits.memory_bytes / sizeof mesh.positions_m[0] ||
      preamble.face_count > limits.memory_bytes / sizeof mesh.faces[0])
    return ReadOutcome::kMalformed;
  mesh.positions_m.resize(preamble.position_count);
  mesh.faces.resize(preamble.face_count);
  const auto got =
      pipe.read_all(mesh.positions_m.data(), mesh.positions_m.size() * sizeof mesh.positions_m[0]);
  if (got != ReadOutcome::kDone) return got;
  return pipe.read_all(mesh.faces.data(), mesh.faces.size() * sizeof mesh.faces[0]);
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

Result<IndexedMesh> run_in_child(const std::function<Result<IndexedMesh>()>& reader,
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
  IndexedMesh mesh;
  const ReadOutcome outcome = receive(pipe, limits, status, mesh);
  if (outcome == ReadOutcome::kTimedOut)
    return Status(StatusCode::kCorrupt, "the reader was stopped after " +
                                            std::to_string(limits.wall_time.count()) + " s");
  if (outcome == ReadOutcome::kEnded)
    return Status(StatusCode::kCorrupt, "the reader " + running.stop());
  if (outcome == ReadOutcome::kMalformed)
    return Status(StatusCode::kCorrupt,
                  "the reader gave more than a file of this size should hold");
  NEARMESH_RETURN_IF_ERROR(status);
  return mesh;
}

}  // namespace nearmesh::meshio
