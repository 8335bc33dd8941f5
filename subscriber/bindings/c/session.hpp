// SPDX-License-Identifier: Apache-2.0
#pragma once
// The handle of a session, with the last frame as C reads it.

#include <atomic>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "answers.hpp"
#include "handle.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::c {

struct OwnedWorld : nearmesh_world_answer {
  OwnedWorld() : nearmesh_world_answer{} {}
  OwnedWorld(const OwnedWorld&) = delete;
  OwnedWorld& operator=(const OwnedWorld&) = delete;
  void fill(const subscriber::WorldAnswer& of);

  ContentText text;
  std::vector<nearmesh_near_tile> tiles;
};

/// Of a frame; its texts are the report's.
struct OwnedPair {
  OwnedPair() = default;
  OwnedPair(const OwnedPair&) = delete;
  OwnedPair& operator=(const OwnedPair&) = delete;
  void fill(const subscriber::PairAnswer& of);

  nearmesh_pair_answer pair{};
  OwnedAnswer answer;
  ContentText content_a, content_b;
  nearmesh_swept swept{};
  nearmesh_last_certified last_certified{};
  OwnedWorld world;
};

struct OwnedFrame {
  OwnedFrame() = default;
  OwnedFrame(const OwnedFrame&) = delete;
  OwnedFrame& operator=(const OwnedFrame&) = delete;
  void fill(subscriber::FrameReport of);

  subscriber::FrameReport report;
  nearmesh_frame frame{};
  std::deque<OwnedPair> pairs;  // do not move; the report's, and some that are not used now
  std::vector<nearmesh_unknown_body> unknown;
  std::vector<nearmesh_contact_event> contact_events;
};

/// Errors: what is missing or out of its range, by its name in nearmesh.h.
[[nodiscard]] Result<subscriber::SessionOptions> session_options_of(
    const nearmesh_session_options* given);
[[nodiscard]] Result<subscriber::BodyOptions> body_options_of(const nearmesh_body_options* given);
/// None for no text.
[[nodiscard]] Result<ContentHash> content_of(const char* digits);

/// A channel on DDS. Errors: those of DdsChannel::create; kUnsupported where this build has none.
[[nodiscard]] Result<std::unique_ptr<subscriber::Channel>> make_dds_channel(
    const nearmesh_dds_options* options);

}  // namespace nearmesh::c

struct nearmesh_session {
  static constexpr nearmesh::c::Kind kKind = nearmesh::c::Kind::kSession;
  nearmesh::c::Kind kind = kKind;
  mutable std::atomic<bool> in_use = false;
  bool is_spoiled = false;  // an exception came half-way: what it holds is not to be trusted
  nearmesh::subscriber::LocalChannel* local = nullptr;  // the session's channel, of a local one
  std::unique_ptr<nearmesh::subscriber::Session> session;
  std::vector<nearmesh::subscriber::Session::OwnMotion> motions;  // scratch
  std::optional<nearmesh::c::OwnedFrame> frame;

  // What the functions of these names gave last.
  std::string readiness_reason, region_reason, name;
  nearmesh_readiness readiness{};
  nearmesh_region_readiness region{};
  std::string probe_reason, probe_awaited;
  nearmesh_probe_report probe{};
  nearmesh_session_stats stats{};
  nearmesh::c::ContentText content;
  nearmesh_model_facts facts{};
  nearmesh::subscriber::BodyOptions declared;
  nearmesh::c::ContentText pin;
  nearmesh_body_facts body{};
  nearmesh::subscriber::Session::HeldMesh held;
  nearmesh_held_mesh mesh{};
};

namespace nearmesh::c {

/// Runs `body`, which reads what the session knows.
template <class Handle, class Body>
nearmesh_status reading(Handle* handle, nearmesh_error* error, Body&& body) noexcept {
  return guarded(handle, error, [&]() -> Status {
    if (handle->is_spoiled)
      return {StatusCode::kConflict,
              "an earlier call ended half-way, for want of memory say; destroy the session"};
    return body();
  });
}

/// Runs `body`, which may change the session. Whatever it throws leaves the session behind
/// half-way: nothing is asked of it then.
template <class Body>
nearmesh_status changing(nearmesh_session* handle, nearmesh_error* error, Body&& body) noexcept {
  return reading(handle, error, [&]() -> Status {
    try {
      return body();
    } catch (...) {
      handle->is_spoiled = true;
      handle->frame.reset();
      throw;
    }
  });
}

/// Into the handle's scratch.
[[nodiscard]] Status take_motions(nearmesh_session& handle, const nearmesh_body* bodies,
                                  const nearmesh_motion* motions, std::size_t count);
/// Of the last update.
void keep_frame(nearmesh_session& handle, subscriber::FrameReport&& report,
                const nearmesh_frame** frame);

}  // namespace nearmesh::c
