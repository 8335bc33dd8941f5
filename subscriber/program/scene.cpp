// SPDX-License-Identifier: Apache-2.0
#include "scene.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "core/base/csv.hpp"
#include "idl/program/settings.hpp"
#include "nearmesh/core/base/parse_content_hash.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr double kMaxPoseAge_s = 1e9;
constexpr double kMaxDuration_s = 1e8;

// Thrown inside this file only, and turned into a Status by read_scene.
struct SceneError {
  int line;
  std::string what;
};

[[noreturn]] void fail(const YAML::Node& node, const std::string& what) {
  throw SceneError{std::max(node.Mark().line, 0) + 1, what};  // of an empty file it has none
}

void check_keys(const YAML::Node& map, const std::string& where,
                const std::set<std::string>& known) {
  if (!map.IsMap()) fail(map, where + ": expected a map");
  std::set<std::string> seen;
  for (const auto& entry : map) {
    const auto key = entry.first.as<std::string>();
    if (!known.contains(key))
      fail(entry.first, where + ": unknown key " + key + "; the nearest is " +
                            wire::program::nearest(key, known));
    // Of two one would count, and nobody would know which.
    if (!seen.insert(key).second) fail(entry.first, where + ": " + key + " stands twice");
  }
}

template <class T>
T value(const YAML::Node& node, const std::string& key, const char* expected) {
  try {
    return node.as<T>();
  } catch (const YAML::Exception&) {
    fail(node, key + ": expected " + expected);
  }
}

double number_in(const YAML::Node& map, const std::string& key, double otherwise, double lo,
                 double hi) {
  const YAML::Node node = map[key];
  if (!node) return otherwise;
  const double x = value<double>(node, key, "a number");
  if (!(x >= lo && x <= hi))
    fail(node, key + ": expected a number in [" + std::to_string(lo) + ", " + std::to_string(hi) +
                   "], found " + node.as<std::string>());
  return x;
}

/// `count` stays where nothing is given.
template <class Count>
void count_in(const YAML::Node& map, const std::string& key, std::uint64_t most, Count& count) {
  const YAML::Node node = map[key];
  if (!node) return;
  const double x = value<double>(node, key, "a number");
  if (!(x >= 0 && x <= static_cast<double>(most)) || x != std::floor(x))
    fail(node, key + ": expected a whole number in [0, " + std::to_string(most) + "], found " +
                   node.as<std::string>());
  count = static_cast<Count>(x);
}

std::string name_of(const YAML::Node& map, const std::string& key, const std::string& where) {
  const YAML::Node node = map[key];
  if (!node) fail(map, where + ": expected the key " + key + ", found none");
  return value<std::string>(node, key, "a name");
}

ContentHash content(const YAML::Node& node) {
  const Result<ContentHash> hash =
      parse_content_hash(value<std::string>(node, "content", "hexadecimal digits"));
  if (!hash.is_ok()) fail(node, hash.status().message());
  return hash.value();
}

Clearance clearance(const YAML::Node& node) {
  const auto name = value<std::string>(node, "clearance", "none, bound or exact");
  if (name == "none") return Clearance::kNone;
  if (name == "bound") return Clearance::kBound;
  if (name == "exact") return Clearance::kExact;
  fail(node, "clearance: expected none, bound or exact, found " + name);
}

Pose fixed_pose(const YAML::Node& node, const std::string& body) {
  check_keys(node, "pose of " + body, {"rotation", "quaternion", "translation"});
  Pose pose;
  if (const YAML::Node q = node["quaternion"]) {
    if (node["rotation"]) fail(q, "quaternion: expected it or rotation, found both");
    const auto x = value<std::vector<double>>(q, "quaternion", "four numbers: w, x, y, z");
    if (x.size() != 4)
      fail(q, "quaternion: expected four numbers, w, x, y, z, found " + std::to_string(x.size()));
    const auto rotation = rotation_of_quaternion({x[0], x[1], x[2], x[3]}, body);
    if (!rotation.is_ok()) fail(q, rotation.status().message());
    pose.rotation = rotation.value();
  }
  if (const YAML::Node r = node["rotation"]) {
    const auto x = value<std::vector<double>>(r, "rotation", "nine numbers, row-major");
    if (x.size() != 9)
      fail(r, "rotation: expected nine numbers, found " + std::to_string(x.size()));
    std::copy(x.begin(), x.end(), pose.rotation.begin());
  }
  if (const YAML::Node t = node["translation"]) {
    const auto x = value<std::vector<double>>(t, "translation", "three numbers, metres");
    if (x.size() != 3)
      fail(t, "translation: expected three numbers, found " + std::to_string(x.size()));
    std::copy(x.begin(), x.end(), pose.translation_m.begin());
  }
  if (const Status status = check_pose(pose, body); !status.is_ok()) fail(node, status.message());
  return pose;
}

