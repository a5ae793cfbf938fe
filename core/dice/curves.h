// Dicing of curves, as REYES does: tubes, or ribbons where the curves have normals, of micropolygons.
//
// A primitive, within which shading is reused, is one whole curve: u runs along it from 0 to 1, every segment the same
// share, v around the tube or across the ribbon. Segments of hair are far smaller than the spacing of shading samples,
// and would hardly ever find one of their own. Tubes are open at their ends, as Hydra draws them: one looks into them.
#pragma once

#include <cstdint>
#include <vector>

#include "core/dice/curve_basis.h"
#include "core/dice/curve_frames.h"
#include "core/dice/dice.h"
#include "core/scene/mesh.h"

namespace encore {

class CurveDicer {
 public:
  // Finds the rates. Arguments and errors as diceMesh. Rates hold in all poses:
  // along, a row at both ends of every segment, and so many between that the polyline leaves the curve, and the width
  // what it is along the curve, by at most edge_length / 8. Rows are at most edge_length apart where the curve is as
  // wide as that, and edge_length (edge_length / width)² where it is thinner;
  // around, two for every edge_length of the circumference, from kLeastAround (hair) to kMostAround (smooth normals do
  // the rest).
  CurveDicer(const Mesh& mesh, float edge_length, uint64_t max_micropolygons);

  uint64_t micropolygons() const { return micropolygons_; }
  DicedMesh dice() const;

  static constexpr uint32_t kLeastAround = 3, kMostAround = 24;

 private:
  struct Plan {
    CurveSpan span;
    uint32_t across = 1;  // micropolygons around or across
    uint64_t rows = 0;
    uint64_t first_vertex = 0, first_triangle = 0;
  };
  class Emitter;

  bool isTube() const { return mesh_.normals.empty(); }
  void listCurves();
  void findRates(Plan& plan);
  uint32_t segmentRate(const CurveSpan& span, uint32_t segment, double width) const;
  bool isCorner(const CurveSpan& span, uint32_t segment) const;
  double widthOf(const CurveSpan& span) const;
  void count();

  const Mesh& mesh_;
  double edge_length_;
  uint64_t max_micropolygons_;
  std::vector<Plan> plans_;
  std::vector<uint32_t> rates_;   // per segment of all curves
  std::vector<uint8_t> corners_;  // per segment: whether its start is a corner
  uint64_t micropolygons_ = 0, vertices_ = 0, triangles_ = 0;
};

}  // namespace encore
