// Displacement of diced meshes (§3.4).
//
// A vertex moves along the normal of the mesh by what its material says, and by an offset in the mesh's space. Vertices
// that primitives share are one point and move to one place: along the mean of their normals, by the mean of what the
// displaced faces say there, each with texture coordinates of its own. Where a face that is not displaced has the
// point, it stays: undisplaced faces are as flat and as far apart from their neighbours as they were, which is not at
// all. Values that are not finite, or lead to places that are not, count as 0.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/dice/dice.h"
#include "core/dice/facets.h"
#include "core/dice/grids.h"
#include "core/dice/subdivision.h"
#include "core/pattern/patterns.h"
#include "core/scene/mesh.h"

namespace encore {

// Where displacements come from: materials (displacementOf), or closed forms in tests.
class DisplacementSource {
 public:
  virtual ~DisplacementSource() = default;
  virtual bool varies(int32_t material) const = 0;
  virtual const PointLayout& layout(int32_t material) const = 0;    // where it varies
  virtual DisplacementInputs constant(int32_t material) const = 0;  // where it does not
  // values.size() == points.size(). Not thread-safe.
  virtual void evaluate(const PatternPoints& points, std::span<DisplacementInputs> values) = 0;
};

// patterns must outlive the source.
std::unique_ptr<DisplacementSource> displacementOf(Patterns& patterns);

// Per face: its material if that displaces, else -1. Empty: no face is displaced.
std::vector<int32_t> displacingMaterials(const Mesh& mesh, const DisplacementSource& source);

// Moves the vertices of all poses, and makes the normals those of the displaced surface: smooth where they were smooth.
// mesh: what diced was made from; face_materials: of its faces. Returns how many values were not finite.
uint64_t displace(const Mesh& mesh, std::span<const int32_t> face_materials, const Grids& grids,
                  DisplacementSource& source, DicedMesh& diced);

// Dices a mesh that is displaced: its rates hold for the displaced surface within SubdivisionDicer's limits. Polygons
// that are not subdivided are diced where they are displaced.
class DisplacedDicer {
 public:
  // Arguments and errors as diceMesh. face_materials: displacingMaterials(). mesh and source must outlive this.
  DisplacedDicer(const Mesh& mesh, std::vector<int32_t> face_materials, float edge_length, uint64_t max_micropolygons,
                 DisplacementSource& source);

  // As far as is known: dice() may raise it.
  uint64_t micropolygons() const { return dicer_->micropolygons(); }
  // Empty where it would take more than `budget` micropolygons.
  DicedMesh dice(uint64_t budget);

 private:
  const Mesh& mesh() const { return facets_ ? facets_->mesh : mesh_; }

  const Mesh& mesh_;
  std::optional<Facets> facets_;
  std::vector<int32_t> face_materials_;
  DisplacementSource& source_;
  std::unique_ptr<SubdivisionDicer> dicer_;
};

}  // namespace encore