// Velocities by the next frame's pose; the last frame keeps those before it.
void add_velocities(std::vector<Motion>& motions, double rate_hz) {
  for (std::size_t i = 0; i + 1 < motions.size(); ++i)
    motions[i] = motion_between(motions[i].pose, motions[i + 1].pose, 1 / rate_hz);
  if (motions.size() > 1) {
    motions.back().linear_velocity_mps = motions[motions.size() - 2].linear_velocity_mps;
    motions.back().angular_velocity_radps = motions[motions.size() - 2].angular_velocity_radps;
  }
}

/// Empty where it never goes faster than that; 0: it may go as fast as it will.
std::string why_too_fast(const std::vector<Motion>& motions, double max_speed_mps) {
  if (max_speed_mps <= 0) return {};
  for (std::size_t row = 0; row < motions.size(); ++row) {
    const auto& v = motions[row].linear_velocity_mps;
    const double speed_mps = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    // Its places are rounded, and their differences are.
    if (speed_mps > max_speed_mps * (1 + 1e-6))
      return "frame " + std::to_string(row) + " goes at " + std::to_string(speed_mps) +
             " m/s, faster than max_speed_mps, " + std::to_string(max_speed_mps);
  }
  return {};
}

Result<std::vector<Motion>> read_trajectory(const std::string& path, const std::string& body,
                                            double rate_hz) {
  const Result<CsvTable> table = CsvTable::read(path);
  NEARMESH_RETURN_IF_ERROR(table);
  // Nine numbers of a matrix, or four of a quaternion.
  const bool is_quaternion = table.value().column("QW") != CsvTable::npos;
  std::vector<std::string> names{"R00", "R01", "R02", "R10", "R11", "R12", "R20", "R21", "R22"};
  if (is_quaternion) names = {"QW", "QX", "QY", "QZ"};
  const std::size_t turns = names.size();
  names.insert(names.end(), {"T0", "T1", "T2"});
  const auto columns = table.value().columns(names);
  NEARMESH_RETURN_IF_ERROR(columns);
  std::vector<Motion> motions(table.value().row_count());
  for (std::size_t row = 0; row < motions.size(); ++row) {
    Pose& pose = motions[row].pose;
    std::array<double, 4> quaternion{};
    for (std::size_t i = 0; i < names.size(); ++i) {
      const Result<double> x = table.value().number(row, columns.value()[i]);
      NEARMESH_RETURN_IF_ERROR(x);
      (i >= turns      ? pose.translation_m[i - turns]
       : is_quaternion ? quaternion[i]
                       : pose.rotation[i]) = x.value();
    }
    if (is_quaternion) {
      const auto rotation = rotation_of_quaternion(quaternion, body);
      if (!rotation.is_ok())
        return Status{rotation.status().code(),
                      table.value().place(row) + ": " + rotation.status().message()};
      pose.rotation = rotation.value();
    }
    if (const Status status = check_pose(pose, body); !status.is_ok())
      return Status{status.code(), table.value().place(row) + ": " + status.message()};
  }
  if (motions.empty())
    return Status{StatusCode::kInvalidArgument, path + ": expected at least one frame"};
  add_velocities(motions, rate_hz);
  for (std::size_t row = 0; row < motions.size(); ++row)
    if (const Status status = check_motion(motions[row], body); !status.is_ok())
      return Status{status.code(), table.value().place(row) + ": " + status.message()};
  return motions;
}

// Its place among the bodies.
std::size_t body_named(const Scene& scene, const std::string& name, const YAML::Node& node,
                       const std::string& key) {
  const auto at = std::find_if(scene.bodies.begin(), scene.bodies.end(),
                               [&](const BodyOfScene& b) { return b.name == name; });
  if (at == scene.bodies.end()) {
    std::string names;
    for (const BodyOfScene& body : scene.bodies) names += (names.empty() ? "" : ", ") + body.name;
    fail(node, key + ": no body named " + name + " among the bodies: " + names);
  }
  return static_cast<std::size_t>(at - scene.bodies.begin());
}

