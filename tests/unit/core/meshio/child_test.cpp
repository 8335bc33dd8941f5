// SPDX-License-Identifier: Apache-2.0
#include "core/meshio/child.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <stdexcept>
#include <thread>

#include "nearmesh/core/mesh/generate.hpp"

namespace nearmesh::meshio {
namespace {

constexpr ChildLimits kLimits{.memory_bytes = 1ULL << 30, .wall_time = std::chrono::seconds(60)};

TEST(RunInChild, ReturnsTheMesh) {
  const IndexedMesh mesh = generate_terrain(200, 1);  // larger than a pipe holds

  const auto result =
      run_in_child([&mesh] { return Result<SceneMesh>(SceneMesh{.mesh = mesh}); }, kLimits);

  ASSERT_TRUE(result.is_ok()) << result.status().message();
  EXPECT_EQ(result.value().mesh.positions_m, mesh.positions_m);
  EXPECT_EQ(result.value().mesh.faces, mesh.faces);
}

TEST(RunInChild, ReturnsWhatIsSaidOfAGrid) {
  const ImportedTerrain terrain{.columns = 3,
                                .rows = 4,
                                .posts_without_data = 5,
                                .unmatched_nodata = -9999,
                                .fill = -1.5,
                                .height_unit_is_assumed = true,
                                .frame = TerrainFrame::kEnu,
                                .enu_origin_deg = {47, 11},
                                .stated_crs = "WGS 84"};
  const auto result = run_in_child(
      [&terrain] {
        return Result<SceneMesh>(SceneMesh{.mesh = generate_sphere(4, 0), .terrain = terrain});
      },
      kLimits);

  ASSERT_TRUE(result.is_ok()) << result.status().message();
  ASSERT_TRUE(result.value().terrain);
  const ImportedTerrain& found = *result.value().terrain;
  EXPECT_EQ(found.columns, terrain.columns);
  EXPECT_EQ(found.rows, terrain.rows);
  EXPECT_EQ(found.posts_without_data, terrain.posts_without_data);
  EXPECT_EQ(found.unmatched_nodata, terrain.unmatched_nodata);
  EXPECT_EQ(found.fill, terrain.fill);
  EXPECT_TRUE(found.height_unit_is_assumed);
  EXPECT_EQ(found.frame, terrain.frame);
  EXPECT_EQ(found.enu_origin_deg, terrain.enu_origin_deg);
  EXPECT_EQ(found.stated_crs, terrain.stated_crs);
  EXPECT_EQ(result.value().mesh.faces, generate_sphere(4, 0).faces);
}

TEST(RunInChild, ReturnsTheReadersStatus) {
  const auto result = run_in_child(
      [] { return Result<SceneMesh>(Status(StatusCode::kUnsupported, "strange")); }, kLimits);

  ASSERT_FALSE(result.is_ok());
  EXPECT_EQ(result.status().code(), StatusCode::kUnsupported);
  EXPECT_EQ(result.status().message(), "strange");
}

TEST(RunInChild, TurnsACrashIntoAStatus) {
  const auto result = run_in_child(
      []() -> Result<SceneMesh> {
        signal(SIGABRT, SIG_DFL);
        std::abort();
      },
      kLimits);

  ASSERT_FALSE(result.is_ok());
  EXPECT_EQ(result.status().code(), StatusCode::kCorrupt);
  EXPECT_NE(result.status().message().find("crashed"), std::string::npos);
}

TEST(RunInChild, TurnsASilentExitIntoAStatus) {
  const auto result = run_in_child([]() -> Result<SceneMesh> { _exit(0); }, kLimits);

  ASSERT_FALSE(result.is_ok());
  EXPECT_EQ(result.status().code(), StatusCode::kCorrupt);
}

TEST(RunInChild, TurnsAnExceptionIntoAStatus) {
  const auto result = run_in_child(
      []() -> Result<SceneMesh> { throw std::runtime_error("no such luck"); }, kLimits);

  ASSERT_FALSE(result.is_ok());
  EXPECT_NE(result.status().message().find("no such luck"), std::string::npos);
}

TEST(RunInChild, StopsAReaderThatHangs) {
  const auto begin = std::chrono::steady_clock::now();
  const auto result = run_in_child(
      []() -> Result<SceneMesh> {
        for (;;) pause();
      },
      {.memory_bytes = 1 << 30, .wall_time = std::chrono::seconds(1)});

  ASSERT_FALSE(result.is_ok());
  EXPECT_NE(result.status().message().find("stopped after 1 s"), std::string::npos);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
}

TEST(RunInChild, RefusesAMeshLargerThanItsLimit) {
  IndexedMesh mesh = generate_terrain(200, 1);  // moved, it needs no memory of the child

  const auto result =
      run_in_child([&mesh] { return Result<SceneMesh>(SceneMesh{.mesh = std::move(mesh)}); },
                   {.memory_bytes = 100'000, .wall_time = std::chrono::seconds(60)});

  ASSERT_FALSE(result.is_ok());
  EXPECT_NE(result.status().message().find("should hold"), std::string::npos);
}

// Sanitizers reserve terabytes, and their allocators are not made safe for a fork among threads.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(RunInChild, StopsAReaderThatTakesTooMuchMemory) {
  const auto result = run_in_child(
      []() -> Result<SceneMesh> {
        SceneMesh mesh;
        mesh.mesh.positions_m.resize(3ULL << 30 >> 4);  // 4.5 GiB
        return mesh;
      },
      kLimits);

  ASSERT_FALSE(result.is_ok());
  EXPECT_NE(result.status().message().find("memory"), std::string::npos);
}

TEST(RunInChild, ServesSeveralThreadsAtOnce) {
  const IndexedMesh mesh = generate_terrain(64, 1);
  std::atomic<int> good = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int k = 0; k < 5; ++k) {
        const auto result =
            run_in_child([&mesh] { return Result<SceneMesh>(SceneMesh{.mesh = mesh}); }, kLimits);
        if (result.is_ok() && result.value().mesh.faces == mesh.faces) ++good;
      }
    });
  for (std::thread& thread : threads) thread.join();

  EXPECT_EQ(good, 20);
}
#endif

}  // namespace
}  // namespace nearmesh::meshio
