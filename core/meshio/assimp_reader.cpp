// SPDX-License-Identifier: Apache-2.0
#include "assimp_reader.hpp"

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <limits>
#include <string_view>
#include <utility>

namespace nearmesh::meshio {
namespace {

/// x' = m[.][0..2] x + m[.][3], in double: chains of nodes must not lose what the file kept.
struct Transform {
  double m[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};

  [[nodiscard]] std::array<double, 3> apply(const aiVector3D& p) const {
    std::array<double, 3> out{};
    for (std::size_t r = 0; r < 3; ++r)
      out[r] = m[r][0] * p.x + m[r][1] * p.y + m[r][2] * p.z + m[r][3];
    return out;
  }
  [[nodiscard]] bool mirrors() const {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
               m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
               m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) <
           0;
  }
};

Transform compose(const Transform& outer, const aiMatrix4x4& inner) {
  Transform result;
  for (std::size_t r = 0; r < 3; ++r) {
    for (unsigned c = 0; c < 4; ++c) {
      result.m[r][c] = c == 3 ? outer.m[r][3] : 0.0;
      for (unsigned k = 0; k < 3; ++k)
        result.m[r][c] += outer.m[r][k] * static_cast<double>(inner[k][c]);
    }
  }
  return result;
}

class SceneCollector {
 public:
  explicit SceneCollector(const aiScene& scene) : scene_(scene) {}

  Result<IndexedMesh> collect() {
    std::vector<std::pair<const aiNode*, Transform>> stack{{scene_.mRootNode, Transform{}}};
    while (!stack.empty()) {
      const auto [node, parent] = stack.back();
      stack.pop_back();
      const Transform transform = compose(parent, node->mTransformation);
      for (unsigned i = 0; i < node->mNumMeshes; ++i) {
        if (node->mMeshes[i] >= scene_.mNumMeshes)
          return Status(StatusCode::kCorrupt, "assimp: a node names mesh " +
                                                  std::to_string(node->mMeshes[i]) + " of " +
                                                  std::to_string(scene_.mNumMeshes));
        NEARMESH_RETURN_IF_ERROR(add(*scene_.mMeshes[node->mMeshes[i]], transform));
      }
      for (unsigned i = node->mNumChildren; i-- > 0;)
        stack.emplace_back(node->mChildren[i], transform);
    }
    return std::move(out_);
  }

 private:
  Status add(const aiMesh& mesh, const Transform& transform) {
    constexpr auto kMostIndices = std::size_t{std::numeric_limits<std::uint32_t>::max()};
    const std::size_t first = out_.positions_m.size();
    if (mesh.mNumVertices > kMostIndices - first)
      return {StatusCode::kUnsupported, "expected fewer than 2^32 vertices"};
    for (unsigned v = 0; v < mesh.mNumVertices; ++v)
      out_.positions_m.push_back(transform.apply(mesh.mVertices[v]));
    const bool mirrored = transform.mirrors();
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      // Points and lines have no surface. More than three corners remain where assimp's ear cutting
      // gave up: a fan keeps their points.
      for (unsigned k = 2; k < face.mNumIndices; ++k) {
        std::array<std::uint32_t, 3> corners{face.mIndices[0], face.mIndices[k - 1],
                                             face.mIndices[k]};
        for (std::uint32_t& corner : corners) {
          if (corner >= mesh.mNumVertices)
            return {StatusCode::kCorrupt, "assimp: face " + std::to_string(out_.faces.size()) +
                                              " has vertex index " + std::to_string(corner) +
                                              " of " + std::to_string(mesh.mNumVertices)};
          corner += static_cast<std::uint32_t>(first);
        }
        if (mirrored) std::swap(corners[1], corners[2]);
        out_.faces.push_back(corners);
      }
    }
    return Status::ok();
  }

  const aiScene& scene_;
  IndexedMesh out_;
};

}  // namespace

Result<IndexedMesh> read_with_assimp(const std::string& path) {
  Assimp::Importer importer;
  // Without this, files with a skeleton and no surface come back as made-up bones.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_NO_SKELETON_MESHES, true);
  const aiScene* scene = importer.ReadFile(path, aiProcess_Triangulate);
  if (scene == nullptr || scene->mRootNode == nullptr) {
    const std::string_view reason = importer.GetErrorString();
    const bool no_reader = reason.find("No suitable reader") != std::string_view::npos;
    return Status(no_reader ? StatusCode::kUnsupported : StatusCode::kCorrupt,
                  "assimp: " + (reason.empty() ? std::string("no scene") : std::string(reason)));
  }
  return SceneCollector(*scene).collect();
}

}  // namespace nearmesh::meshio
