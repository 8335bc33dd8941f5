// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/header.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <string>

#include "bits.hpp"
#include "coding_sets.hpp"
#include "core/base/digest.hpp"
#include "core/base/float_guard.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {
namespace {

constexpr int kScaleBits = 5;
static_assert(CodingSet::kMaxScale - CodingSet::kMinScale < 1 << kScaleBits);

constexpr std::uint32_t kHeaderMagic = 0x4e4d4837;  // "NMH7"

Status corrupt(const std::string& field) { return {StatusCode::kCorrupt, "mesh header: " + field}; }

// In the place of a length of whole cells: the cells to the origin of a lattice that the model
// shares come first.
constexpr int kOnLattice = 63;

void write_whole(BitWriter& out, double cells) {
  const auto magnitude = static_cast<std::uint64_t>(std::fabs(cells));
  const int length = bit_length(magnitude);
  out.put(static_cast<std::uint64_t>(length), 6);
  if (length == 0) return;
  out.put(cells < 0 ? 1 : 0, 1);
  out.put(magnitude >> 26, std::max(length - 26, 0));
  out.put(magnitude, std::min(length, 26));
}
double read_whole(BitReader& in, int length) {
  if (length == 0) return 0;
  if (length > 53) return std::numeric_limits<double>::quiet_NaN();  // refused as no place
  const bool is_negative = in.get(1) != 0;
  const std::uint64_t high = in.get(std::max(length - 26, 0));
  const auto magnitude = static_cast<double>(high << 26 | in.get(std::min(length, 26)));
  return is_negative ? -magnitude : magnitude;
}

// Origins are whole cells from zero, of 53 bits at most, but for models that are tiny and far away.
void write_origin(BitWriter& out, const Grid& grid, std::size_t axis) {
  const double origin_m = grid.origin_m[axis];
  const int exponent = grid.exponent;
  const double cells = std::ldexp(origin_m, -exponent);
  const bool is_whole = std::fabs(cells) < 0x1p53 && cells == std::floor(cells) &&
                        std::ldexp(cells, exponent) == origin_m &&
                        (cells != 0 || !std::signbit(cells));
  out.put(is_whole ? 1 : 0, 1);
  if (!is_whole) {
    out.put64(std::bit_cast<std::uint64_t>(origin_m));
    return;
  }
  if (grid.lattice_cells[axis] != 0) {
    NEARMESH_ASSERT(is_lattice_place(cells - static_cast<double>(grid.lattice_cells[axis]),
                                     grid.lattice_cells[axis]));
    out.put(kOnLattice, 6);
    write_whole(out, static_cast<double>(grid.lattice_cells[axis]));
  }
  write_whole(out, cells);
}
Status read_origin(BitReader& in, Grid& grid, std::size_t axis) {
  if (in.get(1) == 0) {
    grid.origin_m[axis] = std::bit_cast<double>(in.get64());
    return Status::ok();
  }
  auto length = static_cast<int>(in.get(6));
  if (length == kOnLattice) {
    const double lattice_cells = read_whole(in, static_cast<int>(in.get(6)));
    length = static_cast<int>(in.get(6));
    const double cells = read_whole(in, length);
    if (!(std::fabs(lattice_cells) <= static_cast<double>(kMaxLatticeCells)) ||
        lattice_cells == 0 || !is_lattice_place(cells - lattice_cells, 0))
      return corrupt("the place on a common lattice");
    grid.lattice_cells[axis] = static_cast<std::int64_t>(lattice_cells);
    grid.origin_m[axis] = std::ldexp(cells, grid.exponent);
    return Status::ok();
  }
  grid.origin_m[axis] = std::ldexp(read_whole(in, length), grid.exponent);
  return Status::ok();
}

// The first seed is vertex 0, the first root's place, and takes no bits.
void write_surface(BitWriter& out, const SpmHeader& header) {
  const SurfaceFacts& surface = header.surface;
  NEARMESH_ASSERT(surface.has_seeds() || surface.component_count == 1 ||
                  surface.component_count > kMaxComponentSeeds);
  out.put_gamma(surface.boundary_edges);
  out.put_gamma(surface.disagreeing_edges);
  out.put_gamma(surface.component_count - 1);
  for (std::size_t i = 1; i < surface.component_seeds.size(); ++i)
    for (int k = 0; k < 3; ++k)
      out.put(static_cast<std::uint32_t>(surface.component_seeds[i][k]) >> header.lattice_shift[k],
              header.grid.bits - header.lattice_shift[k]);
}

GridPoint read_position(BitReader& in, const SpmHeader& header) {
  GridPoint position;
  for (int k = 0; k < 3; ++k)
    position[k] = static_cast<std::int32_t>(in.get(header.grid.bits - header.lattice_shift[k])
                                            << header.lattice_shift[k]);
  return position;
}

Status read_surface(BitReader& in, SpmHeader& header) {
  SurfaceFacts& surface = header.surface;
  surface.boundary_edges = static_cast<std::uint32_t>(in.get_gamma());
  surface.disagreeing_edges = static_cast<std::uint32_t>(in.get_gamma());
  const std::uint64_t edges = std::uint64_t{surface.boundary_edges} + surface.disagreeing_edges;
  if (edges > std::uint64_t{header.face_count} * 3)
    return corrupt(std::to_string(edges) + " open edges of " + std::to_string(header.face_count) +
                   " faces");
  const std::uint64_t components = in.get_gamma() + 1;
  if (components > header.vertex_count)
    return corrupt(std::to_string(components) + " parts of " + std::to_string(header.vertex_count) +
                   " vertices");
  surface.component_count = static_cast<std::uint32_t>(components);
  if (components > kMaxComponentSeeds) return Status::ok();
  surface.component_seeds.push_back(header.roots.front().position);
  for (std::uint64_t i = 1; i < components; ++i)
    surface.component_seeds.push_back(read_position(in, header));
  return Status::ok();
}

// The box of each of a base face's three roots encloses the face: they share a point, and hold each
// corner whose place is known, which is that of a root's first vertex.
Status check_base_faces(const SpmHeader& header) {
  const auto grid_max = static_cast<std::int32_t>((std::int64_t{1} << header.grid.bits) - 1);
  for (const SplitFace& face : header.base_faces) {
    GridBox common{{{0, 0, 0}}, {{grid_max, grid_max, grid_max}}};
    std::array<const BaseRoot*, 3> roots{};
    std::size_t next = 0;
    for (const VertexId corner : {face.left, face.right, face.outside}) {
      const auto after =
          std::upper_bound(header.roots.begin(), header.roots.end(), corner,
                           [](VertexId v, const BaseRoot& root) { return v < root.node.first; });
      const BaseRoot& root = *(roots[next++] = &*(after - 1));
      const GridBox box = decode_box(root.position, root.box, grid_max);
      for (int k = 0; k < 3; ++k) {
        common.lo[k] = std::max(common.lo[k], box.lo[k]);
        common.hi[k] = std::min(common.hi[k], box.hi[k]);
      }
    }
    bool holds = true;
    for (int k = 0; k < 3; ++k) {
      holds &= common.lo[k] <= common.hi[k];
      for (const BaseRoot* root : roots) {
        const bool is_corner = root->node.first == face.left || root->node.first == face.right ||
                               root->node.first == face.outside;
        holds &=
            !is_corner || (common.lo[k] <= root->position[k] && root->position[k] <= common.hi[k]);
      }
    }
    if (!holds)
      return corrupt("a base face lies outside the boxes of its roots [" +
                     std::to_string(roots[0]->node.begin()) + "], [" +
                     std::to_string(roots[1]->node.begin()) + "], [" +
                     std::to_string(roots[2]->node.begin()) + "]");
  }
  return Status::ok();
}

struct CornerCoding {
  int root_bits;
  explicit CornerCoding(std::size_t roots) : root_bits(bit_length(roots - 1)) {}
};

void write_coding(BitWriter& out, const CodingTables& tables) {
  const CodingSet set = tables.set();
  out.put_gamma(set.number);
  if (set.number == 0) return write_tables(out, tables);
  out.put(static_cast<std::uint32_t>(set.scale - CodingSet::kMinScale), kScaleBits);
}

Status read_coding(BitReader& in, SharedTables* shared, SpmHeader& header) {
  const std::uint64_t number = in.get_gamma();
  if (number > coding_set_count())
    return corrupt("coding tables: built-in set " + std::to_string(number) + " of " +
                   std::to_string(coding_set_count()));
  const auto find_set = [&] {
    const CodingSet set{static_cast<std::uint32_t>(number),
                        static_cast<int>(in.get(kScaleBits)) + CodingSet::kMinScale};
    return shared != nullptr ? shared->coding_set(set, header.lattice_shift)
                             : coding_set(set, header.lattice_shift);
  };
  std::optional<CodingTables> tables = number == 0 ? read_tables(in) : find_set();
  if (!tables) return corrupt("coding table is not a prefix code");
  header.tables = std::move(*tables);
  return Status::ok();
}

}  // namespace

