// What materials' networks read at hits.
#pragma once

#include "core/pattern/patterns.h"
#include "core/trace/trace_scene.h"

namespace encore {

// Appends the point of one hit to a batch. layout: of the material that `point` shows. point: surface() of the hit,
// position_error is not needed. dpdx, dpdy: the pixel's footprint on the surface, world space.
void appendPatternPoint(const TraceScene& trace, const PointLayout& layout, const Hit& hit, const SurfacePoint& point,
                        Vec3f direction, Vec3f dpdx, Vec3f dpdy, PatternPoints& points);

// The shading normal that a normal map asks for, unit, on the outside as point.ns is; point.ns where the hit has no
// tangents. normal: in the tangent frame (PathInputs). texcoord: Patterns::normalTexcoord().
Vec3f mappedNormal(const TraceScene& trace, const Hit& hit, const SurfacePoint& point, const std::string& texcoord,
                   Vec3f normal);

}  // namespace encore
