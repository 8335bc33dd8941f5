// SPDX-License-Identifier: Apache-2.0
#include "nearmesh_system.hpp"

#include <algorithm>
#include <cmath>

#include "core/base/random.hpp"
#include "fault_of.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh_questions.hpp"

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;

Status nothing_to_require(NodeSpan) { return Status::ok(); }

NearmeshAnswer refused() { return {.verdict = {.kind = Kind::kRefused}}; }

Verdict to_verdict(const Answer& answer) {
  Verdict verdict;
  switch (answer.status) {
    case AnswerStatus::kFree:
      verdict.kind = Kind::kFree;
      break;
    case AnswerStatus::kContact:
      verdict.kind = Kind::kTouches;
      break;
    case AnswerStatus::kPartial:  // exact pairs prove the contact; how many there are is open
      verdict.kind = Kind::kTouches;
      return verdict;
    case AnswerStatus::kUncertain:
      verdict.kind = Kind::kUndecided;
      return verdict;
    case AnswerStatus::kContained:  // of solids alone, which are asked for elsewhere
      verdict.kind = Kind::kContradicts;
      return verdict;
  }
  verdict.has_pairs = true;
  verdict.pairs = answer.pairs.size();
  verdict.says_incomplete = answer.truncated;
  return verdict;
}

/// About half of the splits, in runs of ids as blocks bring them; what rests on a lost one comes
/// with its parents.
std::vector<VertexId> random_splits(const SplitStore& store, Random& random) {
  std::vector<VertexId> chosen;
  std::uint32_t v = 0;
  while (v < store.vertex_count()) {
    const std::uint32_t run = 1 + random.below(1 + store.vertex_count() / 8);
    const std::uint32_t end = std::min(store.vertex_count(), v + run);
    if (random.below(2) == 0)
      for (std::uint32_t u = v; u < end; ++u)
        if (!store.is_root({u})) chosen.push_back({u});
    v = end;
  }
  return chosen;
}

PairList input_pairs(const Model& a, const Model& b, const std::vector<FacePair>& pairs) {
  const FaceNumbering of_a(a.baked.store, a.baked.numbers), of_b(b.baked.store, b.baked.numbers);
  PairList list;
  for (const FacePair& pair : pairs)
    list.emplace_back(of_a[pair.a].face.value, of_b[pair.b].face.value);
  std::sort(list.begin(), list.end());
  return list;
}

/// A mesh may be a single point here, and then the rest of what fault_of asks for is no fault.
std::string fault_in(const char* which, const Answer& answer, const Answer& full) {
  const std::string fault = test::contradiction(answer.status, answer.pairs, full);
  return fault.empty() ? "" : std::string(which) + ": " + fault;
}

NearmeshAnswer ask_surfaces(const Case& asked, const Model& model_a, const Model& model_b,
                            const PosedPair& posed) {
  const BakedModel &baked_a = model_a.baked, &baked_b = model_b.baked;
  LocalModel a(baked_a.store, baked_a.header.grid), b(baked_b.store, baked_b.header.grid);
  refine(a, every_split(baked_a.store));
  refine(b, every_split(baked_b.store));
  const Answer full = query(a.view(), posed.a, b.view(), posed.b);
  NearmeshAnswer out{.verdict = to_verdict(full),
                     .pairs = input_pairs(model_a, model_b, full.pairs)};
  const auto note = [&out](const std::string& trouble) {
    if (out.trouble.empty()) out.trouble = trouble;
  };
  if (!is_certified(full.status)) note("the full meshes' answer is not certified");

  const Answer any = query(a.view(), posed.a, b.view(), posed.b, {.any = true});
  if (any.status != full.status) note("the first pair's answer differs");
  if (asked.question == Question::kLimit)
    out.verdict =
        to_verdict(query(a.view(), posed.a, b.view(), posed.b, {.max_pairs = asked.limit}));

  for (const bool from_base : {true, false}) {
    const char* which = from_base ? "certify from the base" : "certify from a random state";
    Random random(asked.name.size() + full.pairs.size());
    LocalModel part_a(baked_a.store, baked_a.header.grid),
        part_b(baked_b.store, baked_b.header.grid);
    if (!from_base) {
      refine(part_a, random_splits(baked_a.store, random));
      refine(part_b, random_splits(baked_b.store, random));
    }
    note(fault_in("a partial state", query(part_a.view(), posed.a, part_b.view(), posed.b), full));
    const Result<Answer> certified =
        certify(part_a, posed.a, nothing_to_require, part_b, posed.b, nothing_to_require, {});
    if (!certified.is_ok()) {
      note(std::string(which) + ": " + certified.status().message());
    } else if (!is_certified(certified.value().status)) {
      note(std::string(which) + ": not certified");
    } else {
      note(fault_in(which, certified.value(), full));
    }
  }
  return out;
}

