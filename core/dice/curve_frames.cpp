#include "core/dice/curve_frames.h"

#include <algorithm>
#include <cmath>

namespace encore {
namespace {

// Beyond it, "perpendicular" is what rounding makes of it.
constexpr double kParallel = 1e-9;

Vec3d anyPerpendicular(Vec3d n) {
  const Vec3d a = absolute(n);
  const Vec3d axis = a.x <= a.y && a.x <= a.z ? Vec3d{1, 0, 0} : a.y <= a.z ? Vec3d{0, 1, 0} : Vec3d{0, 0, 1};
  return normalize(cross(n, axis));
}

Vec3d reflected(Vec3d v, Vec3d across, double square) { return v - across * (2 / square * dot(across, v)); }

Vec3d nextSide(const CurveRow& from, const CurveRow& to) {
  Vec3d side = from.side, through = from.through;
  const Vec3d step = to.centre - from.centre;
  if (const double square = dot(step, step); square > 0) {
    side = reflected(side, step, square), through = reflected(through, step, square);
    const Vec3d rest = to.through - through;
    if (const double rest_square = dot(rest, rest); rest_square > 0) side = reflected(side, rest, rest_square);
  } else {
    side = turned(side, through, to.through);
  }
  return perpendicular(to.through, side);
}

Vec3d rotated(Vec3d v, Vec3d axis, double angle) {
  return v * std::cos(angle) + cross(axis, v) * std::sin(angle);  // v is perpendicular to the axis
}

}  // namespace

Vec3d perpendicular(Vec3d n, Vec3d v) {
  const Vec3d rest = v - n * dot(n, v);
  return length(rest) > kParallel * length(v) ? normalize(rest) : anyPerpendicular(n);
}

Vec3d turned(Vec3d v, Vec3d from, Vec3d to) {
  const Vec3d sum = from + to;
  const double square = dot(sum, sum);
  if (square < kParallel) return v;
  return reflected(reflected(v, from, 1), sum, square);
}

void setMitre(CurveRow& row, Vec3d before, Vec3d after) {
  if (dot(before, before) == 0) before = after;
  if (dot(after, after) == 0) after = before;
  const Vec3d sum = before + after;
  const double half = length(sum) / 2;  // cosine of half the angle
  row.mitre = {0, 0, 0}, row.mitre_scale = 1;
  if (half < kParallel) {
    row.through = before;
    return;
  }
  row.through = normalize(sum);
  if (half > 1 - 1e-12) return;
  row.mitre = normalize(after - before);
  row.mitre_scale = std::min(1 / half, kMostMitre);
}

void completeRows(std::span<CurveRow> rows) {
  const auto fillFrom = [](CurveRow& row, Vec3d CurveRow::*direction, Vec3d& last) {
    if (dot(row.*direction, row.*direction) > 0)
      last = row.*direction;
    else
      row.*direction = last;
  };
  const auto fill = [&](Vec3d CurveRow::*direction) {
    Vec3d last{0, 0, 0};
    for (CurveRow& row : rows) fillFrom(row, direction, last);
    last = {0, 0, 1};  // of a curve that is one point
    for (size_t i = rows.size(); i-- > 0;) fillFrom(rows[i], direction, last);
  };
  fill(&CurveRow::through);
  fill(&CurveRow::along);
}

void transportSides(std::span<CurveRow> rows, bool closed, double& twist) {
  for (size_t i = 1; i < rows.size(); ++i) rows[i].side = nextSide(rows[i - 1], rows[i]);
  if (!closed) return;
  const CurveRow &first = rows.front(), &last = rows.back();
  const Vec3d arrived = perpendicular(first.through, turned(last.side, last.through, first.through));
  const double found =
      std::atan2(dot(cross(arrived, first.side), first.through), dot(arrived, first.side));  // takes it back
  constexpr double kTurn = 2 * 3.14159265358979323846;
  twist = found + kTurn * std::round((twist - found) / kTurn);
  double whole = 0;
  for (size_t i = 1; i < rows.size(); ++i) whole += length(rows[i].centre - rows[i - 1].centre);
  double gone = 0;
  for (size_t i = 1; i < rows.size() && whole > 0; ++i) {
    gone += length(rows[i].centre - rows[i - 1].centre);
    rows[i].side = rotated(rows[i].side, rows[i].through, twist * gone / whole);
  }
}

}  // namespace encore
