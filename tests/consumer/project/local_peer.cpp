// SPDX-License-Identifier: Apache-2.0
// What a host's unit test does: opens a model's file, makes a channel and a session, and updates
// until the answer is certified. No network, no publisher, no DDS.

#include <cstdio>
#include <string>

#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace {

int fail(const std::string& message) {
  std::fprintf(stderr, "%s\n", message.c_str());
  return 1;
}

nearmesh::Status write_sphere(const std::string& path) {
  const auto clean = nearmesh::clean_mesh(nearmesh::generate_sphere(32, 1));
  if (!clean.is_ok()) return clean.status();
  const auto sphere =
      nearmesh::bake(clean.value().mesh, clean.value().report.rounding_error_m, {.base_faces = 64});
  if (!sphere.is_ok()) return sphere.status();
  const auto written = nearmesh::write_model_file(sphere.value().header, sphere.value().store,
                                                  sphere.value().numbers, path);
  return written.is_ok() ? nearmesh::Status::ok() : written.status();
}

}  // namespace

int main(int argc, char** argv) {
  const std::string path = argc > 1 ? argv[1] : "sphere.spm";
  if (const auto status = write_sphere(path); !status.is_ok()) return fail(status.message());

  auto file = nearmesh::ModelFile::open(path);
  if (!file.is_ok()) return fail(file.status().message());
  auto channel = std::make_unique<nearmesh::subscriber::LocalChannel>();
  if (!channel->add_model("sphere", std::move(file).value()).is_ok()) return fail("no model");
  nearmesh::subscriber::Session session(std::move(channel));
  const auto left = session.add_body({.name = "left", .model = "sphere", .own = true}).value();
  const auto right = session.add_body({.name = "right", .model = "sphere", .own = true}).value();
  if (const auto status = session.watch(left, right); !status.is_ok())
    return fail(status.message());

  nearmesh::Motion here, beside;
  beside.pose.translation_m = {1.99, 0.1, 0.05};
  for (int updates = 1; updates <= 10; ++updates) {
    const auto report = session.update(0, 0, {{left, here}, {right, beside}}, 1);
    if (!report.is_ok()) return fail(report.status().message());
    const auto& answer = report.value().find(left, right)->answer;
    std::printf("update %d: %s\n", updates, to_string(answer.status));
    if (is_certified(answer.status)) return updates == 1 ? fail("certain of nothing") : 0;
  }
  return fail("expected a certified answer within 10 updates");
}
