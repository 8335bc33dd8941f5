// SPDX-License-Identifier: Apache-2.0
#include "playhead.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

namespace nearmesh::publisher {
namespace {

std::string in_seconds(double seconds) {
  char text[64];
  std::snprintf(text, sizeof text, "%.3f", seconds);
  return text;
}

}  // namespace

Result<Playhead> Playhead::create(RecordingReader& recording, const PlayheadOptions& options,
                                  double now_s) {
  NEARMESH_ASSERT(recording.message_count() > 0);
  if (!std::isfinite(options.rate) || options.rate <= 0)
    return Status{StatusCode::kInvalidArgument,
                  "rate: expected a number above 0, found " + std::to_string(options.rate)};
  // Up to and with the last message, whose time is the end.
  const double length_s = static_cast<double>(recording.end_ns() - recording.begin_ns()) * 1e-9;
  const bool to_last = options.end_s < 0;
  const auto outside = [&](const char* what, double time_s) {
    return Status{StatusCode::kInvalidArgument,
                  std::string(what) + ": expected a time in the recording's 0 to " +
                      in_seconds(length_s) + " s, found " + in_seconds(time_s)};
  };
  if (!(options.start_s >= 0 && options.start_s <= length_s))
    return outside("start", options.start_s);
  if (!to_last && !(options.end_s <= length_s)) return outside("end", options.end_s);
  if (!to_last && options.end_s <= options.start_s)
    return Status{StatusCode::kInvalidArgument, "end: expected a time after the start at " +
                                                    in_seconds(options.start_s) + " s, found " +
                                                    in_seconds(options.end_s)};
  Playhead playhead(recording);
  playhead.rate_ = options.rate;
  playhead.start_s_ = options.start_s;
  playhead.end_s_ = to_last ? length_s : options.end_s;
  playhead.end_id_ = recording.message_count() + 1;
  if (!to_last) {
    const Result<std::int64_t> end = recording.find(playhead.ns_of(options.end_s));
    NEARMESH_RETURN_IF_ERROR(end);
    playhead.end_id_ = end.value();
  }
  NEARMESH_RETURN_IF_ERROR(playhead.seek(options.start_s, now_s));
  return playhead;
}

std::int64_t Playhead::ns_of(double time_s) const {
  return recording_->begin_ns() + std::llround(time_s * 1e9);
}

Status Playhead::seek(double time_s, double now_s) {
  const double to_s = std::clamp(time_s, start_s_, end_s_);
  // The first messages may be stamped a little before the very first.
  Result<std::int64_t> id = to_s <= 0 ? Result<std::int64_t>(1) : recording_->find(ns_of(to_s));
  NEARMESH_RETURN_IF_ERROR(id);
  next_id_ = std::min(id.value(), end_id_);
  ahead_.clear();
  played_s_ = to_s;
  last_tick_s_ = now_s;
  set_time(to_s, now_s);
  return Status::ok();
}

void Playhead::set_time(double time_s, double now_s) {
  anchor_time_s_ = time_s;
  anchor_s_ = now_s;
}

double Playhead::time_s(double now_s) const {
  const double time_s = paused_ ? anchor_time_s_ : anchor_time_s_ + (now_s - anchor_s_) * rate_;
  return std::clamp(time_s, start_s_, end_s_);
}

void Playhead::tick(double now_s) {
  if (now_s - last_tick_s_ > kLongestGap_s) anchor_s_ += now_s - last_tick_s_;
  last_tick_s_ = now_s;
}

void Playhead::pause(double now_s) {
  set_time(time_s(now_s), now_s);
  paused_ = true;
}

void Playhead::resume(double now_s) {
  set_time(time_s(now_s), now_s);
  paused_ = false;
}

Status Playhead::read_ahead() {
  if (!ahead_.empty() || at_end()) return Status::ok();
  return recording_->read(next_id_, std::min(next_id_ + kReadAhead, end_id_),
                          [this](std::int64_t id, const RecordedMessage& message) {
                            ahead_.push_back({id, message, 0});
                            return true;
                          });
}

/// Precondition: a message was read ahead.
double Playhead::due_s() {
  const std::int64_t ns = ahead_.front().message.received_ns - recording_->begin_ns();
  return std::max(played_s_, static_cast<double>(ns) * 1e-9);
}

Playhead::Due Playhead::pop(double late_s) {
  played_s_ = due_s();
  Due due = std::move(ahead_.front());
  due.late_s = late_s;
  ahead_.pop_front();
  next_id_ = due.id + 1;
  return due;
}

Result<std::optional<Playhead::Due>> Playhead::take(double now_s) {
  tick(now_s);
  if (paused_) return std::optional<Due>();
  NEARMESH_RETURN_IF_ERROR(read_ahead());
  if (ahead_.empty()) {
    next_id_ = end_id_;
    return std::optional<Due>();
  }
  // Not time_s(): the last messages of a part of a recording are due, also where the clamp ends
  // before them.
  const double late_s = now_s - (anchor_s_ + (due_s() - anchor_time_s_) / rate_);
  if (late_s < 0) return std::optional<Due>();
  return std::optional<Due>(pop(late_s));
}

Result<std::optional<Playhead::Due>> Playhead::take_early(double now_s) {
  tick(now_s);
  NEARMESH_RETURN_IF_ERROR(read_ahead());
  if (ahead_.empty()) {
    next_id_ = end_id_;
    return std::optional<Due>();
  }
  Due due = pop(0);
  set_time(played_s_, now_s);
  return std::optional<Due>(std::move(due));
}

double Playhead::wait_s(double now_s) {
  if (paused_ || at_end()) return std::numeric_limits<double>::infinity();
  if (ahead_.empty()) return 0;
  return std::max(0.0, anchor_s_ + (due_s() - anchor_time_s_) / rate_ - now_s);
}

}  // namespace nearmesh::publisher