Scene parse(const YAML::Node& root, const std::filesystem::path& folder) {
  check_keys(root, "scene",
             {"bodies",          "moves",       "robots",          "pairs",     "frame_rate_hz",
              "budget_ms",       "lookahead_s", "audit_s",         "cache",     "margin_m",
              "max_pose_age_s",  "sweep_s",     "max_held_splits", "clearance", "contacts",
              "depth",           "any",         "max_pairs",       "max_tests", "max_sweep_tests",
              "max_depth_tests", "duration_s",  "start_timeout_s"});
  Scene scene;
  scene.frame_rate_hz = number_in(root, "frame_rate_hz", scene.frame_rate_hz, 0.1, 10000);
  scene.budget_s = number_in(root, "budget_ms", scene.budget_s * 1e3, 0, 1e6) / 1e3;
  scene.start_timeout_s = number_in(root, "start_timeout_s", scene.start_timeout_s, 0, 86400);
  scene.session.audit_s = number_in(root, "audit_s", 0, 0, 86400);
  scene.session.lookahead_s = number_in(root, "lookahead_s", scene.session.lookahead_s, 0, 60);
  scene.session.margin_m = number_in(root, "margin_m", scene.session.margin_m, 0, 1e6);
  scene.session.max_pose_age_s =
      number_in(root, "max_pose_age_s", scene.session.max_pose_age_s, 0, kMaxPoseAge_s);
  scene.session.sweep_s = number_in(root, "sweep_s", scene.session.sweep_s, 0, 60);
  count_in(root, "max_held_splits", 4'000'000'000, scene.session.max_held_splits);
  if (root["clearance"]) scene.session.clearance = clearance(root["clearance"]);
  if (root["cache"]) {
    const std::filesystem::path cache = value<std::string>(root["cache"], "cache", "a folder");
    if (cache.empty()) fail(root["cache"], "cache: expected a folder, found nothing");
    scene.session.cache_folder = (cache.is_absolute() ? cache : folder / cache).string();
  }
  if (root["contacts"])
    scene.session.contacts = value<bool>(root["contacts"], "contacts", "true or false");
  if (root["depth"]) scene.session.depth = value<bool>(root["depth"], "depth", "true or false");
  if (root["any"]) scene.session.any = value<bool>(root["any"], "any", "true or false");
  constexpr std::uint64_t kMostTests = 1'000'000'000'000'000;
  count_in(root, "max_pairs", kMostTests, scene.session.max_pairs);
  count_in(root, "max_tests", kMostTests, scene.session.max_tests);
  count_in(root, "max_sweep_tests", kMostTests, scene.session.max_sweep_tests);
  count_in(root, "max_depth_tests", kMostTests, scene.session.max_depth_tests);
  const std::string many =
      root["pairs"] && root["pairs"].IsScalar() ? root["pairs"].Scalar() : std::string();
  scene.watches_only_own = many == "own";
  scene.watches_all = many == "all" || scene.watches_only_own;
  const bool finds_bodies = scene.watches_all && !root["bodies"];
  if (!finds_bodies && (!root["bodies"] || !root["bodies"].IsSequence()))
    fail(root, "bodies: expected a list");
  for (const YAML::Node& node : root["bodies"]) {
    check_keys(node, "body",
               {"name", "model", "content", "solid", "pose", "max_pose_age_s", "max_speed_mps"});
    BodyOfScene body{.name = name_of(node, "name", "body"),
                     .model = name_of(node, "model", "body")};
    if (node["solid"]) body.solid = value<bool>(node["solid"], "solid", "true or false");
    if (node["content"]) body.content = content(node["content"]);
    if (node["max_pose_age_s"])
      body.max_pose_age_s = number_in(node, "max_pose_age_s", 0, 0, kMaxPoseAge_s);
    if (node["max_speed_mps"])
      body.max_speed_mps = number_in(node, "max_speed_mps", 0, 0, wire::kMaxSpeed_mps);
    if (node["pose"]) body.fixed_pose = fixed_pose(node["pose"], body.name);
    scene.bodies.push_back(std::move(body));
  }
  if (const YAML::Node moves = root["moves"]) {
    if (!moves.IsSequence()) fail(moves, "moves: expected a list");
    for (const YAML::Node& node : moves) {
      check_keys(node, "move", {"body", "trajectory"});
      const std::string name = name_of(node, "body", "move");
      BodyOfScene& body = scene.bodies[body_named(scene, name, node["body"], "moves")];
      if (!body.trajectory.empty()) fail(node["body"], "moves: body " + name + " is moved twice");
      if (body.fixed_pose)
        fail(node["body"], "moves: body " + name + " has a fixed pose, expected one or the other");
      const std::filesystem::path file = name_of(node, "trajectory", "move of " + name);
      auto motions = read_trajectory((file.is_absolute() ? file : folder / file).string(), name,
                                     scene.frame_rate_hz);
      if (!motions.is_ok()) fail(node["trajectory"], motions.status().message());
      if (const std::string why = why_too_fast(motions.value(), body.max_speed_mps); !why.empty())
        fail(node["trajectory"], "trajectory of " + name + ": " + why);
      body.trajectory = std::move(motions).value();
      scene.frames = std::max<std::uint64_t>(scene.frames, body.trajectory.size());
    }
  }
  if (root["robots"] && !root["robots"].IsSequence())
    fail(root["robots"], "robots: expected a list");
  for (const YAML::Node& node : root["robots"]) {
    scene.robots.emplace_back();
    for (const auto& name :
         value<std::vector<std::string>>(node, "robots", "a list of links' names each")) {
      const std::size_t link = body_named(scene, name, node, "robots");
      if (scene.bodies[link].trajectory.empty())
        fail(node, "robots: link " + name + " is not moved here along a trajectory");
      scene.robots.back().push_back(link);
    }
  }
  if (!scene.watches_all && (!root["pairs"] || !root["pairs"].IsSequence()))
    fail(root, "pairs: expected a list, all, or own");
  for (const YAML::Node& node : root["pairs"]) {
    const auto names = value<std::vector<std::string>>(node, "pairs", "a list of two names each");
    if (names.size() != 2)
      fail(node, "pairs: expected two names, found " + std::to_string(names.size()));
    scene.pairs.emplace_back(body_named(scene, names[0], node, "pairs"),
                             body_named(scene, names[1], node, "pairs"));
  }
  Session session(std::make_unique<LocalChannel>());
  const Refused refused = declare(
      scene, [](std::size_t) { return false; }, session);
  if (!refused.status.is_ok()) fail(root[refused.list][refused.place], refused.status.message());
  if (root["duration_s"]) {
    const double duration_s = number_in(root, "duration_s", 0, 0, kMaxDuration_s);
    scene.frames = std::max<std::uint64_t>(
        1, static_cast<std::uint64_t>(duration_s * scene.frame_rate_hz + 0.5));
  } else if (scene.frames == 0) {
    scene.frames = Scene::kForEver;
  }
  return scene;
}

}  // namespace

