// The vertices that are one point of a surface, and normals that are smooth across them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/dice/dice.h"
#include "core/dice/grids.h"

namespace encore {

// Where primitives meet: the vertices at each place of Grids, in the order of primitives.
class Places {
 public:
  struct Member {
    uint32_t vertex, primitive;
  };
  explicit Places(const Grids& grids);
  size_t count() const { return first_.size() - 1; }
  std::span<const Member> members(size_t place) const {
    return {members_.data() + first_[place], first_[place + 1] - first_[place]};
  }

 private:
  std::vector<size_t> first_;
  std::vector<Member> members_;
};

// Per vertex: unit normals of the triangles around it in its own primitive, times their angles there (G. Thürmer and
// C. A. Wüthrich, "Computing vertex normals from polygonal facets", Journal of Graphics Tools 3(1), 1998), added.
std::vector<Vec3f> angleWeightedNormals(const DicedMesh& mesh, const Grids& grids, const std::vector<Vec3f>& positions);

// Unit normals of a displaced surface: those of its facets, corrected by what the facets before displacement lacked, so
// that no displacement leaves normals as they are; the correction fades where it is large (some degrees), unless it is
// authored smoothness that has to be kept. normals, before: those of the surface before it was displaced, unit and
// angle-weighted; after: angle-weighted ones of the displaced surface. Vertices at one place share a normal where
// theirs were the same before. moved: per primitive, whether it is displaced; the others keep theirs.
void displaceNormals(const Places& places, const Grids& grids, std::span<const uint8_t> moved,
                     const std::vector<Vec3f>& before, const std::vector<Vec3f>& after, bool authored,
                     std::vector<Vec3f>& normals);

}  // namespace encore
