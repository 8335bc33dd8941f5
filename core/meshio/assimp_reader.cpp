// SPDX-License-Identifier: Apache-2.0
#include "assimp_reader.hpp"

#include <assimp/config.h>
#include <assimp/importerdesc.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <limits>
#include <string_view>
#include <utility>

#include "conventions.hpp"
#include "gltf_extensions.hpp"

namespace nearmesh::meshio {
namespace {

Transform to_transform(const aiMatrix4x4& matrix) {
  Transform result;
  for (unsigned r = 0; r < 3; ++r)
    for (unsigned c = 0; c < 4; ++c) result.m[r][c] = static_cast<double>(matrix[r][c]);
  return result;
}

class SceneCollector {
 public:
  SceneCollector(const aiScene& scene, const std::string& wanted)
      : scene_(scene), wanted_(wanted) {}

  /// `with_root`: the root's transform is the file's.
  Result<SceneMesh> collect(bool with_root) {
    struct Pending {
      const aiNode* node;
      Transform parent;
      bool taken;
    };
    std::vector<Pending> stack{{scene_.mRootNode, Transform{}, wanted_.empty()}};
    while (!stack.empty()) {
      const Pending next = stack.back();
      const aiNode& node = *next.node;
      stack.pop_back();
      const std::string name(node.mName.data, node.mName.length);
      const bool taken = next.taken || name == wanted_;
      if (!taken && !name.empty() && names_.size() < kMostNames && node.mNumMeshes > 0)
        names_ += (names_.empty() ? "" : ", ") + name;
      found_ = found_ || taken;
      const bool is_own = with_root || &node != scene_.mRootNode;
      const Transform transform =
          is_own ? compose(next.parent, to_transform(node.mTransformation)) : next.parent;
      if (taken) NEARMESH_RETURN_IF_ERROR(add(node, name, transform));
      for (unsigned i = node.mNumChildren; i-- > 0;)
        stack.push_back({node.mChildren[i], transform, taken});
    }
    if (!found_)
      return Status(StatusCode::kNotFound, "no node is named " + wanted_ + "; there are " +
                                               (names_.empty() ? "none with faces" : names_));
    return std::move(out_);
  }

 private:
  static constexpr std::size_t kMostNames = 1000;  // characters in a message

  Status add(const aiNode& node, const std::string& name, const Transform& transform) {
    if (node.mNumMeshes == 0) return Status::ok();
    ScenePart part{name, transform};
    const std::size_t positions = out_.mesh.positions_m.size(), faces = out_.mesh.faces.size();
    for (unsigned i = 0; i < node.mNumMeshes; ++i) {
      if (node.mMeshes[i] >= scene_.mNumMeshes)
        return {StatusCode::kCorrupt, "assimp: a node names mesh " +
                                          std::to_string(node.mMeshes[i]) + " of " +
                                          std::to_string(scene_.mNumMeshes)};
      NEARMESH_RETURN_IF_ERROR(add(*scene_.mMeshes[node.mMeshes[i]]));
    }
    part.position_count = out_.mesh.positions_m.size() - positions;
    part.face_count = out_.mesh.faces.size() - faces;
    out_.parts.push_back(std::move(part));
    return Status::ok();
  }

  Status add(const aiMesh& mesh) {
    constexpr auto kMostIndices = std::size_t{std::numeric_limits<std::uint32_t>::max()};
    auto& [positions_m, faces] = out_.mesh;
    const std::size_t first = positions_m.size();
    if (mesh.mNumVertices > kMostIndices - first)
      return {StatusCode::kUnsupported, "expected fewer than 2^32 vertices"};
    for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
      const aiVector3D& p = mesh.mVertices[v];
      positions_m.push_back({p.x, p.y, p.z});
    }
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      // Points and lines have no surface. More than three corners remain where assimp's ear cutting
      // gave up: a fan keeps their points.
      for (unsigned k = 2; k < face.mNumIndices; ++k) {
        std::array<std::uint32_t, 3> corners{face.mIndices[0], face.mIndices[k - 1],
                                             face.mIndices[k]};
        for (std::uint32_t& corner : corners) {
          if (corner >= mesh.mNumVertices)
            return {StatusCode::kCorrupt, "assimp: face " + std::to_string(faces.size()) +
                                              " has vertex index " + std::to_string(corner) +
                                              " of " + std::to_string(mesh.mNumVertices)};
          corner += static_cast<std::uint32_t>(first);
        }
        faces.push_back(corners);
      }
    }
    return Status::ok();
  }

  const aiScene& scene_;
  const std::string& wanted_;
  std::string names_;  ///< of nodes that were not wanted
  bool found_ = false;
  SceneMesh out_;
};

std::string name_of_reader(const Assimp::Importer& importer) {
  const int index = importer.GetPropertyInteger("importerIndex", -1);
  if (index < 0) return {};
  const aiImporterDesc* description = importer.GetImporterInfo(static_cast<std::size_t>(index));
  return description == nullptr ? "" : description->mName;
}

}  // namespace

Result<SceneMesh> read_with_assimp(const std::string& path, const std::string& node) {
  NEARMESH_RETURN_IF_ERROR(check_gltf_demands(path));
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
  const Result<ReadConvention> convention = find_convention(name_of_reader(importer), *scene, path);
  NEARMESH_RETURN_IF_ERROR(convention);
  Result<SceneMesh> collected =
      SceneCollector(*scene, node).collect(!convention.value().leaves_out_root);
  if (collected.is_ok()) collected.value().convention = convention.value().file;
  return collected;
}

}  // namespace nearmesh::meshio
