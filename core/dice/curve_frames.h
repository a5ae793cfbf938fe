// The cross-sections of a tube or ribbon along a curve.
#pragma once

#include <span>
#include <vector>

#include "core/scene/math.h"

namespace encore {

// A place along a curve where there is a cross-section. Corners have two of them, which differ in `along` alone.
struct CurveRow {
  Vec3d centre{0, 0, 0};
  Vec3d along{0, 0, 0};    // unit, or zero: direction of the curve on this row's side of a corner
  Vec3d through{0, 0, 0};  // unit: what the cross-section is perpendicular to; after completeRows() never zero
  Vec3d mitre{0, 0, 0};    // unit, or zero: the cross-section is mitre_scale times as long that way
  double mitre_scale = 1;
  double radius = 0, slope = 0;  // slope: of the radius per length
  Vec3d side{0, 0, 0};           // unit, perpendicular to through: where the ring begins, or a ribbon's right
};

// Corners are as sharp as this before the cross-section is stretched no more.
inline constexpr double kMostMitre = 2;

// Puts the cross-section in the middle between two directions (unit or zero), so that tubes keep their width on both
// sides of it.
void setMitre(CurveRow& row, Vec3d before, Vec3d after);

// Directions that are zero, where points coincide, become those of their neighbours.
void completeRows(std::span<CurveRow> rows);

// Sides that turn about the curve as little as can be: W. Wang, B. Jüttler, D. Zheng and Y. Liu, "Computation of
// rotation minimizing frames", ACM Transactions on Graphics 27(1), 2008 (double reflection). rows[0].side is given.
// closed: the curve comes back to rows[0]; what the sides are turned by then is taken back evenly, with the number of
// whole turns that is nearest to `twist`, which becomes the angle that was taken back.
void transportSides(std::span<CurveRow> rows, bool closed, double& twist);

// v turned as the unit vector `from` turns into the unit vector `to` the shortest way.
Vec3d turned(Vec3d v, Vec3d from, Vec3d to);
// A unit vector perpendicular to n, near v as far as that is possible. n: unit.
Vec3d perpendicular(Vec3d n, Vec3d v);

}  // namespace encore
