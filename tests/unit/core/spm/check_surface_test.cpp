// SPDX-License-Identifier: Apache-2.0
#include "core/spm/check_surface.hpp"

#include "test_models.hpp"

namespace nearmesh {
namespace {

TEST(CheckSurface, FindsWhatBakingWrote) {
  for (const std::string& name : test::mesh_names()) {
    const Status status = check_surface(test::bake_named(name).store);
    EXPECT_TRUE(status.is_ok()) << name << ": " << status.message();
  }
}

/// A model whose header says something else of its surface, every hash right.
void expect_refused(BakedModel model, const std::string& why) {
  const auto file = test::write_model(model);
  Result<ModelFile> opened = ModelFile::open(file->path());
  ASSERT_TRUE(opened.is_ok());
  EXPECT_TRUE(opened.value().verify().is_ok());
  const Status status = opened.value().check_deep();
  EXPECT_EQ(status.code(), StatusCode::kCorrupt);
  EXPECT_NE(status.message().find(why), std::string::npos) << status.message();
}

TEST(CheckSurface, RefusesASheetThatIsSaidToBeClosed) {
  BakedModel model = test::bake_named("terrain");
  ASSERT_GT(model.header.surface.boundary_edges, 0U);
  model.header.surface.boundary_edges = 0;
  expect_refused(std::move(model), "0 edges with one face, the faces have ");
}

TEST(CheckSurface, RefusesEdgesThatAreSaidToDisagree) {
  BakedModel model = test::bake_named("sphere");
  ++model.header.surface.disagreeing_edges;
  expect_refused(std::move(model), "1 edges whose faces disagree, the faces have 0");
}

TEST(CheckSurface, RefusesAPartThatIsNotNamed) {
  BakedModel model = test::bake_named("components");
  SurfaceFacts& surface = model.header.surface;
  ASSERT_GT(surface.component_seeds.size(), 1U);
  surface.component_seeds.pop_back();
  --surface.component_count;
  expect_refused(std::move(model), " parts, the faces have ");
}

TEST(CheckSurface, RefusesASeedElsewhere) {
  BakedModel model = test::bake_named("components");
  SurfaceFacts& surface = model.header.surface;
  std::swap(surface.component_seeds[1], surface.component_seeds.back());
  ASSERT_GT(surface.component_seeds.size(), 2U);
  expect_refused(std::move(model), "seeds are not the lowest vertices");
}

}  // namespace
}  // namespace nearmesh
