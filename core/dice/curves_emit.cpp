// From rates to micropolygons: cross-sections first, then the rings of vertices around them.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>

#include "core/dice/curve_geometry.h"
#include "core/dice/curves.h"
#include "core/dice/poses.h"

namespace encore {

// Writes one curve after the other. One per thread.
class CurveDicer::Emitter {
 public:
  Emitter(const CurveDicer& dicer, DicedMesh& out) : dicer_(dicer), mesh_(dicer.mesh_), out_(out) {}

  void emit(const Plan& plan) {
    span_ = plan.span;
    listPlaces();
    emitValues(plan);
    emitTriangles(plan);
    double twist = 0;
    Vec3d through{0, 0, 0}, side{0, 0, 0};  // of the first row in the pose before
    for (size_t pose = 0; pose < poseCount(mesh_); ++pose) {
      findRows(pose);
      if (dicer_.isTube()) {
        CurveRow& first = rows_.front();
        first.side = perpendicular(first.through, pose == 0 ? Vec3d{0, 0, 0} : turned(side, through, first.through));
        transportSides(rows_, closed(), twist);
        through = first.through, side = first.side;
      } else {
        orientRibbon(pose);
      }
      if (closed()) rows_.back().side = rows_.front().side;
      emitRings(plan, pose);
    }
  }

 private:
  struct Place {
    uint32_t segment;
    double t;
  };

  bool closed() const { return isPeriodic(mesh_); }
  bool isCorner(uint32_t segment) const { return dicer_.corners_[span_.first_segment + segment] != 0; }
  // The strip to the row before is missing.
  bool beginsCorner(size_t row) const { return row > 0 && places_[row].t == 0; }

  void listPlaces() {
    places_.clear();
    for (uint32_t s = 0; s < span_.segments; ++s) {
      if (s == 0 || isCorner(s)) places_.push_back({s, 0});
      const uint32_t rate = dicer_.rates_[span_.first_segment + s];
      for (uint32_t i = 1; i <= rate; ++i) places_.push_back({s, double(i) / rate});
    }
  }

  void findRows(size_t pose) {
    rows_.assign(places_.size(), {});
    for (size_t i = 0; i < rows_.size(); ++i) {
      const auto [segment, t] = places_[i];
      CurveRow& row = rows_[i];
      const CurvePlace place = curvePlace(mesh_, span_, segment, t);
      row.centre = curveSum(place.points, posedPoints(mesh_, pose));
      row.radius = curveWidth(mesh_, place) / 2;
      row.slope = radiusSlope(mesh_, span_, segment, t, pose);
      row.along = row.through = curveDirection(mesh_, span_, segment, t, pose);
    }
    for (size_t i = 0; i + 1 < rows_.size(); ++i)
      if (places_[i].t == 1)
        join(rows_[i], beginsCorner(i + 1) ? rows_[i + 1] : rows_[i], places_[i].segment + 1, pose);
    if (closed()) {
      CurveRow &first = rows_.front(), &last = rows_.back();
      last.centre = first.centre, last.radius = first.radius;
      join(last, first, 0, pose);
    }
    completeRows(rows_);
  }

  // Rows at the start of a segment: the one that ends there, and the one that begins there, which may be the same.
  void join(CurveRow& end, CurveRow& begin, uint32_t segment, size_t pose) {
    const uint32_t last = segment == 0 ? span_.segments - 1 : segment - 1;
    const Vec3d before = curveDirection(mesh_, span_, last, 1, pose);
    const Vec3d after = curveDirection(mesh_, span_, segment, 0, pose);
    setMitre(end, before, after);
    setMitre(begin, before, after);
    if (isCorner(segment)) return;
    const double slope = (radiusSlope(mesh_, span_, last, 1, pose) + radiusSlope(mesh_, span_, segment, 0, pose)) / 2;
    end.along = begin.along = end.through;
    end.slope = begin.slope = slope;
  }

  void orientRibbon(size_t pose) {
    Vec3d last{0, 0, 0};
    for (size_t i = 0; i < rows_.size(); ++i) {
      CurveRow& row = rows_[i];
      const Vec3d normal = ribbonNormal(mesh_, curvePlace(mesh_, span_, places_[i].segment, places_[i].t), pose);
      const Vec3d side = cross(normal, row.through);
      row.side = length(side) > 1e-9 * length(normal) ? normalize(side) : perpendicular(row.through, last);
      last = row.side;
    }
  }

  void emitValues(const Plan& plan) {
    size_t vertex = plan.first_vertex;
    for (const Place& at : places_) {
      const CurvePlace place = curvePlace(mesh_, span_, at.segment, at.t);
      const float u = float((double(at.segment) + at.t) / span_.segments);
      const Vec3f color = curveValue(mesh_.display_color, place);
      for (uint32_t k = 0; k <= plan.across; ++k, ++vertex) {
        out_.uv[vertex] = {u, float(double(k) / plan.across)};
        if (!out_.display_color.empty()) out_.display_color[vertex] = color;
      }
      const size_t first = vertex - plan.across - 1;
      for (size_t i = 0; i < mesh_.texcoords.size(); ++i)
        std::fill_n(out_.texcoords[i].begin() + first, plan.across + 1, curveValue(mesh_.texcoords[i], place));
      for (size_t i = 0; i < mesh_.primvars.size(); ++i)
        std::fill_n(out_.primvars[i].begin() + first, plan.across + 1, curveValue(mesh_.primvars[i], place));
    }
  }