Refused declare(const Scene& scene, const std::function<bool(std::size_t)>& moves,
                Session& session) {
  std::vector<BodyId> ids;
  for (std::size_t i = 0; i < scene.bodies.size(); ++i) {
    const BodyOfScene& body = scene.bodies[i];
    const bool is_own = !body.trajectory.empty() || moves(i);
    // Who moves an own body without a trajectory may fall silent all the same.
    const auto age_s = body.trajectory.empty() && is_own && !body.max_pose_age_s
                           ? std::optional(scene.session.max_pose_age_s)
                           : body.max_pose_age_s;
    const auto added = session.add_body({.name = body.name,
                                         .model = body.model,
                                         .own = is_own,
                                         .solid = body.solid,
                                         .content = body.content,
                                         .max_pose_age_s = age_s,
                                         .max_speed_mps = is_own ? body.max_speed_mps : 0});
    if (!added.is_ok()) return {"bodies", i, added.status()};
    ids.push_back(added.value());
    if (!body.fixed_pose) continue;
    if (Status placed = session.place_body(ids[i], *body.fixed_pose); !placed.is_ok())
      return {"bodies", i, std::move(placed)};
  }
  for (std::size_t i = 0; i < scene.robots.size(); ++i) {
    std::vector<BodyId> links;
    for (const std::size_t link : scene.robots[i]) links.push_back(ids[link]);
    if (Status linked = session.link_bodies(links); !linked.is_ok())
      return {"robots", i, std::move(linked)};
  }
  for (std::size_t i = 0; i < scene.pairs.size(); ++i) {
    const auto& [a, b] = scene.pairs[i];
    if (Status watched = session.watch(ids[a], ids[b]); !watched.is_ok())
      return {"pairs", i, std::move(watched)};
  }
  return {};
}

Result<Scene> read_scene(const std::string& path) {
  try {
    return parse(YAML::LoadFile(path), std::filesystem::path(path).parent_path());
  } catch (const SceneError& error) {
    return Status{StatusCode::kInvalidArgument,
                  path + ":" + std::to_string(error.line) + ": " + error.what};
  } catch (const YAML::BadFile&) {
    return Status{StatusCode::kIo, path + ": cannot open"};
  } catch (const YAML::Exception& error) {
    return Status{StatusCode::kInvalidArgument, path + ": " + error.what()};
  }
}

}  // namespace nearmesh::subscriber::program
