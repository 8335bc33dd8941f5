// SPDX-License-Identifier: Apache-2.0
// Options of sessions and bodies.
#include <algorithm>
#include <cmath>
#include <limits>

#include "nearmesh/core/base/parse_content_hash.hpp"
#include "run_jobs.hpp"
#include "session.hpp"

namespace nearmesh::c {

using subscriber::SessionOptions;

namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

nearmesh_session_options session_defaults() {
  const SessionOptions built_in;
  nearmesh_session_options options{};
  options.size = sizeof options;
  options.max_pose_age_s = built_in.max_pose_age_s;
  options.lookahead_s = built_in.lookahead_s;
  options.margin_m = built_in.margin_m;
  options.sweep_s = built_in.sweep_s;
  options.request_timeout_s = built_in.request_timeout_s;
  options.audit_s = built_in.audit_s;
  options.audit_seed = built_in.audit_seed;
  options.window_bytes = built_in.window_bytes;
  options.max_held_splits = built_in.max_held_splits;
  options.clearance = static_cast<int32_t>(built_in.clearance);
  options.contacts = built_in.contacts;
  options.publish_reports = built_in.publish_reports;
  options.any = built_in.any;
  options.max_pairs = built_in.max_pairs;
  options.max_tests = built_in.max_tests;
  options.max_sweep_tests = built_in.max_sweep_tests;
  options.depth = built_in.depth;
  options.max_depth_tests = built_in.max_depth_tests;
  options.promise_s = built_in.promise_s;
  return options;
}

constexpr nearmesh_body_options kBodyDefaults{.size = sizeof(nearmesh_body_options),
                                              .name = nullptr,
                                              .model = nullptr,
                                              .content = nullptr,
                                              .max_pose_age_s = -1,
                                              .own = 0,
                                              .solid = 0,
                                              .group = 1,
                                              .mask = 0xffffffffU,
                                              .max_speed_mps = 0};

}  // namespace

Result<SessionOptions> session_options_of(const nearmesh_session_options* given) {
  nearmesh_session_options read = session_defaults();
  NEARMESH_RETURN_IF_ERROR(read_options(given, "nearmesh_session_options", read));
  NEARMESH_RETURN_IF_ERROR(
      check_number(read.clearance, NEARMESH_CLEARANCE_NONE, NEARMESH_CLEARANCE_EXACT, "clearance"));
  SessionOptions options;
  options.max_pose_age_s = read.max_pose_age_s;
  options.lookahead_s = read.lookahead_s;
  options.margin_m = read.margin_m;
  options.sweep_s = read.sweep_s;
  options.window_bytes = read.window_bytes;
  options.request_timeout_s = read.request_timeout_s;
  options.max_held_splits = read.max_held_splits;
  options.audit_s = read.audit_s;
  options.audit_seed = read.audit_seed;
  options.clearance = static_cast<Clearance>(read.clearance);
  if (read.cache_folder != nullptr) options.cache_folder = read.cache_folder;
  options.contacts = read.contacts != 0;
  options.depth = read.depth != 0;
  options.run_jobs = run_jobs_of(read.run_jobs, read.run_jobs_user);
  options.publish_reports = read.publish_reports != 0;
  options.any = read.any != 0;
  options.max_pairs = static_cast<std::size_t>(std::min<std::uint64_t>(read.max_pairs, kAllPairs));
  options.max_tests = read.max_tests;
  options.max_sweep_tests = read.max_sweep_tests;
  options.max_depth_tests = read.max_depth_tests;
  options.promise_s = read.promise_s;
  NEARMESH_RETURN_IF_ERROR(subscriber::check(options));
  return options;
}

Result<ContentHash> content_of(const char* digits) {
  if (digits == nullptr) return ContentHash{};
  return parse_content_hash(digits);
}

Result<subscriber::BodyOptions> body_options_of(const nearmesh_body_options* given) {
  NEARMESH_RETURN_IF_ERROR(check_given(given, "options"));
  nearmesh_body_options read = kBodyDefaults;
  NEARMESH_RETURN_IF_ERROR(read_options(given, "nearmesh_body_options", read));
  NEARMESH_RETURN_IF_ERROR(check_given(read.name, "name"));
  NEARMESH_RETURN_IF_ERROR(check_given(read.model, "model"));
  if (std::isnan(read.max_pose_age_s))
    NEARMESH_RETURN_IF_ERROR(check_number(read.max_pose_age_s, 0, kInfinite, "max_pose_age_s"));
  const Result<ContentHash> content = content_of(read.content);
  NEARMESH_RETURN_IF_ERROR(content);
  subscriber::BodyOptions options;
  options.name = read.name;
  options.model = read.model;
  options.own = read.own != 0;
  options.solid = read.solid != 0;
  options.content = content.value();
  if (read.max_pose_age_s >= 0) options.max_pose_age_s = read.max_pose_age_s;
  options.group = read.group;
  options.mask = read.mask;
  options.max_speed_mps = read.max_speed_mps;
  return options;
}

}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C

nearmesh_status nearmesh_session_options_init(nearmesh_session_options* options,
                                              size_t size) noexcept {
  return c::init_options(options, size, c::session_defaults());
}

nearmesh_status nearmesh_body_options_init(nearmesh_body_options* options, size_t size) noexcept {
  return c::init_options(options, size, c::kBodyDefaults);
}