  // Around tubes, v turns left seen along the curve, and triangles face outwards; those of ribbons face as the normals.
  void emitTriangles(const Plan& plan) {
    const uint32_t width = plan.across + 1;
    uint32_t* triangle = &out_.triangles[3 * plan.first_triangle];
    for (size_t row = 1; row < places_.size(); ++row) {
      if (beginsCorner(row)) continue;
      for (uint32_t k = 0; k < plan.across; ++k) {
        const uint32_t a = uint32_t(plan.first_vertex + (row - 1) * width) + k, b = a + 1, c = a + width, d = c + 1;
        const bool tube = dicer_.isTube();
        for (const uint32_t corner : {a, tube ? b : c, tube ? c : b, b, tube ? d : c, tube ? c : d})
          *triangle++ = corner;
      }
    }
    const size_t end = size_t(triangle - &out_.triangles[0]) / 3;
    std::fill(out_.triangle_primitive.begin() + plan.first_triangle, out_.triangle_primitive.begin() + end,
              span_.curve);
    out_.primitive_face[span_.curve] = span_.curve;
  }

  void emitRings(const Plan& plan, size_t pose) {
    std::vector<Vec3f>& positions = posedPositions(out_, pose);
    std::vector<Vec3f>& normals = posedNormals(out_, pose);
    size_t vertex = plan.first_vertex;
    for (const CurveRow& row : rows_) {
      if (dicer_.isTube())
        emitRing(row, plan.across, &positions[vertex], &normals[vertex]);
      else
        emitStrip(row, &positions[vertex], &normals[vertex]);
      vertex += plan.across + 1;
    }
  }

  static Vec3d stretched(const CurveRow& row, Vec3d offset) {
    return offset + row.mitre * ((row.mitre_scale - 1) * dot(row.mitre, offset));
  }

  // The polygon's mean width is the tube's: one that is inscribed draws hair up to a fifth too thin.
  static void emitRing(const CurveRow& row, uint32_t around, Vec3f* position, Vec3f* normal) {
    constexpr double kHalfTurn = 3.14159265358979323846;
    const double radius = row.radius * (kHalfTurn / around) / std::sin(kHalfTurn / around);
    const Vec3d up = cross(row.through, row.side);
    for (uint32_t k = 0; k < around; ++k) {
      const double angle = 2 * kHalfTurn * k / around;
      const Vec3d out = stretched(row, row.side * std::cos(angle) + up * std::sin(angle));
      position[k] = toFloat(row.centre + out * radius);
      normal[k] = toFloat(normalize(perpendicular(row.along, out) - row.along * row.slope));
    }
    position[around] = position[0], normal[around] = normal[0];
  }

  static void emitStrip(const CurveRow& row, Vec3f* position, Vec3f* normal) {
    const Vec3d side = row.side * (row.radius * dot(row.side, stretched(row, row.side)));
    position[0] = toFloat(row.centre - side), position[1] = toFloat(row.centre + side);
    normal[0] = normal[1] = toFloat(perpendicular(row.along, cross(row.through, row.side)));
  }

  const CurveDicer& dicer_;
  const Mesh& mesh_;
  DicedMesh& out_;
  CurveSpan span_;
  std::vector<Place> places_;
  std::vector<CurveRow> rows_;
};

DicedMesh CurveDicer::dice() const {
  DicedMesh out;
  const size_t keys = mesh_.motion_points.size();
  out.positions.resize(vertices_), out.normals.resize(vertices_), out.uv.resize(vertices_);
  out.motion_positions.assign(keys, std::vector<Vec3f>(vertices_));
  out.motion_normals.assign(keys, std::vector<Vec3f>(vertices_));
  out.texcoords.assign(mesh_.texcoords.size(), std::vector<Vec2f>(vertices_));
  out.display_color.resize(mesh_.display_color.empty() ? 0 : vertices_);
  out.primvars.assign(mesh_.primvars.size(), std::vector<Vec4f>(vertices_));
  out.triangles.resize(3 * triangles_), out.triangle_primitive.resize(triangles_);
  out.primitive_face.resize(plans_.size());
  out.micropolygons = micropolygons_;
  tbb::parallel_for(tbb::blocked_range<size_t>(0, plans_.size(), 64), [&](const tbb::blocked_range<size_t>& range) {
    Emitter emitter(*this, out);
    for (size_t i = range.begin(); i != range.end(); ++i) emitter.emit(plans_[i]);
  });
  return out;
}

}  // namespace encore
