// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/hash.hpp"
#include "full_world.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh::program {
namespace {

struct FullMesh {
  std::string content;  ///< its digits
  SpmHeader header;
  TriangleTree tree;
};

struct Counts {
  std::uint64_t answers = 0, wrong = 0, certified = 0, received = 0, mesh_bytes = 0;
};

Result<FullMesh> load(const std::string& path) {
  Result<ModelFile> file = ModelFile::open(path);
  NEARMESH_RETURN_IF_ERROR(file);
  NEARMESH_RETURN_IF_ERROR(file.value().require_all());
  const SpmHeader& header = file.value().header();
  std::optional<TriangleTree> tree = build_full_tree(header, file.value().store());
  if (!tree) return Status{StatusCode::kCorrupt, path + ": a split is missing"};
  return FullMesh{to_hex(file.value().content_hash()), header, *std::move(tree)};
}

/// Throws where it is none: get() would cut a fraction off.
std::size_t count_of(const nlohmann::json& number) {
  return number.get_ref<const nlohmann::json::number_unsigned_t&>();
}

Pose pose_of(const nlohmann::json& numbers) {
  const auto x = numbers.get<std::array<double, 12>>();
  Pose pose;
  std::copy(x.begin(), x.begin() + 9, pose.rotation.begin());
  std::copy(x.begin() + 9, x.end(), pose.translation_m.begin());
  return pose;
}

// A certified answer is wrong when the full meshes say otherwise; a partial one when they do not
// touch at all.
bool is_wrong(const std::string& status, const nlohmann::json& line, const Answer& full) {
  if (status == "free") return full.status != AnswerStatus::kFree;
  // Ended by the host's options: that they touch is all that it says, and of a cut list how many
  // there are.
  if (status == "contact" && line.value("any", false)) return full.status != AnswerStatus::kContact;
  if (status == "contact" && line.value("truncated", false))
    return full.status != AnswerStatus::kContact || count_of(line.at("pairs")) != full.pairs.size();
  if (status == "contact")
    return full.status != AnswerStatus::kContact ||
           count_of(line.at("pairs")) != full.pairs.size() ||
           line.at("pairs_digest").get<std::string>() != std::to_string(digest(full.pairs));
  if (status == "contained")
    return full.status != AnswerStatus::kContained ||
           line.at("contained").get<std::string>() != to_string(full.contained);
  return status == "partial" && full.status != AnswerStatus::kContact;
}

/// All models and worlds that answers may be about, by name.
struct Full {
  std::map<std::string, FullMesh> models;
  std::map<std::string, FullWorld> worlds;
};

/// One body of a line's two.
struct Side {
  std::string name;  ///< of the body
  const FullMesh* mesh = nullptr;
  FullWorld* world = nullptr;  ///< instead
  Pose pose;
  bool solid = false;
};

Result<Side> side_of(const nlohmann::json& line, const std::string& which, Full& full,
                     const std::string& where) {
  const auto model = line.at("model_" + which).get<std::string>();
  const auto content = line.at("content_" + which).get<std::string>();
  Side side{.name = line.at(which).get<std::string>(),
            .pose = pose_of(line.at("pose_" + which)),
            .solid = line.value("solid_" + which, false)};
  std::string found;
  if (const auto mesh = full.models.find(model); mesh != full.models.end()) {
    side.mesh = &mesh->second;
    found = mesh->second.content;
    if (side.solid)
      NEARMESH_RETURN_IF_ERROR(check_solid(mesh->second.header.surface, where + ": " + side.name));
  } else if (const auto world = full.worlds.find(model); world != full.worlds.end()) {
    side.world = &world->second;
    found = to_hex(world->second.content());
  } else {
    return Status{StatusCode::kNotFound,
                  where + ": model " + model + " is not among the files and folders given"};
  }
  if (content != found)
    return Status{StatusCode::kConflict,
                  where + ": the answer is about content " + content + " of model " + model +
                      (side.world != nullptr ? ", the world" : ", the .spm file") + " given is " +
                      found};
  return side;
}

Result<Answer> answer_of(const Side& a, const Side& b) {
  if (a.world != nullptr && b.world != nullptr)
    return Status{StatusCode::kUnsupported, a.name + " and " + b.name + " are both worlds"};
  if (a.world != nullptr)
    return a.world->answer({a.pose, b.pose, b.mesh->tree.view(), b.solid, true, a.name, b.name});
  if (b.world != nullptr)
    return b.world->answer({b.pose, a.pose, a.mesh->tree.view(), a.solid, false, b.name, a.name});
  const Result<PosedPair> posed =
      pose_pair(a.mesh->tree.grid, a.pose, a.name, b.mesh->tree.grid, b.pose, b.name);
  NEARMESH_RETURN_IF_ERROR(posed);
  return query(a.mesh->tree.view(), posed.value().a, b.mesh->tree.view(), posed.value().b,
               {.clearance = Clearance::kNone, .solid_a = a.solid, .solid_b = b.solid});
}

Status check_line(const nlohmann::json& line, Full& models, const std::string& where,
                  Counts& counts) {
  if (line.contains("summary")) {
    counts.received += count_of(line["summary"].at("received_bytes"));
    counts.mesh_bytes += count_of(line["summary"].at("mesh_bytes"));
    return Status::ok();
  }
  if (line.contains("free_by_bounds"))
    return Status::ok();  // names no pairs; the theorem is tested
  ++counts.answers;
  const auto status = line.at("status").get<std::string>();
  if (status == "uncertain") return Status::ok();  // claims nothing
  if (status != "free" && status != "contact" && status != "contained" && status != "partial")
    return {StatusCode::kInvalidArgument, where + ": no answer has the status " + status};
  const Result<Side> a = side_of(line, "a", models, where);
  NEARMESH_RETURN_IF_ERROR(a);
  const Result<Side> b = side_of(line, "b", models, where);
  NEARMESH_RETURN_IF_ERROR(b);
  const Result<Answer> found = answer_of(a.value(), b.value());
  if (!found.is_ok()) return {found.status().code(), where + ": " + found.status().message()};
  const Answer& full = found.value();
  if (status != "partial") ++counts.certified;
  if (is_wrong(status, line, full)) {
    ++counts.wrong;
    std::fprintf(stderr,
                 "%s: %s and %s: answered %s with %zu pairs, the full meshes say %s with %zu\n",
                 where.c_str(), a.value().name.c_str(), b.value().name.c_str(), status.c_str(),
                 count_of(line.at("pairs")), to_string(full.status), full.pairs.size());
  }
  return Status::ok();
}

}  // namespace