NearmeshAnswer ask_stream(const Case& asked, const Model& model_a, const Model& model_b,
                          const PosedPair& posed) {
  LocalModel a(model_a.baked.store, model_a.baked.header.grid);
  LocalModel b(model_b.baked.store, model_b.baked.header.grid);
  refine(a, asked.held_a);
  refine(b, every_split(model_b.baked.store));
  NearmeshAnswer out{.verdict = to_verdict(query(a.view(), posed.a, b.view(), posed.b))};
  // What is missing comes at last, and then the answer stands.
  const Result<Answer> certified =
      certify(a, posed.a, nothing_to_require, b, posed.b, nothing_to_require, {});
  if (!certified.is_ok()) {
    out.trouble = certified.status().message();
  } else if ((certified.value().status == AnswerStatus::kContact) != asked.touches) {
    out.trouble = "certify says " + std::string(to_string(certified.value().status));
  }
  return out;
}

NearmeshAnswer ask_file(const Case& asked) {
  const Result<IndexedMesh> mesh = import_mesh(asked.path);
  if (!mesh.is_ok()) return refused();
  const auto model = build_model(mesh.value(), asked.base_faces);
  if (!model.is_ok()) return refused();
  return {.verdict = {.kind = Kind::kFree}};
}

NearmeshAnswer ask(const Case& asked) {
  if (asked.question == Question::kFile) return ask_file(asked);
  const auto a =
      asked.model_a ? Result(asked.model_a) : build_model(*asked.a.mesh, asked.base_faces);
  if (!a.is_ok()) return refused();
  const auto b = build_model(*asked.b.mesh, asked.base_faces);
  if (!b.is_ok()) return refused();
  const Model &model_a = *a.value(), &model_b = *b.value();
  const Result<PosedPair> posed = pose_pair(model_a.baked.header.grid, asked.a.pose, "a",
                                            model_b.baked.header.grid, asked.b.pose, "b");
  if (!posed.is_ok()) return refused();
  switch (asked.question) {
    case Question::kStream:
      return ask_stream(asked, model_a, model_b, posed.value());
    case Question::kSolids:
      return ask_solids(asked, model_a, model_b, posed.value());
    case Question::kSweep:
      return ask_sweep(asked, model_a, model_b);
    case Question::kBounds:
      return ask_bounds(model_a);
    case Question::kIncremental:
      return ask_incremental(asked, model_a, model_b, posed.value());
    case Question::kContacts:
      return ask_contacts(asked, model_a, model_b, posed.value());
    default:
      return ask_surfaces(asked, model_a, model_b, posed.value());
  }
}

}  // namespace

Result<std::shared_ptr<const Model>> build_model(const IndexedMesh& mesh,
                                                 std::uint32_t base_faces) {
  Result<CleanResult> clean = clean_mesh(mesh);
  if (!clean.is_ok()) return clean.status();
  Result<BakedModel> baked =
      bake(clean.value().mesh, clean.value().report.rounding_error_m, {.base_faces = base_faces});
  if (!baked.is_ok()) return baked.status();
  return std::make_shared<const Model>(
      Model{std::move(clean.value().mesh), std::move(baked).value()});
}

void refine(LocalModel& model, const std::vector<VertexId>& splits) {
  RefineDelta delta;
  for (const VertexId u : splits) {
    [[maybe_unused]] const bool done = model.mesh.split(u, delta);
    NEARMESH_ASSERT(done);
  }
  model.tree.update(delta);
}

std::vector<VertexId> every_split(const SplitStore& store) {
  return global_order(store, 0xffffffffU);
}

IndexedMesh held_mesh(const Model& model, const std::vector<VertexId>& held) {
  const SplitStore& store = model.baked.store;
  const Grid& grid = model.baked.header.grid;
  ActiveMesh mesh(store);
  RefineDelta delta;
  for (const VertexId u : held) {
    [[maybe_unused]] const bool done = mesh.split(u, delta);
    NEARMESH_ASSERT(done);
  }
  IndexedMesh out;
  std::vector<std::uint32_t> place(store.vertex_count(), 0xffffffffU);
  for (const ActiveFace& face : extract_faces(mesh)) {
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      const VertexId v = face.corners[k];
      if (place[v.value] == 0xffffffffU) {
        place[v.value] = static_cast<std::uint32_t>(out.positions_m.size());
        std::array<double, 3> at = grid.origin_m;
        for (int i = 0; i < 3; ++i)
          at[static_cast<std::size_t>(i)] += std::ldexp(store.position(v)[i], grid.exponent);
        out.positions_m.push_back(at);
      }
      corners[k] = place[v.value];
    }
    out.faces.push_back(corners);
  }
  return out;
}

NearmeshAnswer ask_nearmesh(const Case& asked) {
  NearmeshAnswer out = ask(asked);
  if (!out.trouble.empty()) out.verdict = {.kind = Kind::kContradicts};
  return out;
}

}  // namespace nearmesh::stability
