// The grids of a subdivision mesh: SubdivisionDicer::dice.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <array>
#include <limits>
#include <string>
#include <vector>

#include "core/dice/micropolygon_cap.h"
#include "core/dice/subdivision.h"

namespace encore {
namespace {

// Derivatives whose cross product is this small against their lengths say nothing about the normal.
constexpr double kDegenerateSine = 1e-6;

Vec3d vec3(const double* v) { return {v[0], v[1], v[2]}; }

// Zero where the derivatives are degenerate.
Vec3f surfaceNormal(Vec3d du, Vec3d dv, bool left_handed) {
  const Vec3d normal = cross(du, dv);
  if (!(dot(normal, normal) > kDegenerateSine * kDegenerateSine * dot(du, du) * dot(dv, dv))) return {0, 0, 0};
  return toFloat(normalize(left_handed ? -normal : normal));
}

}  // namespace

// Writes primitives into their places in the arrays; one per task.
struct SubdivisionDicer::Emitter {
  const SubdivisionDicer& dicer;
  DicedMesh& out;
  LimitSurface surface;
  std::vector<LimitPrimvar<Vec2f>::Evaluator> texcoords;
  std::vector<LimitPrimvar<Vec3f>::Evaluator> display_color;
  TessellationLines lines;
  std::vector<ParamCoord> coords;
  std::vector<uint32_t> indices;

  Emitter(const SubdivisionDicer& d, DicedMesh& o) : dicer(d), out(o), surface(d.positionSurface()) {
    for (const auto& primvar : d.texcoords_) texcoords.emplace_back(primvar, d.topology_);
    for (const auto& primvar : d.display_color_) display_color.emplace_back(primvar, d.topology_);
  }

  void bind(int32_t face) {
    surface.bind(face);
    for (auto& primvar : texcoords) primvar.bind(face);
    for (auto& primvar : display_color) primvar.bind(face);
  }

  void emit(uint32_t index, size_t first_vertex, size_t first_triangle) {
    const Primitive& primitive = dicer.primitives_[index];
    const Tessellation t = dicer.tessellation(primitive);
    findLines(primitive, t);
    t.coordinates(lines, coords);
    t.triangles(lines, indices);
    bool degenerate = false;
    for (size_t i = 0; i < coords.size(); ++i) {
      emitVertex(primitive.corner, coords[i], first_vertex + i);
      degenerate |= out.normals[first_vertex + i] == Vec3f{0, 0, 0};
    }
    copySharedPositions(primitive, t, first_vertex);
    emitTriangles(index, first_vertex, first_triangle);
    if (degenerate) repairNormals(first_vertex, first_triangle);
    out.primitive_face[index] = uint32_t(primitive.face);
  }

  void findLines(const Primitive& primitive, const Tessellation& t) {
    for (int s = 0; s < t.sideCount(); ++s)
      dicer.shared_.parameters(dicer.shared_.side(primitive.face, primitive.corner, s), lines.sides[s]);
    lines.u = primitive.lattice ? primitive.lattice->u : uniformParameters(t.nu);
    lines.v = primitive.lattice ? primitive.lattice->v : uniformParameters(t.nv);
  }

  void emitVertex(int32_t corner, ParamCoord at, size_t vertex) {
    double p[3], du[3], dv[3];
    surface.evaluate(corner, at, p, du, dv);
    out.positions[vertex] = toFloat(vec3(p));
    out.normals[vertex] = surfaceNormal(vec3(du), vec3(dv), dicer.mesh_.left_handed);
    out.uv[vertex] = {float(at.u), float(at.v)};
    for (size_t i = 0; i < texcoords.size(); ++i) out.texcoords[i][vertex] = texcoords[i](corner, at);
    if (!display_color.empty()) out.display_color[vertex] = display_color[0](corner, at);
  }