Status run(const CheckOptions& options) {
  if (options.answers.empty()) {
    for (const std::string& path : options.models) {
      if (!std::filesystem::is_directory(path))
        return {StatusCode::kInvalidArgument,
                path + ": is no folder of a world; expected --answers, to check against models"};
      NEARMESH_RETURN_IF_ERROR(run(WorldCheckOptions{path}));
    }
    return Status::ok();
  }
  Full models;
  for (const std::string& path : options.models) {
    if (std::filesystem::is_directory(path)) {
      Result<FullWorld> world = FullWorld::open(path);
      NEARMESH_RETURN_IF_ERROR(world);
      models.worlds.insert_or_assign(name_of_folder(path), std::move(world).value());
      continue;
    }
    Result<FullMesh> mesh = load(path);
    NEARMESH_RETURN_IF_ERROR(mesh);
    models.models.insert_or_assign(std::filesystem::path(path).stem().string(),
                                   std::move(mesh).value());
  }
  Counts counts;
  for (const std::string& path : options.answers) {
    std::ifstream in(path);
    if (!in) return {StatusCode::kIo, path + ": cannot open"};
    std::string text;
    for (std::size_t number = 1; std::getline(in, text); ++number) {
      const std::string where = path + ":" + std::to_string(number);
      try {
        NEARMESH_RETURN_IF_ERROR(check_line(nlohmann::json::parse(text), models, where, counts));
      } catch (const nlohmann::json::exception& error) {
        return {StatusCode::kInvalidArgument, where + ": " + error.what()};
      }
    }
  }
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf("answers %llu, wrong %llu, certified %llu, received %llu of %llu bytes\n",
              count(counts.answers), count(counts.wrong), count(counts.certified),
              count(counts.received), count(counts.mesh_bytes));
  if (counts.wrong > 0)
    return {StatusCode::kConflict,
            std::to_string(counts.wrong) + " answers contradict the full meshes"};
  if (counts.answers == 0) return {StatusCode::kInvalidArgument, "no answer was found to check"};
  return Status::ok();
}

}  // namespace nearmesh::program
