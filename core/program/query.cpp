// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/csv.hpp"
#include "core/command/json_text.hpp"
#include "core/query/contacts_json.hpp"
#include "core/world/open_tiles.hpp"
#include "full_world.hpp"
#include "query_methods.hpp"

namespace nearmesh::program {
namespace {

struct PoseRow {
  std::string id, place;
  Pose a, b;
};

Result<std::vector<PoseRow>> read_poses(const std::string& path) {
  Result<CsvTable> table = CsvTable::read(path);
  NEARMESH_RETURN_IF_ERROR(table);
  std::vector<std::string> names;
  for (const char* body : {"A", "B"}) {
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column)
        names.push_back(std::string(body) + "_R" + std::to_string(row) + std::to_string(column));
    for (int k = 0; k < 3; ++k) names.push_back(std::string(body) + "_T" + std::to_string(k));
  }
  const Result<std::vector<std::size_t>> columns = table.value().columns(names);
  NEARMESH_RETURN_IF_ERROR(columns);
  const std::size_t id = table.value().column("id");
  if (id == CsvTable::npos) return table.value().missing_column("id");
  std::vector<PoseRow> rows;
  for (std::size_t r = 0; r < table.value().row_count(); ++r) {
    PoseRow row{.id = table.value().text(r, id), .place = table.value().place(r)};
    for (std::size_t i = 0; i < 24; ++i) {
      const Result<double> number = table.value().number(r, columns.value()[i]);
      NEARMESH_RETURN_IF_ERROR(number);
      Pose& pose = i < 12 ? row.a : row.b;
      (i % 12 < 9 ? pose.rotation[i % 12] : pose.translation_m[i % 12 - 9]) = number.value();
    }
    rows.push_back(row);
  }
  return rows;
}

nlohmann::ordered_json to_json(const PoseRow& row, const MethodAnswer& answer) {
  // Numbers stay numbers, so that scripts can join on them.
  nlohmann::ordered_json id = nlohmann::ordered_json::parse(row.id, nullptr, false);
  if (!id.is_number()) id = row.id;
  const auto microseconds = [](double s) { return std::round(s * 1e7) / 10; };
  nlohmann::ordered_json line = {{"id", id},
                                 {"status", to_string(answer.answer.status)},
                                 {"pairs", answer.answer.pairs.size()},
                                 {"splits", answer.splits},
                                 {"slots", answer.slots},
                                 {"bytes", answer.bytes},
                                 {"t_refine_us", microseconds(answer.refine_s)},
                                 {"t_tree_us", microseconds(answer.tree_s)},
                                 {"t_query_us", microseconds(answer.query_s)},
                                 {"t_load_us", microseconds(answer.load_s)}};
  if (answer.answer.status == AnswerStatus::kContained)
    line["contained"] = to_string(answer.answer.contained);
  if (answer.answer.exhausted) line["exhausted"] = true;
  return line;
}

void sum_up(const PoseQueryOptions& options, std::size_t poses,
            const std::array<std::uint64_t, 5>& by_status) {
  if (options.json) return;
  const auto count = [&](std::size_t i) { return static_cast<unsigned long long>(by_status[i]); };
  std::fprintf(
      stderr,
      "%zu poses by %s: %llu free, %llu contact, %llu contained, %llu partial, %llu uncertain\n",
      poses, options.method.c_str(), count(0), count(1), count(4), count(2), count(3));
}

Status check_world_options(const PoseQueryOptions& options) {
  if (options.method != "certified" && options.method != "full")
    return {StatusCode::kInvalidArgument,
            "--method: of a world expected certified or full, found " + options.method};
  if (options.list_pairs || options.limited || options.method_options.contacts ||
      options.method_options.query.solid_a || options.method_options.query.solid_b ||
      options.method_options.query.max_tests != kAllTests)
    return {
        StatusCode::kUnsupported,
        options.a + ": is a world, of which this command gives status and count of pairs alone"};
  return Status::ok();
}

/// Adds the answer about one tile to that about the world. Tiles have no face in common.
void add_tile(const MethodAnswer& tile, MethodAnswer& sum) {
  if (tile.answer.status != AnswerStatus::kFree) sum.answer.status = tile.answer.status;
  sum.answer.pair_total += tile.answer.pairs.size();
  sum.splits += tile.splits;
  sum.slots += tile.slots;
  sum.bytes += tile.bytes;
  sum.refine_s += tile.refine_s;
  sum.tree_s += tile.tree_s;
  sum.query_s += tile.query_s;
  sum.load_s += tile.load_s;
}

/// A is a world: the query is asked of each tile that boxes do not part from B.
Status query_world(const PoseQueryOptions& options, const std::vector<PoseRow>& poses) {
  NEARMESH_RETURN_IF_ERROR(check_world_options(options));
  const Result<WorldFolder> folder = WorldFolder::open(options.a);
  NEARMESH_RETURN_IF_ERROR(folder);
  const WorldRecord& world = folder.value().world();
  const Result<WorldPage> root = folder.value().root();
  NEARMESH_RETURN_IF_ERROR(root);
  Result<ModelFile> b = ModelFile::open(options.b);
  NEARMESH_RETURN_IF_ERROR(b);
  const SpmHeader& header = b.value().header();
  const GridBox box = LocalModel(b.value().store(), header.grid).view().root().box;
  OpenTiles tiles(folder.value());
  std::array<std::uint64_t, 5> by_status{};
  for (const PoseRow& row : poses) {
    const auto posed_as = [&row, &header](const Grid& grid) -> Result<PosedPair> {
      Result<PosedPair> posed =
          pose_pair(grid, row.a, "A of pose " + row.id, header.grid, row.b, "B of pose " + row.id);
      if (posed.is_ok()) return posed;
      return Status(posed.status().code(), row.place + ": " + posed.status().message());
    };
    const Result<PosedPair> posed = posed_as(world_grid(world));
    NEARMESH_RETURN_IF_ERROR(posed);
    const Result<NearTiles> near =
        find_near_tiles(folder.value(), root.value(), posed.value(), box);
    NEARMESH_RETURN_IF_ERROR(near);
    MethodAnswer sum;
    sum.answer.status = AnswerStatus::kFree;
    for (const WorldEntry& entry : near.value().tiles) {
      const Result<std::shared_ptr<ModelFile>> tile = tiles.open(entry.content);
      NEARMESH_RETURN_IF_ERROR(tile);
      const Result<PosedPair> in_place = posed_as(world.grid_at(entry));
      NEARMESH_RETURN_IF_ERROR(in_place);
      const auto method =
          make_query_method(options.method, *tile.value(), b.value(), options.method_options);
      NEARMESH_RETURN_IF_ERROR(method);
      const Result<MethodAnswer> answer = method.value()->answer(in_place.value());
      NEARMESH_RETURN_IF_ERROR(answer);
      add_tile(answer.value(), sum);
      if (options.method_options.query.any && sum.answer.status == AnswerStatus::kContact) break;
    }
    nlohmann::ordered_json line = to_json(row, sum);
    line["pairs"] = sum.answer.pair_total;
    line["tiles"] = near.value().tiles.size();
    line["pages"] = near.value().pages;
    std::printf("%s\n", text_of(line).c_str());
    if (std::ferror(stdout) != 0) break;  // main says so
    ++by_status[static_cast<std::size_t>(sum.answer.status)];
  }
  sum_up(options, poses.size(), by_status);
  return Status::ok();
}

}  // namespace