std::vector<std::uint8_t> encode_header(const SpmHeader& header) {
  const FloatGuard guard;
  BitWriter out;
  out.put(kHeaderMagic, 32);
  out.put64(header.blocks_root.high);
  out.put64(header.blocks_root.low);
  out.put(static_cast<std::uint32_t>(header.grid.exponent + 4096), 14);
  out.put(static_cast<std::uint32_t>(header.grid.bits), 6);
  for (const std::uint8_t shift : header.lattice_shift) out.put(shift, 5);
  for (std::size_t k = 0; k < 3; ++k) write_origin(out, header.grid, k);
  out.put(header.rounding_error_m != 0 ? 1 : 0, 1);
  if (header.rounding_error_m != 0)
    out.put64(std::bit_cast<std::uint64_t>(header.rounding_error_m));
  out.put_count(header.face_count);
  out.put_gamma(header.base_faces.size());
  out.put_gamma(header.roots.size() - 1);
  for (const BaseRoot& root : header.roots) {
    out.put_count(root.node.size);
    for (int k = 0; k < 3; ++k)
      out.put(static_cast<std::uint32_t>(root.position[k]) >> header.lattice_shift[k],
              header.grid.bits - header.lattice_shift[k]);
    for (const std::uint8_t code : root.box) out.put(code, 7);
  }
  const CornerCoding coding(header.roots.size());
  for (const SplitFace& face : header.base_faces) {
    out.put(face.flipped ? 1 : 0, 1);
    for (const VertexId corner : {face.left, face.right, face.outside}) {
      std::size_t r = header.roots.size() - 1;
      for (std::size_t lo = 0, hi = header.roots.size(); lo < hi;) {
        const std::size_t mid = (lo + hi) / 2;
        if (header.roots[mid].node.first <= corner) {
          r = mid;
          lo = mid + 1;
        } else {
          hi = mid;
        }
      }
      const NodeSpan& node = header.roots[r].node;
      out.put(r, coding.root_bits);
      out.put(corner.value - node.begin(), bit_length(node.size - 1));
    }
  }
  write_surface(out, header);
  write_coding(out, header.tables);
  return std::move(out).finish();
}

