// SPDX-License-Identifier: Apache-2.0
#include "model.hpp"

#include <limits>
#include <utility>
#include <vector>

#include "core/spm/check_boxes.hpp"
#include "core/spm/check_surface.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"

namespace nearmesh::c {
namespace {

constexpr nearmesh_bake_options kBakeDefaults{.size = sizeof(nearmesh_bake_options),
                                              .base_faces = 16,
                                              .grid_bits = 21,
                                              .threads = 0,
                                              .reserved = 0};

Result<IndexedMesh> mesh_of(const double* positions_m, std::size_t vertex_count,
                            const std::uint32_t* faces, std::size_t face_count) {
  NEARMESH_RETURN_IF_ERROR(check_array(positions_m, vertex_count, "positions_m"));
  NEARMESH_RETURN_IF_ERROR(check_array(faces, face_count, "faces"));
  // What follows says where these are too many for a model; this is that the arrays can be as long
  // as they are said to be.
  constexpr std::size_t kMost = std::size_t{1} << 31;
  if (vertex_count > kMost || face_count > kMost)
    return Status{StatusCode::kInvalidArgument, std::to_string(vertex_count) + " vertices and " +
                                                    std::to_string(face_count) +
                                                    " faces, expected 2^31 of each at most"};
  IndexedMesh mesh;
  mesh.positions_m.resize(vertex_count);
  for (std::size_t i = 0; i < vertex_count; ++i)
    std::copy_n(positions_m + 3 * i, 3, mesh.positions_m[i].begin());
  mesh.faces.resize(face_count);
  for (std::size_t i = 0; i < face_count; ++i) std::copy_n(faces + 3 * i, 3, mesh.faces[i].begin());
  return mesh;
}

Status bake_to(IndexedMesh mesh, const std::string& path, const nearmesh_bake_options& options) {
  if (options.base_faces == 0)
    return {StatusCode::kInvalidArgument, "base_faces is 0, expected 1 at least"};
  NEARMESH_RETURN_IF_ERROR(
      check_number(options.grid_bits, kMinGridBits, kMaxGridBits, "grid_bits"));
  const Result<CleanResult> clean = clean_mesh(mesh, {.grid_bits = options.grid_bits});
  NEARMESH_RETURN_IF_ERROR(clean);
  mesh = {};  // the bake needs the memory
  const Result<BakedModel> baked =
      bake(clean.value().mesh, clean.value().report.rounding_error_m,
           {.base_faces = options.base_faces, .threads = options.threads});
  NEARMESH_RETURN_IF_ERROR(baked);
  const BakedModel& model = baked.value();
  NEARMESH_RETURN_IF_ERROR(check_boxes(model.store));
  NEARMESH_RETURN_IF_ERROR(check_surface(model.store));
  return write_model_file(model.header, model.store, model.numbers, path, options.threads).status();
}

/// Of the model, not of a face that it does not have.
Status check_face(const ModelFile& file, const FaceKey& key) {
  const SplitStore& store = file.store();
  const bool is_split = key.split.is_valid() && key.split.value < store.vertex_count() &&
                        store.is_known(key.split) && !store.is_root(key.split);
  const std::size_t count = is_split               ? store.faces(key.split).size()
                            : key.split.is_valid() ? 0
                                                   : store.base_faces().size();
  if (key.index < count) return Status::ok();
  return {StatusCode::kNotFound, file.path() + ": no face " + std::to_string(key.index) +
                                     " of split " + std::to_string(key.split.value)};
}

}  // namespace
}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C

nearmesh_status nearmesh_bake_options_init(nearmesh_bake_options* options, size_t size) noexcept {
  return c::init_options(options, size, c::kBakeDefaults);
}

nearmesh_status nearmesh_bake(const double* positions_m, size_t vertex_count, const uint32_t* faces,
                              size_t face_count, const char* path,
                              const nearmesh_bake_options* options,
                              nearmesh_error* error) noexcept {
  return c::guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(path, "path"));
    nearmesh_bake_options read = c::kBakeDefaults;
    NEARMESH_RETURN_IF_ERROR(c::read_options(options, "nearmesh_bake_options", read));
    Result<IndexedMesh> mesh = c::mesh_of(positions_m, vertex_count, faces, face_count);
    NEARMESH_RETURN_IF_ERROR(mesh);
    return c::bake_to(std::move(mesh).value(), path, read);
  });
}

nearmesh_status nearmesh_model_open(const char* path, nearmesh_model** model,
                                    nearmesh_error* error) noexcept {
  if (model != nullptr) *model = nullptr;
  return c::guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(model, "model"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(path, "path"));
    Result<ModelFile> file = ModelFile::open(path);
    NEARMESH_RETURN_IF_ERROR(file);
    auto opened = std::make_unique<nearmesh_model>();
    opened->shared = std::make_shared<c::SharedModel>(std::move(file).value());
    const ModelFile& of = opened->shared->file;
    opened->content = c::ContentText(of.content_hash());
    opened->facts = c::facts_of(of.header(), opened->content);
    opened->facts.mesh_bytes = of.mesh_bytes();
    opened->facts.file_bytes = of.file_bytes();
    *model = opened.release();
    return Status::ok();
  });
}

void nearmesh_model_close(nearmesh_model* model) noexcept {
  if (!c::is_handle(model)) return;
  model->kind = c::Kind::kNone;
  delete model;
}

const nearmesh_model_facts* nearmesh_model_get_facts(const nearmesh_model* model) noexcept {
  return c::is_handle(model) ? &model->facts : nullptr;
}

nearmesh_status nearmesh_model_check(nearmesh_model* model, int32_t deep,
                                     nearmesh_error* error) noexcept {
  return c::guarded(model, error, [&]() -> Status {
    ModelFile& file = model->shared->file;
    return c::with_files(*model->shared, *model->shared, [&]() -> Status {
      NEARMESH_RETURN_IF_ERROR(file.verify());
      return deep != 0 ? file.check_deep() : Status::ok();
    });
  });
}

nearmesh_status nearmesh_model_face_number(nearmesh_model* model, nearmesh_face face,
                                           uint32_t* number, nearmesh_error* error) noexcept {
  if (number != nullptr) *number = 0;
  return c::guarded(model, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(number, "number"));
    ModelFile& file = model->shared->file;
    return c::with_files(*model->shared, *model->shared, [&]() -> Status {
      if (!model->numbering) {
        Result<FaceNumbering> numbering = file.face_numbering();
        NEARMESH_RETURN_IF_ERROR(numbering);
        model->numbering = std::move(numbering).value();
      }
      const FaceKey key{VertexId{face.split}, face.index};
      NEARMESH_RETURN_IF_ERROR(c::check_face(file, key));
      *number = (*model->numbering)[key].face.value;
      return Status::ok();
    });
  });
}
