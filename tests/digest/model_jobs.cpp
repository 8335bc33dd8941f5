// SPDX-License-Identifier: Apache-2.0
// From meshes to models: clean, simplify, bake, encode; what is encoded is decoded again.
#include "core/refine/refined_mesh.hpp"
#include "core/spm/blocks.hpp"
#include "jobs.hpp"
#include "test_models.hpp"

namespace nearmesh::digest_jobs {
namespace {

// Everything that stands in the file: header, blocks with all boxes, face numbers; and the
// clean-up's report.
std::uint64_t baked(const IndexedMesh& mesh, int grid_bits, std::uint32_t base_faces) {
  const Result<CleanResult> clean = clean_mesh(mesh, {.grid_bits = grid_bits});
  if (!clean.is_ok()) return 0;
  Digest digest;
  const CleanReport& report = clean.value().report;
  for (const std::uint64_t x :
       {report.vertices_welded, report.faces_duplicate, report.faces_degenerate_dropped,
        report.faces_degenerate_kept, report.edges_non_manifold, report.components})
    digest.add(x);
  const Result<BakedModel> model =
      bake(clean.value().mesh, report.rounding_error_m, {.base_faces = base_faces});
  digest.add(static_cast<std::uint64_t>(model.status().code()));
  if (!model.is_ok()) return digest.value();
  const auto& [header, store, numbers, log] = model.value();
  digest.add_bytes(encode_header(header));
  for (const NodeSpan& root : block_roots(store))
    for (const auto& bytes :
         encode_batches(header, store, block_treelet(store, root), BoxPolicy::kAllNodes))
      digest.add_bytes(bytes);
  for (const FaceNumber& number : numbers)
    digest.add(std::uint64_t{number.face.value} << 2 | number.first_corner);
  return digest.value();
}

// The whole model in batches of several sizes; the replica that they fill.
std::uint64_t sent(const std::string& name) {
  const BakedModel model = test::bake_named(name);
  LocalModel whole(model.store, model.header.grid);
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store))
    if (!whole.mesh.split(u, delta)) return 0;
  Digest digest;
  for (const std::size_t max_bytes : {std::size_t{100}, std::size_t{400}, kMaxBatchBytes}) {
    RefinedMesh replica(model.header);
    auto batches = encode_batches(model.header, model.store, active_treelet(whole.mesh),
                                  BoxPolicy::kCutNodes, max_bytes);
    Random random(max_bytes);
    test::shuffle(batches, random);
    for (const auto& bytes : batches) {
      digest.add_bytes(bytes);
      const Result<SplitBatch> batch = decode_batch(model.header, bytes);
      if (!batch.is_ok()) return 0;
      const RefinedMesh::Applied applied = replica.apply_batch(batch.value());
      digest.add(static_cast<std::uint64_t>(applied.status.code()));
      for (const VertexId u : applied.delta.split) digest.add(u.value);
      digest.add(replica.mesh().state_hash());
    }
    for (const ActiveFace& face : extract_faces(replica.mesh()))
      for (const VertexId corner : face.corners) digest.add(corner.value);
  }
  return digest.value();
}

// Flipped bits: what a decoder makes of them must not depend on the build either.
std::uint64_t damaged() {
  const BakedModel model = test::bake_named("aircraft");
  Random random(21);
  Digest digest;
  for (const NodeSpan& root : block_roots(model.store)) {
    if (block_level(root.size) > 0) break;
    for (auto bytes : encode_batches(model.header, model.store, block_treelet(model.store, root),
                                     BoxPolicy::kAllNodes, 300))
      for (int i = 0; i < 20; ++i) {
        bytes[random.below(static_cast<std::uint32_t>(bytes.size()))] ^=
            static_cast<std::uint8_t>(1U << random.below(8));
        const Result<SplitBatch> batch = decode_batch(model.header, bytes);
        digest.add(static_cast<std::uint64_t>(batch.status().code()));
        if (!batch.is_ok()) continue;
        RefinedMesh replica(model.header);
        digest.add(static_cast<std::uint64_t>(replica.apply_batch(batch.value()).status.code()));
        digest.add(replica.mesh().state_hash());
      }
  }
  return digest.value();
}

}  // namespace

std::vector<Job> model_jobs() {
  std::vector<Job> jobs;
  for (const std::string& name : test::mesh_names()) {
    jobs.push_back({"bake." + name, [name] { return baked(test::make_mesh(name), 21, 16); }});
    jobs.push_back({"batches." + name, [name] { return sent(name); }});
  }
  jobs.push_back({"bake.terrain_coarse", [] { return baked(generate_terrain(40, 3), 9, 100); }});
  jobs.push_back(
      {"bake.terrain_in_cells", [] { return baked(generate_terrain(240, 3), 21, 256); }});
  jobs.push_back({"bake.aircraft_fine", [] { return baked(generate_aircraft(3000, 5), 31, 256); }});
  jobs.push_back({"bake.flat_sphere", [] {
                    IndexedMesh mesh = generate_sphere(40, 0);
                    for (auto& p : mesh.positions_m) p[2] *= 1e-7;
                    return baked(mesh, 21, 16);
                  }});
  jobs.push_back({"batches.damaged", damaged});
  return jobs;
}

}  // namespace nearmesh::digest_jobs
