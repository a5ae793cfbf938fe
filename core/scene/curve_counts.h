// How many points and values a curve asks for, as UsdGeomBasisCurves counts them (its class documentation, "Segment
// Indexing" and "Primvar Interpolation").
#pragma once

#include <cstdint>

#include "core/scene/mesh.h"

namespace encore {

inline bool isPeriodic(const Mesh& mesh) { return mesh.wrap == CurveWrap::Periodic; }
// Curves of points that are added before the first and behind the last one; elsewhere, pinned means nonperiodic.
inline bool hasPhantomPoints(const Mesh& mesh) {
  return mesh.wrap == CurveWrap::Pinned && (mesh.basis == CurveBasis::BSpline || mesh.basis == CurveBasis::CatmullRom);
}
// From one segment's first point to the next one's.
inline int32_t vstep(CurveBasis basis) { return basis == CurveBasis::Bezier ? 3 : 1; }
// Points of one segment.
inline int32_t segmentPoints(CurveBasis basis) { return basis == CurveBasis::Linear ? 2 : 4; }

// Whether a curve of so many points can be drawn.
inline bool isCurveCount(const Mesh& mesh, int32_t points) {
  if (isPeriodic(mesh)) return points >= (mesh.basis == CurveBasis::Linear ? 3 : 1) && points % vstep(mesh.basis) == 0;
  if (hasPhantomPoints(mesh)) return points >= 2;
  const int32_t first = segmentPoints(mesh.basis);
  return points >= first && (points - first) % vstep(mesh.basis) == 0;
}

// Precondition of both: isCurveCount().
inline int32_t segmentCount(const Mesh& mesh, int32_t points) {
  if (isPeriodic(mesh)) return points / vstep(mesh.basis);
  if (hasPhantomPoints(mesh)) return points - 1;
  return (points - segmentPoints(mesh.basis)) / vstep(mesh.basis) + 1;
}
inline int32_t varyingCount(const Mesh& mesh, int32_t points) {
  return segmentCount(mesh, points) + (isPeriodic(mesh) ? 0 : 1);
}

}  // namespace encore
