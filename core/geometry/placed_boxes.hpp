// SPDX-License-Identifier: Apache-2.0
#pragma once
// Eight boxes and slabs of one posed model, seen from both models of a pair: made once a pair of
// poses, tested against many.
// In floats, which hold twice as many lanes as doubles and half as much of the cache; rounded
// outwards, so that "apart" is what it is in lanes.hpp: true of the posed integer geometry. The
// same bits on every machine.

#include "nearmesh/core/geometry/detail/lanes.hpp"

namespace nearmesh {

/// How one model's boxes are placed for one pair of poses. The frames must outlive it.
struct Placing {
  const RelativeFrame& own_in_other;
  float abs_rotation[9];  ///< of own_in_other
  float turned_back[9];   ///< own_in_other's inverse, transposed: turns normals
  float own_room;         ///< what rounding a centre to floats may move it, in own units
  float reach_room;       ///< the same in the other's units, and the slack of posed corners
  float slab_room;        ///< the same and twice the slack
  float cells_ratio;      ///< the other's cell in own cells
  bool has_slabs;         ///< false where cells are so unlike that normals would leave the range

  /// In: a box that holds all that is to be placed.
  Placing(const RelativeFrame& own_in_other_units, const RelativeFrame& other_in_own,
          const GridBox& bounds);
};

struct PlacedBoxes {
  /// In one model's units. A slab is |normal . (x - center) - middle| <= thickness; normal 0: none.
  struct There {
    float center[3][kLanes], half[3][kLanes], normal[3][kLanes], thickness[kLanes];
  };
  There own;    ///< in their own model's units
  There other;  ///< in the other's: what bounds them along its axes, with the slack
  float middle[kLanes];
  float length[kLanes];  ///< |normal|_1 in the other's units, at least
};
/// Triangles: their boxes, with their planes as slabs, and their corners about the centres of
/// these.
struct PlacedFaces {
  PlacedBoxes boxes;
  float corner[3][3][kLanes];  ///< [corner][axis][lane], own units
  float room[kLanes];          ///< what centres and corners may be off, times |axis|_1
};

/// What is certain of pairs of triangles, lane by lane, as bits: triangles_overlap of the posed
/// ones is false, or is true.
/// In neither are pairs within some lattice cells of just touching, and flat ones.
struct PairVerdicts {
  std::uint32_t apart = 0, touching = 0;
};

}  // namespace nearmesh
