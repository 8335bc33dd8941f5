// SPDX-License-Identifier: Apache-2.0
#include "room.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <exception>
#include <latch>
#include <thread>

namespace nearmesh::wire {
namespace {

constexpr const char* kSharedFolder = "/dev/shm";

Status too_little(const std::string& what) { return {StatusCode::kIo, "cannot join: " + what}; }

Status try_descriptors() {
  std::vector<int> opened;
  int error = 0;
  while (opened.size() < kRoomDescriptors && error == 0) {
    const int descriptor = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (descriptor >= 0)
      opened.push_back(descriptor);
    else
      error = errno;
  }
  for (const int descriptor : opened) ::close(descriptor);
  if (error == 0) return Status::ok();
  return too_little("it takes " + std::to_string(kRoomDescriptors) + " more open files, only " +
                    std::to_string(opened.size()) + " can be opened (" + std::strerror(error) +
                    "): raise ulimit -n");
}

Status try_memory() {
  void* const block = ::mmap(nullptr, kRoomBytes, PROT_READ | PROT_WRITE,
                             MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (block == MAP_FAILED)
    return too_little("it takes " + std::to_string(kRoomBytes >> 20) + " MiB of memory (" +
                      std::strerror(errno) + "): raise ulimit -v, or free some");
  ::munmap(block, kRoomBytes);
  return Status::ok();
}

/// All at a time, as a participant's are.
Status try_threads() {
  std::vector<std::thread> threads;
  threads.reserve(kRoomThreads);
  std::latch go(1);
  std::string fault;
  try {
    while (threads.size() < kRoomThreads) threads.emplace_back([&go] { go.wait(); });
  } catch (const std::exception& error) {
    fault = error.what();
  }
  go.count_down();
  for (std::thread& thread : threads) thread.join();
  if (fault.empty()) return Status::ok();
  return too_little("it takes " + std::to_string(kRoomThreads) + " threads, only " +
                    std::to_string(threads.size()) + " can be started (" + fault +
                    "): raise ulimit -u or -v, or the limits of the container");
}

Status try_shared_memory() {
  const std::optional<std::uint64_t> bytes = free_shared_memory();
  if (bytes && *bytes >= kRoomSharedBytes) return Status::ok();
  const std::string other = ", or use --transport lan --interface 127.0.0.1 on both sides";
  if (!bytes)
    return too_little("same-host needs " + std::string(kSharedFolder) +
                      ", which is not there or cannot be written" + other);
  return too_little("same-host takes " + std::to_string(kRoomSharedBytes >> 10) + " KiB of " +
                    kSharedFolder + ", where " + std::to_string(*bytes >> 10) +
                    " KiB are free: make it larger (mount -o remount,size=64M " + kSharedFolder +
                    "; docker run --shm-size)" + other);
}

}  // namespace

std::optional<std::uint64_t> free_shared_memory() {
  struct statvfs facts {};
  if (::access(kSharedFolder, R_OK | W_OK | X_OK) != 0 || ::statvfs(kSharedFolder, &facts) != 0)
    return std::nullopt;
  return std::uint64_t{facts.f_bavail} * facts.f_frsize;
}

Status check_room(const TransportOptions& options) {
  NEARMESH_RETURN_IF_ERROR(try_descriptors());
  NEARMESH_RETURN_IF_ERROR(try_memory());
  NEARMESH_RETURN_IF_ERROR(try_threads());
  return options.transport == Transport::kSameHost ? try_shared_memory() : Status::ok();
}

std::string why_alone(const TransportOptions& options, const std::vector<Interface>& interfaces) {
  const bool by_multicast =
      options.transport == Transport::kLan || options.transport == Transport::kThin;
  if (!by_multicast || !options.initial_peers.empty() || !options.discovery_server.empty())
    return {};
  std::string used;
  for (const Interface& one : interfaces) {
    if (!one.is_running) continue;
    const bool is_wanted = options.interface.empty()
                               ? !one.is_loopback
                               : options.interface == one.name || options.interface == one.address;
    if (!is_wanted) continue;
    // Of loopback the ports are asked one by one.
    if (one.has_multicast || one.is_loopback) return {};
    used += (used.empty() ? "" : ", ") + one.name + " " + one.address;
  }
  if (used.empty()) return {};
  return "no interface that is used is marked for multicast (" + used +
         "): where others are not found, one side must name the other (--peer)";
}

}  // namespace nearmesh::wire
