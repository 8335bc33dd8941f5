// SPDX-License-Identifier: Apache-2.0
#pragma once
// A session of any length without flying it: peers that circle over a terrain, are sent all of its
// detail little by little, and report at every frame. What a replay or a reader has to go through;
// answers in it are not true.

#include "session_file.hpp"
#include "test_models.hpp"

namespace nearmesh::test {

struct HourOptions {
  double length_s = 3600;
  double rate_hz = 20;
  std::uint32_t peers = 10;
  std::uint32_t terrain_cells = 256;  ///< along a side
  double batch_period_s = 1;          ///< of each peer
};

struct HourFacts {
  std::uint64_t messages = 0, batches = 0, splits = 0;
};

inline HourFacts write_session_hour(const std::string& path, const HourOptions& options) {
  const BakedModel model = bake_mesh(generate_terrain(options.terrain_cells, 3));
  const std::unique_ptr<TempFile> model_file = write_model(model);
  const ModelFile file = ModelFile::open(model_file->path()).value();
  Treelet all;
  for (const VertexId split : all_splits(model.store))
    all.push_back({model.store.node_of(split), split});
  std::sort(all.begin(), all.end(),
            [](const TreeletSplit& a, const TreeletSplit& b) { return a.node < b.node; });
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto has = [&](NodeSpan child) {
      const auto at = std::lower_bound(
          all.begin(), all.end(), child,
          [](const TreeletSplit& s, const NodeSpan& node) { return s.node < node; });
      return at != all.end() && at->node == child;
    };
    all[i].left_included = has(all[i].node.left_of(all[i].split));
    all[i].right_included = has(all[i].node.right_of(all[i].split));
  }
  auto batches = encode_batches(model.header, model.store, all, BoxPolicy::kCutNodes);
  for (auto& bytes : batches) seal_batch(file.content_hash(), bytes);

  SessionFile session(path);
  const auto bytes = file.header_bytes();
  session.add(0, wire::MeshHeader{.name = "terrain",
                                  .content_hash = file.content_hash(),
                                  .bytes = {bytes.begin(), bytes.end()}});
  session.add(0, wire::Hello{.publisher = 1,
                             .models = {{"terrain", file.content_hash(), file.mesh_bytes()}}});
  HourFacts facts{.messages = 2, .splits = all.size()};
  struct Peer {
    std::size_t next_batch = 0;
    std::uint32_t sequence = 0;
    double next_s = 0;
  };
  std::vector<Peer> peers(options.peers);
  const auto frames = static_cast<std::uint64_t>(options.length_s * options.rate_hz);
  for (std::uint64_t frame = 0; frame < frames; ++frame) {
    const double time_s = static_cast<double>(frame) / options.rate_hz;
    for (std::uint32_t i = 0; i < options.peers; ++i) {
      const wire::SessionId id = 100 + i;
      const std::string body = "body" + std::to_string(i);
      Peer& peer = peers[i];
      if (time_s >= peer.next_s) {
        peer.next_s += options.batch_period_s;
        wire::RegionSubscription asked{.peer = id,
                                       .request = ++peer.sequence,
                                       .content_hash = file.content_hash(),
                                       .publisher = 1};
        asked.region.attach = {model.header.roots[0].node};
        asked.region.region = {GridBox{{{0, 0, 0}}, {{1, 1, 1}}}};
        session.add(time_s, asked);
        session.add(time_s, id,
                    wire::SplitBatchMessage{.publisher = 1,
                                            .content_hash = file.content_hash(),
                                            .request = peer.sequence,
                                            .sequence = peer.sequence,
                                            .last = true,
                                            .bytes = batches[peer.next_batch++ % batches.size()]});
        ++facts.batches;
        facts.messages += 2;
      }
      if (frame == 0) {
        session.add(0, wire::BodyDirectory{.peer = id, .bodies = {{0, body, "terrain"}}});
        ++facts.messages;
      }
      wire::BodyPoses poses{.peer = id, .frame = frame, .bodies = {{0, time_s, {}}}};
      poses.bodies[0].motion.pose.translation_m = {time_s, static_cast<double>(i), 0};
      session.add(time_s, poses);
      wire::ContactReport report{
          .peer = id, .body_a = "ground", .body_b = body, .frame = frame, .time_s = time_s};
      session.add(time_s, report);
      facts.messages += 2;
    }
  }
  session.close();
  return facts;
}

}  // namespace nearmesh::test