  void copySharedPositions(const Primitive& primitive, const Tessellation& t, size_t vertex) {
    for (int s = 0; s < t.sideCount(); ++s) {
      const PrimitiveSide side = dicer.shared_.side(primitive.face, primitive.corner, s);
      for (uint32_t i = 0; i < side.count; ++i) out.positions[vertex++] = dicer.shared_.point(side, i);
    }
  }

  void emitTriangles(uint32_t index, size_t first_vertex, size_t first_triangle) {
    const bool flip = dicer.mesh_.left_handed;
    uint32_t* triangle = &out.triangles[3 * first_triangle];
    for (size_t i = 0; i < indices.size(); i += 3, triangle += 3) {
      triangle[0] = uint32_t(first_vertex + indices[i]);
      triangle[1] = uint32_t(first_vertex + indices[i + (flip ? 2 : 1)]);
      triangle[2] = uint32_t(first_vertex + indices[i + (flip ? 1 : 2)]);
      out.triangle_primitive[first_triangle + i / 3] = index;
    }
  }

  // Poles and collapsed edges: the mean normal of the facets around, of the whole primitive where those
  // have no area either, and any unit vector where nothing has.
  void repairNormals(size_t first_vertex, size_t first_triangle) {
    std::vector<Vec3d> sums(coords.size(), {0, 0, 0});
    Vec3d total{0, 0, 0};
    for (size_t i = 0; i < indices.size(); i += 3) {
      const uint32_t* v = &out.triangles[3 * first_triangle + i];
      const Vec3d p0 = toDouble(out.positions[v[0]]);
      const Vec3d area = cross(toDouble(out.positions[v[1]]) - p0, toDouble(out.positions[v[2]]) - p0);
      total += area;
      for (int k = 0; k < 3; ++k) sums[v[k] - first_vertex] += area;
    }
    for (size_t i = 0; i < coords.size(); ++i) {
      Vec3f& normal = out.normals[first_vertex + i];
      if (normal != Vec3f{0, 0, 0}) continue;
      const Vec3d mean = length(sums[i]) > 0 ? sums[i] : length(total) > 0 ? total : Vec3d{0, 0, 1};
      normal = toFloat(normalize(mean));
    }
  }
};

DicedMesh SubdivisionDicer::dice() const {
  std::vector<size_t> first_vertex(primitives_.size() + 1, 0), first_triangle(primitives_.size() + 1, 0);
  for (size_t i = 0; i < primitives_.size(); ++i) {
    const Tessellation t = tessellation(primitives_[i]);
    first_vertex[i + 1] = first_vertex[i] + t.vertexCount();
    first_triangle[i + 1] = first_triangle[i] + t.triangleCount();
  }
  const size_t vertices = first_vertex.back(), triangles = first_triangle.back();
  if (vertices > std::numeric_limits<uint32_t>::max())
    throw overMicropolygonCap(
        mesh_, "the mesh makes " + std::to_string(vertices) + " vertices, more than 32-bit indices reach");
  DicedMesh out;
  out.positions.resize(vertices);
  out.normals.resize(vertices);
  out.uv.resize(vertices);
  out.texcoords.assign(texcoords_.size(), std::vector<Vec2f>(vertices));
  out.display_color.resize(display_color_.empty() ? 0 : vertices);
  out.triangles.resize(3 * triangles);
  out.triangle_primitive.resize(triangles);
  out.primitive_face.resize(primitives_.size());
  out.micropolygons = micropolygons_;
  tbb::parallel_for(tbb::blocked_range<int32_t>(0, faceCount()), [&](const tbb::blocked_range<int32_t>& range) {
    Emitter emitter(*this, out);
    for (int32_t face = range.begin(); face != range.end(); ++face) {
      if (!topology_.hasLimit(face)) continue;
      emitter.bind(face);
      for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1]; ++i)
        emitter.emit(i, first_vertex[i], first_triangle[i]);
    }
  });
  return out;
}

}  // namespace encore
