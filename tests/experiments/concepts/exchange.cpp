// SPDX-License-Identifier: Apache-2.0
#include "exchange.hpp"

#include <unistd.h>

#include <cmath>
#include <filesystem>

#include "core/certificate/certificate.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"

namespace nearmesh::concepts {
namespace {

BakedModel bake_mesh(const IndexedMesh& mesh, std::uint32_t base_faces) {
  const CleanResult clean = std::move(clean_mesh(mesh)).value();
  return std::move(bake(clean.mesh, clean.report.rounding_error_m, {.base_faces = base_faces}))
      .value();
}

/// Lowers a body onto another: from above, in steps of 1 m, until it touches, and so many steps
/// more.
Status lower(const Body& ground, Body& body, int steps_more) {
  const TriangleTree a = *build_full_tree(ground.full.header, ground.full.store);
  const TriangleTree b = *build_full_tree(body.full.header, body.full.store);
  double& z = body.motion.pose.translation_m[2];
  for (z = 2000; z > -2000; z -= 1) {
    const Result<PosedPair> posed = pose_pair(ground.grid(), ground.motion.pose, ground.name,
                                              body.grid(), body.motion.pose, body.name);
    if (!posed.is_ok()) return posed.status();
    const Answer answer = query(a.view(), posed.value().a, b.view(), posed.value().b,
                                {.any = true, .clearance = Clearance::kNone});
    if (answer.status != AnswerStatus::kContact) continue;
    z -= steps_more;
    return Status::ok();
  }
  return {StatusCode::kNotFound, "the bodies do not touch"};
}

/// A model's file in a folder of its own, gone with this.
class Shelf {
 public:
  Shelf()
      : folder_(std::filesystem::temp_directory_path() /
                ("nearmesh_concepts_" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(folder_);
  }
  Shelf(const Shelf&) = delete;
  ~Shelf() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  Result<ModelFile> put(const Body& body) const {
    const std::string path = folder_ / (body.name + ".spm");
    const auto written =
        write_model_file(body.full.header, body.full.store, body.full.numbers, path);
    if (!written.is_ok()) return written.status();
    return ModelFile::open(path);
  }

 private:
  std::filesystem::path folder_;
};

}  // namespace

Body::Body(std::string its_name, BakedModel model, const Place& at_m)
    : name(std::move(its_name)), full(std::move(model)) {
  motion.pose.translation_m = at_m;
}

Place Body::place(const std::array<double, 3>& grid_units) const {
  Place out;
  for (std::size_t k = 0; k < 3; ++k)
    out[k] = grid().origin_m[k] + std::ldexp(grid_units[k], grid().exponent) +
             motion.pose.translation_m[k];
  return out;
}

std::vector<Face> full_faces(const SplitStore& store) {
  std::vector<Face> faces;
  for (std::uint32_t i = 0; i < store.base_faces().size(); ++i)
    faces.push_back({{{}, i}, store.base_faces()[i].corners()});
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
    if (!store.is_known({v}) || store.is_root({v})) continue;
    const SplitFaces own = store.faces({v});
    for (std::uint32_t i = 0; i < own.size(); ++i) faces.push_back({{{v}, i}, own[i].corners()});
  }
  return faces;
}

std::vector<Face> faces_now(const ActiveMesh& mesh) {
  std::vector<Face> faces;
  for (const ActiveFace& face : extract_faces(mesh))
    faces.push_back({face.key, face.corners, mesh.is_exact(mesh.store().face(face.key))});
  return faces;
}

std::vector<Unresolved> unresolved_nodes(const ActiveMesh& mesh) {
  std::vector<Unresolved> nodes;
  for (std::uint32_t v = 0; v < mesh.store().vertex_count();) {
    const NodeSpan node = mesh.current_node({v});
    if (node.size > 1) {
      const std::span<const HalfSpace> told = mesh.half_spaces().of(node.first);
      nodes.push_back({node, mesh.store().box(node), {told.begin(), told.end()}});
    }
    v = node.end();
  }
  return nodes;
}

Result<Exchange> exchange(Body ground, Body other) {
  const Shelf shelf;
  Result<ModelFile> file_a = shelf.put(ground), file_b = shelf.put(other);
  if (!file_a.is_ok()) return file_a.status();
  if (!file_b.is_ok()) return file_b.status();
  Exchange out{std::move(ground), std::move(other), {}, {}, {}, {}};
  Body* const bodies[] = {&out.ground, &out.other};
  ModelFile* const files[] = {&file_a.value(), &file_b.value()};

  for (std::size_t i = 0; i < 2; ++i)
    bodies[i]->held = std::make_unique<Replica>(files[i]->header());

  const Result<PosedPair> posed = pose_pair(out.ground.grid(), out.ground.motion.pose, "ground",
                                            out.other.grid(), out.other.motion.pose, "other");
  if (!posed.is_ok()) return posed.status();
  const auto ask = [&] {
    return query(out.ground.held->view(), posed.value().a, out.other.held->view(), posed.value().b);
  };
  out.first = ask();

  CertificateRequest request;
  for (std::size_t i = 0; i < 2; ++i)
    request.models.push_back({files[i]->content_hash(), bodies[i]->held->mesh().state_hash(), {}});
  request.pairs = {relative(out.ground.motion, out.other.motion)};
  request.pairs[0].b = 1;
  Mirrors mirrors;
  BegunCertificate begun = begin_certificate(1, request, mirrors, [&](const ContentHash& content) {
    return std::shared_ptr<ModelFile>(std::shared_ptr<ModelFile>(),
                                      files[content == files[0]->content_hash() ? 0 : 1]);
  });
  if (!begun.maker) return Status{StatusCode::kNotFound, begun.why_not};
  while (!begun.maker->is_done()) {
    Result<CertificateMaker::Part> part = begun.maker->next();
    if (!part.is_ok()) return part.status();
    for (std::vector<std::uint8_t>& batch : part.value().batches) {
      seal_batch(part.value().content, batch);
      out.sent_bytes += batch.size();
      Body& body = *bodies[part.value().content == files[0]->content_hash() ? 0 : 1];
      NEARMESH_RETURN_IF_ERROR(body.held->take(batch).status);
    }
  }
  out.answer = ask();
  out.contacts = find_contacts(out.ground.held->view(), posed.value().a, out.other.held->view(),
                               posed.value().b, out.answer);

  const TriangleTree full_a = *build_full_tree(out.ground.full.header, out.ground.full.store);
  const TriangleTree full_b = *build_full_tree(out.other.full.header, out.other.full.store);
  out.truth = query(full_a.view(), posed.value().a, full_b.view(), posed.value().b);
  return out;
}

Body make_ground(std::uint32_t size, std::uint64_t seed, std::uint32_t base_faces,
                 double steepness) {
  IndexedMesh ground = generate_terrain(size, seed);
  for (auto& p : ground.positions_m) p[2] *= steepness;
  return {"ground", bake_mesh(ground, base_faces), {}};
}

Body make_ball(std::uint32_t slices, double radius_m, const Place& centre_m) {
  IndexedMesh ball = generate_sphere(slices, 0);
  for (auto& p : ball.positions_m)
    for (double& x : p) x *= radius_m;
  return {"ball", bake_mesh(ball, 16), centre_m};
}

Result<Exchange> ball_on_hill() {
  Body ground = make_ground(32, 7, 16, 3);
  Body ball = make_ball(32, 64, {40, 0, 0});
  if (const Status lowered = lower(ground, ball, 3); !lowered.is_ok()) return lowered;
  return exchange(std::move(ground), std::move(ball));
}

Result<Exchange> ball_on_patch() {
  Body ground = make_ground(6, 7, 4, 3);
  Body ball = make_ball(8, kPatchBall_m, {58, 40, 0});
  if (const Status lowered = lower(ground, ball, 3); !lowered.is_ok()) return lowered;
  return exchange(std::move(ground), std::move(ball));
}

}  // namespace nearmesh::concepts
