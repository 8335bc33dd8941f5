// SPDX-License-Identifier: Apache-2.0
#include "play.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/base/stopwatch.hpp"
#include "fault_of.hpp"
#include "tests/peers/peers.hpp"

namespace nearmesh::chart {
namespace {

struct Truth {
  PosedPair posed;
  Answer answer;  // of the full meshes
  std::set<FaceKey> faces_a;
  Contacts contacts;
  std::uint64_t needed_faces = 0;
};

std::vector<Truth> find_truth(const Scene& scene) {
  const NeededFaces needed(scene);
  std::vector<Truth> all;
  for (const perf::PosePair& poses : scene.poses) {
    Truth truth;
    truth.posed =
        pose_pair(scene.a.baked.header.grid, poses.a, "a", scene.b.baked.header.grid, poses.b, "b")
            .value();
    truth.answer = query(scene.a.tree.view(), truth.posed.a, scene.b.tree.view(), truth.posed.b,
                         {.clearance = Clearance::kNone});
    truth.contacts = find_contacts(scene.a.tree.view(), truth.posed.a, scene.b.tree.view(),
                                   truth.posed.b, truth.answer);
    for (const FacePair& pair : truth.answer.pairs) truth.faces_a.insert(pair.a);
    truth.needed_faces = needed.count(truth.posed);
    all.push_back(std::move(truth));
  }
  return all;
}

struct Found {
  std::array<double, 3> at_m;
  const std::array<double, 3>* normal;
};
std::vector<Found> middles(const Contacts& contacts) {
  std::vector<Found> found;
  for (const ContactPatch& patch : contacts.patches)
    for (std::uint32_t i = patch.first; i < patch.first + patch.count; ++i) {
      const ContactSegment& s = contacts.segments[i];
      Found one{{}, &patch.normal};
      for (std::size_t k = 0; k < 3; ++k) one.at_m[k] = (s.p_m[k] + s.q_m[k]) / 2;
      found.push_back(one);
    }
  return found;
}

struct Errors {
  double position_m = 0, normal_rad = 0;
};
// Means over some 64 of the true contacts, evenly chosen.
Errors errors(const Contacts& truth, const Contacts& guess) {
  const std::vector<Found> there = middles(truth), found = middles(guess);
  Errors sum;
  double count = 0;
  for (std::size_t i = 0; i < there.size(); i += 1 + there.size() / 64) {
    double least = 1e300;
    const Found* nearest = nullptr;
    for (const Found& one : found) {
      double square = 0;
      for (std::size_t k = 0; k < 3; ++k)
        square += (one.at_m[k] - there[i].at_m[k]) * (one.at_m[k] - there[i].at_m[k]);
      if (square < least) {
        least = square;
        nearest = &one;
      }
    }
    double along = 0;
    for (std::size_t k = 0; k < 3; ++k) along += (*nearest->normal)[k] * (*there[i].normal)[k];
    sum.position_m += std::sqrt(least);
    sum.normal_rad += std::acos(std::clamp(along, -1.0, 1.0));
    ++count;
  }
  return {sum.position_m / count, sum.normal_rad / count};
}

struct Row {
  const Scene* scene;
  std::string method, proof, kind;
  std::size_t index = 0;
  std::uint64_t budget = 0, header = 0;
};

// False where the row holds a false certificate.
bool write_row(const Row& row, const State& state, const State& before, const Truth& truth,
               std::FILE* out) {
  const bool touching = !truth.answer.pairs.empty();
  const bool correct = state.answers && !state.pairs.empty() == touching;
  const bool certified = state.claim && is_certified(*state.claim);
  const bool false_certificate =
      certified && !test::contradiction(*state.claim, state.pairs, truth.answer).empty();
  const auto us = [](double now, double then) { return 1e6 * (now - then); };
  std::fprintf(
      out, "%s,%s,%s,%s,%zu,%llu,%llu,%llu,%u,%llu,%llu,%.1f,%.1f,%.1f,%.1f,%s,%d,%d,%d,%d,%d,",
      row.scene->name.c_str(), row.method.c_str(), row.proof.c_str(), row.kind.c_str(), row.index,
      static_cast<unsigned long long>(row.budget), static_cast<unsigned long long>(state.bytes),
      static_cast<unsigned long long>(row.header), state.requests,
      static_cast<unsigned long long>(state.request_bytes),
      static_cast<unsigned long long>(state.splits), us(state.refine_s, before.refine_s),
      us(state.tree_s, before.tree_s), us(state.query_s, before.query_s),
      us(state.load_s, before.load_s), state.claim ? to_string(*state.claim) : "none",
      touching ? 1 : 0, state.answers ? 1 : 0, correct ? 1 : 0, certified ? 1 : 0,
      false_certificate ? 1 : 0);
  std::set<FaceKey> faces_a;
  for (const FacePair& pair : state.pairs) faces_a.insert(pair.a);
  const auto hits = static_cast<double>(std::count_if(
      faces_a.begin(), faces_a.end(), [&](FaceKey key) { return truth.faces_a.contains(key); }));
  if (touching) std::fprintf(out, "%.4f", hits / static_cast<double>(truth.faces_a.size()));
  std::fprintf(out, ",");
  if (!faces_a.empty()) std::fprintf(out, "%.4f", 1 - hits / static_cast<double>(faces_a.size()));
  if (touching && !state.contacts.segments.empty()) {
    const Errors off = errors(truth.contacts, state.contacts);
    std::fprintf(out, ",%.6g,%.6g", off.position_m, off.normal_rad);
  } else {
    std::fprintf(out, ",,");
  }
  std::fprintf(out, ",%llu,%llu,%llu,%d\n", static_cast<unsigned long long>(state.faces_held),
               static_cast<unsigned long long>(state.tree_bytes),
               static_cast<unsigned long long>(truth.needed_faces), state.finished ? 1 : 0);
  return !false_certificate;
}

// 100, 250, 350, 500, 700, ... and where the base meshes are there.
std::vector<std::uint64_t> budgets(std::uint64_t header) {
  std::vector<std::uint64_t> all{100, header};
  for (std::uint64_t bytes = 250; bytes < std::uint64_t{1} << 36; bytes *= 2) {
    all.push_back(bytes);
    all.push_back(bytes * 7 / 5);
  }
  std::sort(all.begin(), all.end());
  return all;
}

std::uint64_t header_bytes(const Scene& scene) {
  return framed(encode_header(scene.a.baked.header).size()) +
         (scene.b_streamed ? framed(encode_header(scene.b.baked.header).size()) : 0);
}

Bodies bodies_in(const Scene& scene, std::size_t i) {
  const perf::PosePair& now = scene.poses[i];
  Bodies bodies{{.pose = now.a}, {.pose = now.b}};
  if (!scene.frames) return bodies;
  const perf::PosePair &before = scene.poses[i == 0 ? 0 : i - 1],
                       &after = scene.poses[i == 0 ? 1 : i];
  bodies = {motion_between(before.a, after.a, kFrame_s),
            motion_between(before.b, after.b, kFrame_s)};
  bodies.a.pose = now.a;
  bodies.b.pose = now.b;
  return bodies;
}

PlayTotals play_method(const Scene& scene, const MethodInfo& info, const std::vector<Truth>& truths,
                       std::FILE* rows) {
  PlayTotals totals;
  const std::unique_ptr<Method> method = info.make(scene);
  const std::uint64_t header = header_bytes(scene);
  const bool rival = info.name.starts_with("clusters-") || info.name == "triangles-trusted";
  const auto write = [&](const char* kind, std::size_t i, std::uint64_t budget, State state,
                         const State& before) {
    ++totals.rows;
    if (!scene.pages.empty()) {  // one after the other, from the root down
      state.bytes += scene.pages[i].bytes;
      state.requests += static_cast<std::uint32_t>(scene.pages[i].count);
    }
    if (!write_row({&scene, info.name, info.proof, kind, i, budget, rival ? 0 : header}, state,
                   before, truths[i], rows))
      ++totals.false_certificates;
  };
  State before;
  if (scene.frames) method->start();
  for (std::size_t i = 0; i < scene.poses.size(); ++i) {
    if (scene.frames) {
      const std::uint64_t budget = kFrameBytes * (i + 1);
      State state = method->receive(bodies_in(scene, i), truths[i].posed, budget);
      write("frame", i, budget, state, before);
      before = std::move(state);
      continue;
    }
    method->start();
    for (const std::uint64_t budget : budgets(header)) {
      const State state = method->receive(bodies_in(scene, i), truths[i].posed, budget);
      write("pose", i, budget, state, {});
      if (state.finished) break;
    }
    method->start();
    constexpr std::uint64_t kAll = std::uint64_t{1} << 40;
    write("whole", i, kAll, method->receive(bodies_in(scene, i), truths[i].posed, kAll), {});
  }
  return totals;
}

// A library with the whole of both meshes: one row a pose.
PlayTotals play_library(const Scene& scene, const peers::PeerInfo& info,
                        const std::vector<Truth>& truths, std::uint64_t whole_bytes,
                        std::FILE* rows) {
  PlayTotals totals;
  Stopwatch watch;
  const std::unique_ptr<peers::Peer> library = info.make(scene.a.mesh, scene.b.mesh);
  State state{.bytes = whole_bytes, .tree_s = watch.seconds(), .answers = true, .finished = true};
  state.faces_held =
      scene.a.baked.header.face_count + (scene.b_streamed ? scene.b.baked.header.face_count : 0);
  State before;
  for (std::size_t i = 0; i < scene.poses.size(); ++i) {
    library->place(scene.poses[i].a, scene.poses[i].b);
    watch.lap();
    const bool touching = library->touches();
    const std::optional<std::uint64_t> pairs = touching ? library->count_pairs() : 0;
    state.query_s = before.query_s + watch.seconds();
    // Which faces a library names is not compared: the true ones stand for "touching".
    state.pairs.clear();
    if (touching)
      state.pairs.push_back(truths[i].answer.pairs.empty() ? FacePair{}
                                                           : truths[i].answer.pairs.front());
    static_cast<void>(pairs);
    write_row({&scene, info.name, "none", scene.frames ? "frame" : "pose", i, whole_bytes, 0},
              state, before, truths[i], rows);
    ++totals.rows;
    before = state;
  }
  return totals;
}

std::uint32_t height(const TreeView& view, const TreeEntry& entry) {
  std::uint32_t below = 0;
  if (entry.kind() == TreeEntry::Kind::kInner)
    view.for_each_child(
        entry, [&](const TreeEntry& child) { below = std::max(below, height(view, child)); });
  return 1 + below;
}

std::uint64_t whole_bytes(const perf::Model& model) {
  ActiveMesh mesh(model.baked.store);
  RefineDelta delta;
  for (const VertexId u : global_order(model.baked.store, 0xffffffffU))
    static_cast<void>(mesh.split(u, delta));
  std::uint64_t bytes = framed(encode_header(model.baked.header).size());
  for (const auto& batch : encode_batches(model.baked.header, model.baked.store,
                                          active_treelet(mesh), BoxPolicy::kCutNodes))
    bytes += batch.size() + kSealBytes + kBatchFramingBytes;
  return bytes;
}

}  // namespace

void write_row_names(std::FILE* rows, std::FILE* models) {
  std::fprintf(rows,
               "scene,method,proof,kind,index,budget_bytes,bytes,header_bytes,requests,request_"
               "bytes,splits,t_r_us,t_b_us,"
               "t_q_us,t_l_us,status,truth,answers,correct,certified,false_certificate,recall,"
               "false_faces,position_error_m,"
               "normal_error_rad,faces_held,tree_bytes,needed_faces,finished\n");
  std::fprintf(models,
               "scene,body,streamed,faces,vertices,base_faces,base_vertices,splits,tree_height,"
               "header_bytes,mesh_bytes\n");
}

void write_models(const Scene& scene, std::FILE* models) {
  for (const auto& [name, model, streamed] :
       {std::tuple("a", &scene.a, true), std::tuple("b", &scene.b, scene.b_streamed)}) {
    const SpmHeader& header = model->baked.header;
    const TreeView view = model->tree.view();
    std::fprintf(models, "%s,%s,%d,%llu,%u,%zu,%zu,%u,%u,%zu,%llu\n", scene.name.c_str(), name,
                 streamed ? 1 : 0,
                 static_cast<unsigned long long>(model == &scene.a && scene.world_faces > 0
                                                     ? scene.world_faces
                                                     : header.face_count),
                 header.vertex_count, header.base_faces.size(), header.roots.size(),
                 header.split_count(), height(view, view.root()), encode_header(header).size(),
                 static_cast<unsigned long long>(whole_bytes(*model)));
  }
}

PlayTotals play(const Scene& scene, const std::vector<std::string>& only, std::FILE* rows) {
  const std::vector<Truth> truths = find_truth(scene);
  const auto wanted = [&only](const std::string& name) {
    return only.empty() || std::find(only.begin(), only.end(), name) != only.end();
  };
  PlayTotals totals;
  const auto add = [&totals](const PlayTotals& more) {
    totals.rows += more.rows;
    totals.false_certificates += more.false_certificates;
  };
  // How cost grows is asked of few methods: the others' is that of the mesh.
  const bool grows = scene.name.starts_with("growth");
  const bool large = scene.a.baked.header.face_count > 2'000'000 || !scene.pages.empty();
  for (const MethodInfo& info : methods()) {
    if (!wanted(info.name) || (info.looks_ahead && !scene.frames)) continue;
    if (grows && info.name != "certified" &&
        (large || (info.name != "static-full" && info.name != "grid8" &&
                   info.name != "clusters-checked" && info.name != "clusters-chosen")))
      continue;
    const Stopwatch watch;
    add(play_method(scene, info, truths, rows));
    std::fprintf(stderr, "  %-18s %6.1f s\n", info.name.c_str(), watch.seconds());
  }
  if (large) return totals;
  std::uint64_t bytes = whole_bytes(scene.a);
  if (scene.b_streamed) bytes += whole_bytes(scene.b);
  for (const peers::PeerInfo& info : peers::timed_peers())
    if (wanted(info.name)) add(play_library(scene, info, truths, bytes, rows));
  return totals;
}

}  // namespace nearmesh::chart
