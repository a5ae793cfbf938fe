// The grids of a subdivision mesh: SubdivisionDicer::dice.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
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

template <class T>
bool isFixed(const Primvar<T>& primvar) {
  return primvar.empty() || primvar.interpolation == Interpolation::Constant;
}

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
  std::vector<LimitPrimvar<Vec3f>::Evaluator> display_color, normals;
  std::vector<LimitPrimvar<Vec4f>::Evaluator> primvars;
  std::vector<uint8_t> fixed_primvars;  // constant ones are in place already
  std::vector<double> p, du, dv;        // of all poses
  TessellationLines lines;
  std::vector<ParamCoord> coords;
  std::vector<uint32_t> indices;

  Emitter(const SubdivisionDicer& d, DicedMesh& o)
      : dicer(d), out(o), surface(d.positionSurface()), p(3 * surface.poses()), du(p), dv(p) {
    for (const auto& primvar : d.texcoords_) texcoords.emplace_back(primvar, d.topology_);
    for (const auto& primvar : d.display_color_) display_color.emplace_back(primvar, d.topology_);
    for (const auto& primvar : d.primvars_) primvars.emplace_back(primvar, d.topology_);
    for (const auto& primvar : d.primvars_) fixed_primvars.push_back(isFixed(primvar.primvar()));
    for (const auto& primvar : d.normals_) normals.emplace_back(primvar, d.topology_);
  }

  void bind(int32_t face) {
    surface.bind(face);
    for (auto& primvar : texcoords) primvar.bind(face);
    for (auto& primvar : display_color) primvar.bind(face);
    for (auto& primvar : primvars) primvar.bind(face);
    for (auto& primvar : normals) primvar.bind(face);
  }

  void emit(uint32_t index, size_t first_vertex, size_t first_triangle) {
    const Primitive& primitive = dicer.primitives_[index];
    const Tessellation t = dicer.tessellation(primitive);
    dicer.findLines(primitive, t, lines);
    t.coordinates(lines, coords);
    t.triangles(lines, indices);
    bool degenerate = false;
    for (size_t i = 0; i < coords.size(); ++i) degenerate |= emitVertex(primitive.corner, coords[i], first_vertex + i);
    copySharedPositions(primitive, t, first_vertex);
    emitTriangles(index, first_vertex, first_triangle);
    for (size_t pose = 0; pose < surface.poses() && degenerate; ++pose)
      repairNormals(first_vertex, first_triangle, posedPositions(out, pose), posedNormals(out, pose));
    out.primitive_face[index] = uint32_t(primitive.face);
  }

  // Whether a normal is degenerate.
  bool emitVertex(int32_t corner, ParamCoord at, size_t vertex) {
    bool degenerate = false;
    surface.evaluate(corner, at, p.data(), du.data(), dv.data());
    for (size_t pose = 0; pose < surface.poses(); ++pose) {
      posedPositions(out, pose)[vertex] = toFloat(vec3(&p[3 * pose]));
      Vec3f normal = surfaceNormal(vec3(&du[3 * pose]), vec3(&dv[3 * pose]), dicer.mesh_.left_handed);
      if (!normals.empty()) normal = authoredNormal(pose, corner, at, normal);
      posedNormals(out, pose)[vertex] = normal;
      degenerate |= normal == Vec3f{0, 0, 0};
    }
    out.uv[vertex] = {float(at.u), float(at.v)};
    for (size_t i = 0; i < texcoords.size(); ++i) out.texcoords[i][vertex] = texcoords[i](corner, at);
    if (!display_color.empty()) out.display_color[vertex] = display_color[0](corner, at);
    for (size_t i = 0; i < primvars.size(); ++i)
      if (!fixed_primvars[i]) out.primvars[i][vertex] = primvars[i](corner, at);
    return degenerate;
  }

  Vec3f authoredNormal(size_t pose, int32_t corner, ParamCoord at, Vec3f own) const {
    const Vec3f authored = normals[normals.size() == 1 ? 0 : pose](corner, at);
    return length(authored) > 0 ? toFloat(normalize(toDouble(authored))) : own;
  }

  void copySharedPositions(const Primitive& primitive, const Tessellation& t, size_t vertex) {
    for (int s = 0; s < t.sideCount(); ++s) {
      const PrimitiveSide side = dicer.shared_.side(primitive.face, primitive.corner, s);
      for (uint32_t i = 0; i < side.count; ++i, ++vertex)
        for (size_t pose = 0; pose < surface.poses(); ++pose)
          posedPositions(out, pose)[vertex] = dicer.shared_.point(side, i, pose);
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
  void repairNormals(size_t first_vertex, size_t first_triangle, const std::vector<Vec3f>& at,
                     std::vector<Vec3f>& repaired) const {
    std::vector<Vec3d> sums(coords.size(), {0, 0, 0});
    Vec3d total{0, 0, 0};
    for (size_t i = 0; i < indices.size(); i += 3) {
      const uint32_t* v = &out.triangles[3 * first_triangle + i];
      const Vec3d p0 = toDouble(at[v[0]]);
      const Vec3d area = cross(toDouble(at[v[1]]) - p0, toDouble(at[v[2]]) - p0);
      total += area;
      for (int k = 0; k < 3; ++k) sums[v[k] - first_vertex] += area;
    }
    for (size_t i = 0; i < coords.size(); ++i) {
      Vec3f& normal = repaired[first_vertex + i];
      if (normal != Vec3f{0, 0, 0}) continue;
      const Vec3d mean = length(sums[i]) > 0 ? sums[i] : length(total) > 0 ? total : Vec3d{0, 0, 1};
      normal = toFloat(normalize(mean));
    }
  }

  void emitGrid(uint32_t index, Grids& grids) {
    const Primitive& primitive = dicer.primitives_[index];
    const Tessellation t = dicer.tessellation(primitive);
    size_t ring = grids.first_ring[index];
    for (int s = 0; s < t.sideCount(); ++s) {
      const PrimitiveSide side = dicer.shared_.side(primitive.face, primitive.corner, s);
      for (uint32_t i = 0; i < side.count; ++i) grids.ring[ring++] = dicer.shared_.place(side, i);
    }
    const Parameters& v = t.shape == DomainShape::Quad ? lines.v : lines.u;
    Vec2f* spacing = &grids.spacing[grids.first_vertex[index]];
    for (const ParamCoord at : coords) *spacing++ = {spacingAt(lines.u, at.u), spacingAt(v, at.v)};
  }

  // Half of what the two lines beside x lie apart.
  static float spacingAt(const Parameters& at, double x) {
    const size_t next = size_t(std::upper_bound(at.begin(), at.end(), x) - at.begin());
    const size_t low = next < 2 ? 0 : next - 2, high = std::min(next, at.size() - 1);
    return float((at[high] - at[low]) / double(high - low));
  }
};

DicedMesh SubdivisionDicer::allocate(size_t vertices, size_t triangles) const {
  if (vertices > std::numeric_limits<uint32_t>::max())
    throw overMicropolygonCap(
        mesh_, "the mesh makes " + std::to_string(vertices) + " vertices, more than 32-bit indices reach");
  const size_t keys = poses_.count() - 1;
  DicedMesh out;
  out.positions.resize(vertices);
  out.normals.resize(vertices);
  out.motion_positions.assign(keys, std::vector<Vec3f>(vertices));
  out.motion_normals.assign(keys, std::vector<Vec3f>(vertices));
  out.uv.resize(vertices);
  out.texcoords.assign(texcoords_.size(), std::vector<Vec2f>(vertices));
  out.display_color.resize(display_color_.empty() ? 0 : vertices);
  for (const auto& primvar : primvars_)
    out.primvars.emplace_back(vertices, isFixed(primvar.primvar()) ? cornerValue(primvar.primvar(), 0, 0, 0) : Vec4f{});
  out.triangles.resize(3 * triangles);
  out.triangle_primitive.resize(triangles);
  out.primitive_face.resize(primitives_.size());
  out.micropolygons = micropolygons_;
  return out;
}

void SubdivisionDicer::allocate(Grids& grids) {
  shared_.numberPlaces();
  grids.authored_normals = !normals_.empty();
  grids.places = shared_.placeCount();
  grids.first_ring.assign(primitives_.size() + 1, 0);
  for (size_t i = 0; i < primitives_.size(); ++i)
    grids.first_ring[i + 1] = grids.first_ring[i] + tessellation(primitives_[i]).boundaryCount();
  grids.ring.resize(grids.first_ring.back());
  grids.spacing.resize(grids.first_vertex.back());
}

DicedMesh SubdivisionDicer::dice(Grids* grids) {
  std::vector<size_t> first_vertex(primitives_.size() + 1, 0), first_triangle(primitives_.size() + 1, 0);
  for (size_t i = 0; i < primitives_.size(); ++i) {
    const Tessellation t = tessellation(primitives_[i]);
    first_vertex[i + 1] = first_vertex[i] + t.vertexCount();
    first_triangle[i + 1] = first_triangle[i] + t.triangleCount();
  }
  DicedMesh out = allocate(first_vertex.back(), first_triangle.back());
  if (grids) {
    grids->first_vertex = first_vertex;
    grids->first_triangle = first_triangle;
    allocate(*grids);
  }
  tbb::parallel_for(tbb::blocked_range<int32_t>(0, faceCount()), [&](const tbb::blocked_range<int32_t>& range) {
    Emitter emitter(*this, out);
    for (int32_t face = range.begin(); face != range.end(); ++face) {
      if (!topology_.hasLimit(face)) continue;
      emitter.bind(face);
      for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1]; ++i) {
        emitter.emit(i, first_vertex[i], first_triangle[i]);
        if (grids) emitter.emitGrid(i, *grids);
      }
    }
  });
  return out;
}

}  // namespace encore
