#include "core/dice/displacement_points.h"

#include <algorithm>
#include <cstring>

#include "core/dice/poses.h"

namespace encore {
namespace {

using Kind = PointSlot::Kind;

constexpr Vec3f kDefaultColor{0.18f, 0.18f, 0.18f};  // as of hits on meshes without displayColor

// Of the named primvar, or -1.
template <class T>
int64_t indexOf(const std::vector<Primvar<T>>& primvars, const std::string& name) {
  for (size_t i = 0; i < primvars.size(); ++i)
    if (primvars[i].name == name) return int64_t(i);
  return -1;
}

// d(st)/du and d(st)/dv.
struct Gradient {
  Vec2f du, dv;
};

// At each vertex of a primitive: the mean over the triangles around it, weighted by their areas in (u, v).
std::vector<Gradient> gradients(const DicedMesh& diced, const Grids& grids, size_t primitive,
                                const std::vector<Vec2f>& st) {
  const size_t first = grids.first_vertex[primitive], count = grids.first_vertex[primitive + 1] - first;
  std::vector<Gradient> sums(count);
  std::vector<float> areas(count, 0);
  for (size_t i = grids.first_triangle[primitive]; i < grids.first_triangle[primitive + 1]; ++i) {
    const uint32_t* v = &diced.triangles[3 * i];
    const Vec2f a = diced.uv[v[1]] - diced.uv[v[0]], b = diced.uv[v[2]] - diced.uv[v[0]];
    const Vec2f p = st[v[1]] - st[v[0]], q = st[v[2]] - st[v[0]];
    const float twice = a.x * b.y - a.y * b.x, sign = twice < 0 ? -1.0f : 1.0f;
    for (int k = 0; k < 3; ++k) {
      Gradient& sum = sums[v[k] - first];
      sum.du = sum.du + (p * b.y - q * a.y) * sign;
      sum.dv = sum.dv + (q * a.x - p * b.x) * sign;
      areas[v[k] - first] += twice * sign;
    }
  }
  for (size_t i = 0; i < count; ++i)
    if (areas[i] > 0) sums[i] = {sums[i].du * (1 / areas[i]), sums[i].dv * (1 / areas[i])};
  return sums;
}

class Filler {
 public:
  Filler(const Mesh& mesh, const DicedMesh& diced, const Grids& grids, size_t pose, std::span<const Vec3f> normals,
         size_t primitive, size_t stride)
      : mesh_(mesh),
        diced_(diced),
        grids_(grids),
        pose_(pose),
        normals_(normals),
        primitive_(primitive),
        stride_(stride),
        first_(grids.first_vertex[primitive]),
        end_(grids.first_vertex[primitive + 1]) {}

  void fill(const PointSlot& slot, float* data) const {
    switch (slot.kind) {
      case Kind::Texcoord:
        return fillTexcoord(slot, data);
      case Kind::DisplayColor:
        return fillEach(
            data, [&](size_t v) { return diced_.display_color.empty() ? kDefaultColor : diced_.display_color[v]; });
      case Kind::Primvar:
        return fillPrimvar(slot, data);
      // The mesh's space stands for the world's: instances share the displaced mesh.
      case Kind::Position:
      case Kind::ObjectPosition:
        return fillEach(data, [&](size_t v) { return posedPositions(diced_, pose_)[v]; });
      case Kind::Normal:
        return fillEach(data, [&](size_t v) { return normals_[v]; });
      case Kind::Parameter:
        return fillEach(data, [&](size_t v) { return diced_.uv[v]; });
    }
  }

 private:
  template <class Value>
  void fillEach(float* data, const Value& value) const {
    for (size_t v = first_; v < end_; ++v, data += stride_) {
      const auto x = value(v);
      std::memcpy(data, &x, sizeof x);
    }
  }

  void fillTexcoord(const PointSlot& slot, float* data) const {
    struct Texcoord {
      float x, y;
      Vec2f dx, dy;
    };
    const int64_t index = indexOf(mesh_.texcoords, slot.name);
    if (index < 0) return fillEach(data, [&](size_t) { return Texcoord{slot.fallback[0], slot.fallback[1], {}, {}}; });
    const std::vector<Vec2f>& st = diced_.texcoords[size_t(index)];
    const std::vector<Gradient> change = gradients(diced_, grids_, primitive_, st);
    fillEach(data, [&](size_t v) {
      const Gradient& g = change[v - first_];
      return Texcoord{st[v].x, st[v].y, g.du * grids_.spacing[v].x, g.dv * grids_.spacing[v].y};
    });
  }

  void fillPrimvar(const PointSlot& slot, float* data) const {
    const int64_t index = indexOf(mesh_.primvars, slot.name);
    const Vec4f fallback{slot.fallback[0], slot.fallback[1], slot.fallback[2], slot.fallback[3]};
    fillEach(data, [&](size_t v) { return index < 0 ? fallback : diced_.primvars[size_t(index)][v]; });
  }

  const Mesh& mesh_;
  const DicedMesh& diced_;
  const Grids& grids_;
  size_t pose_;
  std::span<const Vec3f> normals_;
  size_t primitive_, stride_, first_, end_;
};

}  // namespace

bool readsPose(const PointLayout& layout) {
  return std::any_of(layout.slots.begin(), layout.slots.end(), [](const PointSlot& slot) {
    return slot.kind == Kind::Position || slot.kind == Kind::ObjectPosition || slot.kind == Kind::Normal;
  });
}

void fillDisplacementPoints(const Mesh& mesh, const DicedMesh& diced, const Grids& grids, size_t pose,
                            std::span<const Vec3f> normals, size_t primitive, const PointLayout& layout, float* data) {
  const Filler filler(mesh, diced, grids, pose, normals, primitive, layout.size);
  for (const PointSlot& slot : layout.slots) {
    filler.fill(slot, data);
    data += slot.size();
  }
}

}  // namespace encore
