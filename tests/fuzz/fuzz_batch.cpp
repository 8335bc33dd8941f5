// SPDX-License-Identifier: Apache-2.0
// What a hostile publisher can do to a peer: batches of any bytes, or true batches with some bits
// changed, applied to a replica of a small model; and what a hostile peer can do to a publisher:
// requests of any content. Holds: what is not refused leaves a replica in order, and its tree
// answers as one made afresh.

#include "core/demand/collect.hpp"
#include "core/refine/refined_mesh.hpp"
#include "core/spm/packed_region.hpp"
#include "fuzz_models.hpp"

using namespace nearmesh;

namespace {

constexpr int kMaxOperations = 16;

/// A true batch for some node of the model with up to three bits changed.
std::vector<std::uint8_t> make_batch(const fuzz::FullModel& model, fuzz::FuzzInput& in) {
  const SplitStore& store = model.store();
  RegionRequest request;
  NodeSpan node = store.roots()[in.below(static_cast<std::uint32_t>(store.roots().size()))].node;
  for (std::uint8_t way = in.byte(); way > 1 && node.size > 2; way /= 2) {
    const VertexId split = store.split_of(node);
    const NodeSpan left = node.left_of(split), right = node.right_of(split);
    node = (way % 2 == 0 && left.size > 1) || right.size < 2 ? left : right;
  }
  if (node.size < 2) return {};
  request.attach = {node};
  request.region = {GridBox{{{0, 0, 0}}, {{store.grid_max(), store.grid_max(), store.grid_max()}}}};
  request.max_splits = 1 + in.below(64);
  const Result<Demand> demand = collect(store, request, {}, AttachRule::kAlways);
  FUZZ_CHECK(demand.is_ok());
  const std::uint8_t policy = in.byte();
  auto batches = encode_batches(model.header(), store, demand.value().treelet,
                                static_cast<BoxPolicy>(policy & 1U), 16 + policy);
  FUZZ_CHECK(!batches.empty());
  std::vector<std::uint8_t> bytes = std::move(batches[policy / 2 % batches.size()]);
  for (int changes = in.byte() % 4; changes > 0; --changes)
    bytes[in.below(static_cast<std::uint32_t>(bytes.size()))] ^=
        static_cast<std::uint8_t>(1U << in.below(8));
  return bytes;
}

class Peer {
 public:
  explicit Peer(const fuzz::FullModel& model)
      : model_(model), replica_(model.header()), tree_(replica_.mesh()) {}

  void receive(std::span<const std::uint8_t> bytes) {
    const Result<SplitBatch> batch = decode_batch(replica_.header(), bytes);
    if (!batch.is_ok()) return;
    const RefinedMesh::Applied applied = replica_.apply_batch(batch.value());
    FUZZ_CHECK(applied.status.is_ok() || !applied.status.message().empty());
    tree_.update(applied.delta);
  }
  void collapse(std::uint32_t vertex, std::uint32_t steps, bool forget) {
    const ActiveMesh& mesh = replica_.mesh();
    NodeSpan node = mesh.current_node(mesh.active_predecessor({vertex % model_.vertex_count()}));
    for (; steps > 0 && mesh.store().parent_of(node).size > 0; --steps)
      node = mesh.store().parent_of(node);
    tree_.update(replica_.collapse(node));
    if (forget && mesh.is_current(node)) replica_.forget(node);
  }
  void check(std::uint32_t pose) const {
    fuzz::check_mesh(replica_.mesh());
    const fuzz::FullModel& other = fuzz::models().front();
    const PosedPair posed = fuzz::make_pair(model_, other, pose);
    const auto ask = [&](const AbTree& tree) {
      return digest(query(tree.view(model_.header().grid), posed.a, other.tree.view(), posed.b));
    };
    FUZZ_CHECK(ask(tree_) == ask(AbTree(replica_.mesh())));
  }
  [[nodiscard]] const SplitStore& store() const { return replica_.store(); }

 private:
  const fuzz::FullModel& model_;
  RefinedMesh replica_;
  AbTree tree_;
};

/// A request as a stranger may send it, to one who holds all and to one who holds a part.
void ask(const fuzz::FullModel& model, const SplitStore& partial, fuzz::FuzzInput& in) {
  RegionRequest request;
  for (int n = in.byte() % 8; n > 0; --n)
    request.attach.push_back({{in.number<std::uint16_t>() % (model.vertex_count() + 4U)},
                              in.byte() % (model.vertex_count() + 4U)});
  for (int n = in.byte() % 8; n > 0; --n) {
    GridBox box;
    for (int k = 0; k < 3; ++k) {
      box.lo[k] = in.number<std::int32_t>() >> in.below(32);
      box.hi[k] = in.number<std::int32_t>() >> in.below(32);
    }
    RegionPart part(box);
    if (in.byte() % 2 == 1) {
      part.radius = in.number<std::int32_t>() >> in.below(32);
      part.min_extent = in.number<std::int32_t>() >> in.below(32);
      for (std::int8_t& along : part.normal) along = in.number<std::int8_t>();
      part.slab_lo = in.number<std::int32_t>() >> in.below(32);
      part.slab_hi = in.number<std::int32_t>() >> in.below(32);
    }
    request.region.push_back(part);
  }
  request.max_splits = in.number<std::uint16_t>();
  if (!check_request(model.store(), request).is_ok()) return;
  const Result<std::vector<RegionPart>> arrived = unpack_region(pack_region(request.region));
  FUZZ_CHECK(arrived.is_ok());
  FUZZ_CHECK(pack_region(arrived.value()).parts == pack_region(request.region).parts);
  for (std::size_t i = 0; i < request.region.size(); ++i)
    FUZZ_CHECK(arrived.value()[i].box.contains(request.region[i].box));
  request.region = arrived.value();
  for (const SplitStore* store : {&model.store(), &partial}) {
    const auto require = [](NodeSpan) { return Status::ok(); };
    const Result<Demand> demand = collect(*store, request, require);
    if (!demand.is_ok()) continue;
    FUZZ_CHECK(demand.value().treelet.size() <= request.max_splits);
    static_cast<void>(
        encode_batches(model.header(), *store, demand.value().treelet, BoxPolicy::kCutNodes));
  }
  static_cast<void>(unresolved_in(partial, request.region, kMaxAttachNodes));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  const std::uint8_t choice = in.byte();
  const fuzz::FullModel& model = fuzz::models()[choice % fuzz::models().size()];
  Peer peer(model);
  for (int i = 0; i < kMaxOperations && !in.is_empty(); ++i) {
    switch (in.byte() % 8) {
      case 0:
        peer.receive(in.bytes(in.byte()));
        break;
      case 1: {
        const auto vertex = in.number<std::uint16_t>();
        const std::uint8_t steps = in.byte();
        peer.collapse(vertex, steps % 8, steps >= 128);
        break;
      }
      case 2:
        ask(model, peer.store(), in);
        break;
      case 3:
        peer.check(in.byte() % 16);
        break;
      default:
        peer.receive(make_batch(model, in));
    }
  }
  peer.check(choice % 16);
  return 0;
}
