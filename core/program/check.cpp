// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/hash.hpp"
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

Pose pose_of(const nlohmann::json& numbers) {
  const auto x = numbers.get<std::array<double, 12>>();
  Pose pose;
  std::copy(x.begin(), x.begin() + 9, pose.rotation.begin());
  std::copy(x.begin() + 9, x.end(), pose.translation_m.begin());
  return pose;
}

// A certified answer is wrong when the full meshes say otherwise; a partial one when they do not touch at all.
bool is_wrong(const std::string& status, const nlohmann::json& line, const Answer& full) {
  if (status == "free") return full.status != AnswerStatus::kFree;
  // Ended by the host's options: that they touch is all that it says, and of a cut list how many there are.
  if (status == "contact" && line.value("any", false)) return full.status != AnswerStatus::kContact;
  if (status == "contact" && line.value("truncated", false))
    return full.status != AnswerStatus::kContact ||
           line.at("pairs").get<std::size_t>() != full.pairs.size();
  if (status == "contact")
    return full.status != AnswerStatus::kContact ||
           line.at("pairs").get<std::size_t>() != full.pairs.size() ||
           line.at("pairs_digest").get<std::string>() != std::to_string(digest(full.pairs));
  if (status == "contained")
    return full.status != AnswerStatus::kContained ||
           line.at("contained").get<std::string>() != to_string(full.contained);
  return status == "partial" && full.status != AnswerStatus::kContact;
}

Result<const FullMesh*> mesh_of(const std::map<std::string, FullMesh>& models,
                                const std::string& name, const std::string& content,
                                const std::string& where) {
  const auto at = models.find(name);
  if (at == models.end())
    return Status{StatusCode::kNotFound,
                  where + ": model " + name + " is not among the .spm files given"};
  if (content != at->second.content)
    return Status{StatusCode::kConflict, where + ": the answer is about content " + content +
                                             " of model " + name + ", the .spm file given is " +
                                             at->second.content};
  return &at->second;
}

Status check_line(const nlohmann::json& line, const std::map<std::string, FullMesh>& models,
                  const std::string& where, Counts& counts) {
  if (line.contains("summary")) {
    counts.received += line["summary"].at("received_bytes").get<std::uint64_t>();
    counts.mesh_bytes += line["summary"].at("mesh_bytes").get<std::uint64_t>();
    return Status::ok();
  }
  if (line.contains("free_by_bounds"))
    return Status::ok();  // names no pairs; the theorem is tested
  ++counts.answers;
  const auto status = line.at("status").get<std::string>();
  if (status == "uncertain") return Status::ok();  // claims nothing
  const FullMesh* mesh[2] = {};
  int side = 0;
  for (const auto& [key, content_key] :
       {std::pair{"model_a", "content_a"}, std::pair{"model_b", "content_b"}}) {
    const Result<const FullMesh*> found = mesh_of(models, line.at(key).get<std::string>(),
                                                  line.at(content_key).get<std::string>(), where);
    NEARMESH_RETURN_IF_ERROR(found);
    mesh[side++] = found.value();
  }
  const Result<PosedPair> posed =
      pose_pair(mesh[0]->tree.grid, pose_of(line.at("pose_a")), line.at("a").get<std::string>(),
                mesh[1]->tree.grid, pose_of(line.at("pose_b")), line.at("b").get<std::string>());
  if (!posed.is_ok()) return {posed.status().code(), where + ": " + posed.status().message()};
  const QueryOptions options{.clearance = Clearance::kNone,
                             .solid_a = line.value("solid_a", false),
                             .solid_b = line.value("solid_b", false)};
  if (options.solid_a)
    NEARMESH_RETURN_IF_ERROR(
        check_solid(mesh[0]->header.surface, where + ": " + line.at("a").get<std::string>()));
  if (options.solid_b)
    NEARMESH_RETURN_IF_ERROR(
        check_solid(mesh[1]->header.surface, where + ": " + line.at("b").get<std::string>()));
  const Answer full =
      query(mesh[0]->tree.view(), posed.value().a, mesh[1]->tree.view(), posed.value().b, options);
  if (status != "partial") ++counts.certified;
  if (is_wrong(status, line, full)) {
    ++counts.wrong;
    std::fprintf(stderr,
                 "%s: %s and %s: answered %s with %zu pairs, the full meshes say %s with %zu\n",
                 where.c_str(), line.at("a").get<std::string>().c_str(),
                 line.at("b").get<std::string>().c_str(), status.c_str(),
                 line.at("pairs").get<std::size_t>(), to_string(full.status), full.pairs.size());
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
  std::map<std::string, FullMesh> models;
  for (const std::string& path : options.models) {
    Result<FullMesh> mesh = load(path);
    NEARMESH_RETURN_IF_ERROR(mesh);
    models.insert_or_assign(std::filesystem::path(path).stem().string(), std::move(mesh).value());
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
