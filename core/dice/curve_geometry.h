// Curves as they are evaluated for dicing: directions, widths and the normals of ribbons.
#pragma once

#include <cstddef>

#include "core/dice/curve_basis.h"
#include "core/scene/math.h"

namespace encore {

// Unit direction of a curve at place t of a segment, zero where it does not go anywhere. Where its derivative vanishes,
// the direction into (t < 1/2) or out of the rest of the segment stands in.
Vec3d curveDirection(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t, size_t pose);

// Diameter, at least 0: cubics may leave the range of their values.
double curveWidth(const Mesh& mesh, const CurvePlace& place);
// Sum of widths of vertex interpolation over a stencil: their derivatives.
double widthChange(const Mesh& mesh, const CurveStencil& points);
// Of the radius, per length, within a segment.
double radiusSlope(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t, size_t pose);

// The authored normal, not of unit length.
Vec3d ribbonNormal(const Mesh& mesh, const CurvePlace& place, size_t pose);

}  // namespace encore
