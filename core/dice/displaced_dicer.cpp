// DisplacedDicer, and displacement from materials.
#include <utility>

#include "core/dice/displacement.h"

namespace encore {
namespace {

// Dicing, displacing and measuring: each round corrects what the one before it did not see, because it was coarser.
constexpr int kRounds = 3;

class MaterialSource : public DisplacementSource {
 public:
  explicit MaterialSource(Patterns& patterns) : patterns_(patterns) {}

  bool varies(int32_t material) const override { return patterns_.varies(PatternPart::Displacement, material); }
  const PointLayout& layout(int32_t material) const override {
    return patterns_.layout(PatternPart::Displacement, material);
  }
  DisplacementInputs constant(int32_t material) const override { return patterns_.constantDisplacement(material); }
  void evaluate(const PatternPoints& points, std::span<DisplacementInputs> values) override {
    patterns_.evaluate(points, values);
  }

 private:
  Patterns& patterns_;
};

}  // namespace

std::unique_ptr<DisplacementSource> displacementOf(Patterns& patterns) {
  return std::make_unique<MaterialSource>(patterns);
}

std::vector<int32_t> displacingMaterials(const Mesh& mesh, const DisplacementSource& source) {
  const auto displaces = [&](int32_t material) {
    if (source.varies(material)) return true;
    const DisplacementInputs constant = source.constant(material);
    return constant.along_normal != 0 || constant.offset != Vec3f{0, 0, 0};
  };
  const bool by_default = displaces(mesh.material);
  std::vector<int32_t> materials(mesh.face_vertex_counts.size(), by_default ? mesh.material : -1);
  bool any = by_default;
  int32_t known = -1;
  bool known_displaces = false;
  for (size_t face = 0; face < mesh.face_materials.size(); ++face) {
    const int32_t material = mesh.face_materials[face];
    if (material < 0) continue;
    if (material != known) known_displaces = displaces(known = material);
    materials[face] = known_displaces ? material : -1;
    any |= known_displaces;
  }
  if (!any) materials.clear();
  return materials;
}

DisplacedDicer::DisplacedDicer(const Mesh& mesh, std::vector<int32_t> face_materials, float edge_length,
                               uint64_t max_micropolygons, DisplacementSource& source)
    : mesh_(mesh), face_materials_(std::move(face_materials)), source_(source) {
  DicingExtras extras;
  if (mesh.scheme == SubdivisionScheme::None) {
    facets_ = diceableFacets(mesh);
    extras.normals = facets_->normals;
    std::vector<int32_t> materials;
    for (const uint32_t face : facets_->face) materials.push_back(face_materials_[face]);
    face_materials_ = std::move(materials);
  }
  const bool wished = mesh.scheme == SubdivisionScheme::Bilinear && mesh.target_edge_length_world > 0;
  if (this->mesh().scheme == SubdivisionScheme::Bilinear && !wished)
    for (const int32_t material : face_materials_) extras.diced_faces.push_back(material >= 0);
  dicer_ = std::make_unique<SubdivisionDicer>(this->mesh(), edge_length, max_micropolygons, std::move(extras));
}

DicedMesh DisplacedDicer::dice(uint64_t budget) {
  for (int round = 0;; ++round) {
    if (micropolygons() > budget) return {};
    Grids grids;
    DicedMesh diced = dicer_->dice(&grids);
    diced.lost_displacements = displace(mesh(), face_materials_, grids, source_, diced);
    if (round < kRounds && dicer_->refine(diced, grids)) continue;
    if (facets_)
      for (uint32_t& face : diced.primitive_face) face = facets_->face[face];
    return diced;
  }
}

}  // namespace encore