Result<SpmHeader> decode_header(std::span<const std::uint8_t> bytes, SharedTables* shared) {
  const FloatGuard guard;
  if (bytes.size() > kMaxHeaderBytes)
    return corrupt("size: at most " + std::to_string(kMaxHeaderBytes) + " bytes expected, found " +
                   std::to_string(bytes.size()));
  BitReader in(bytes);
  if (in.get(32) != kHeaderMagic) return corrupt("magic number: not a nearmesh header");
  SpmHeader header;
  header.content = digest_of(bytes);
  header.blocks_root.high = in.get64();
  header.blocks_root.low = in.get64();
  header.grid.exponent = static_cast<int>(in.get(14)) - 4096;
  header.grid.bits = static_cast<int>(in.get(6));
  for (std::uint8_t& shift : header.lattice_shift) shift = static_cast<std::uint8_t>(in.get(5));
  for (std::size_t k = 0; k < 3; ++k) NEARMESH_RETURN_IF_ERROR(read_origin(in, header.grid, k));
  if (in.get(1) != 0) header.rounding_error_m = std::bit_cast<double>(in.get64());
  header.face_count = in.get_count();
  const std::uint64_t base_face_count = in.get_gamma();
  const std::uint64_t root_count = in.get_gamma() + 1;
  for (const double x : header.grid.origin_m)
    if (!std::isfinite(x)) return corrupt("grid origin is not finite");
  if (!std::isfinite(header.rounding_error_m) || header.rounding_error_m < 0)
    return corrupt("rounding error is not a length");
  if (header.grid.bits < kMinGridBits || header.grid.bits > kMaxGridBits)
    return corrupt("grid bits: expected " + std::to_string(kMinGridBits) + " to " +
                   std::to_string(kMaxGridBits) + ", found " + std::to_string(header.grid.bits));
  if (std::abs(header.grid.exponent) > kMaxGridExponent)
    return corrupt("grid exponent: expected within " + std::to_string(kMaxGridExponent) +
                   " of 0, found " + std::to_string(header.grid.exponent));
  for (const std::uint8_t shift : header.lattice_shift)
    if (shift > header.grid.bits) return corrupt("lattice shift exceeds the grid");
  // A root takes at least 47 bits and a base face four: no count can ask for more memory than the
  // bytes justify.
  if (root_count > bytes.size() * 2) return corrupt("root count " + std::to_string(root_count));
  if (base_face_count > header.face_count || base_face_count > bytes.size() * 2)
    return corrupt("base face count " + std::to_string(base_face_count));

  for (std::uint64_t i = 0; i < root_count && !in.overrun(); ++i) {
    BaseRoot root;
    const std::uint32_t size = in.get_count();
    if (size == 0) return corrupt("a root without vertices");
    if (std::uint64_t{header.vertex_count} + size >= kMaxVertices)
      return corrupt("vertex count: roots of " + std::to_string(kMaxVertices) + " and more");
    root.node = {{header.vertex_count}, size};
    header.vertex_count += size;
    root.position = read_position(in, header);
    for (std::uint8_t& code : root.box) {
      code = static_cast<std::uint8_t>(in.get(7));
      if (code > kMaxExtentCode) return corrupt("box extent of a root");
    }
    header.roots.push_back(root);
  }
  const CornerCoding coding(header.roots.size());
  for (std::uint64_t i = 0; i < base_face_count && !in.overrun(); ++i) {
    SplitFace face;
    face.flipped = in.get(1) != 0;
    std::array<std::uint32_t, 3> root{};
    std::size_t k = 0;
    for (VertexId* corner : {&face.left, &face.right, &face.outside}) {
      root[k] = in.get(coding.root_bits);
      if (root[k] >= header.roots.size()) return corrupt("corner of a base face");
      const NodeSpan& node = header.roots[root[k]].node;
      const std::uint32_t offset = in.get(bit_length(node.size - 1));
      if (offset >= node.size) return corrupt("corner of a base face");
      *corner = {node.begin() + offset};
      ++k;
    }
    if (root[0] == root[1] || root[1] == root[2] || root[2] == root[0])
      return corrupt("a base face with two corners in one root");
    header.base_faces.push_back(face);
  }
  if (!in.overrun()) NEARMESH_RETURN_IF_ERROR(check_base_faces(header));
  if (!in.overrun()) NEARMESH_RETURN_IF_ERROR(read_surface(in, header));
  NEARMESH_RETURN_IF_ERROR(read_coding(in, shared, header));
  if (in.overrun() || in.bits_left() >= 8)
    return corrupt("length " + std::to_string(bytes.size()) + " does not match its content");
  return header;
}

Status check_solid(const SurfaceFacts& surface, std::string_view body) {
  if (surface.is_closed()) return Status::ok();
  std::string found;
  if (surface.boundary_edges > 0)
    found = std::to_string(surface.boundary_edges) + " boundary edges";
  if (surface.disagreeing_edges > 0)
    found += (found.empty() ? "" : " and ") + std::to_string(surface.disagreeing_edges) +
             " edges whose faces disagree in orientation";
  return {StatusCode::kInvalidArgument, "body " + std::string(body) +
                                            " cannot be solid: its model has " + found +
                                            ", and an open sheet has no inside"};
}

}  // namespace nearmesh