Status run(const PoseQueryOptions& options) {
  Result<std::vector<PoseRow>> poses = read_poses(options.poses);
  NEARMESH_RETURN_IF_ERROR(poses);
  if (std::filesystem::is_directory(options.a)) return query_world(options, poses.value());
  Result<ModelFile> a = ModelFile::open(options.a);
  NEARMESH_RETURN_IF_ERROR(a);
  Result<ModelFile> b = ModelFile::open(options.b);
  NEARMESH_RETURN_IF_ERROR(b);
  std::optional<FaceNumbering> numbers_a, numbers_b;
  if (options.list_pairs) {
    Result<FaceNumbering> na = a.value().face_numbering();
    NEARMESH_RETURN_IF_ERROR(na);
    Result<FaceNumbering> nb = b.value().face_numbering();
    NEARMESH_RETURN_IF_ERROR(nb);
    numbers_a = std::move(na).value();
    numbers_b = std::move(nb).value();
  }
  Result<std::unique_ptr<QueryMethod>> method =
      make_query_method(options.method, a.value(), b.value(), options.method_options);
  NEARMESH_RETURN_IF_ERROR(method);

  std::array<std::uint64_t, 5> by_status{};
  for (const PoseRow& row : poses.value()) {
    const Result<PosedPair> posed =
        pose_pair(a.value().header().grid, row.a, "A of pose " + row.id, b.value().header().grid,
                  row.b, "B of pose " + row.id);
    if (!posed.is_ok()) return {posed.status().code(), row.place + ": " + posed.status().message()};
    const Result<MethodAnswer> answer = method.value()->answer(posed.value());
    NEARMESH_RETURN_IF_ERROR(answer);
    nlohmann::ordered_json line = to_json(row, answer.value());
    if (options.list_pairs) {
      std::vector<std::array<std::uint32_t, 2>> faces;
      for (const FacePair& pair : answer.value().answer.pairs)
        faces.push_back({(*numbers_a)[pair.a].face.value, (*numbers_b)[pair.b].face.value});
      std::sort(faces.begin(), faces.end());
      line["faces"] = faces;
    }
    if (options.limited) {
      line["pair_total"] = answer.value().answer.pair_total;
      line["truncated"] = answer.value().answer.truncated;
    }
    if (options.method_options.contacts) {
      const Contacts& contacts = answer.value().contacts;
      line["patches"] = contacts.patches;
      line["position_error_m"] = contacts.position_error_m;
      line["t_contacts_us"] = std::round(answer.value().contacts_s * 1e7) / 10;
    }
    std::printf("%s\n", text_of(line).c_str());
    if (std::ferror(stdout) != 0) break;  // main says so
    ++by_status[static_cast<std::size_t>(answer.value().answer.status)];
  }
  sum_up(options, poses.value().size(), by_status);
  return Status::ok();
}

}  // namespace nearmesh::program
