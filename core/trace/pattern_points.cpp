#include "core/trace/pattern_points.h"

namespace encore {
namespace {

// A mapped normal leans towards the geometric one until its cosine with that is at least this.
constexpr float kLeastCosine = 1e-3f;

void add(std::vector<float>& data, Vec2f v) { data.insert(data.end(), {v.x, v.y}); }
void add(std::vector<float>& data, Vec3f v) { data.insert(data.end(), {v.x, v.y, v.z}); }

}  // namespace

void appendPatternPoint(const TraceScene& trace, const PointLayout& layout, const Hit& hit, const SurfacePoint& point,
                        Vec3f direction, Vec3f dpdx, Vec3f dpdy, PatternPoints& points) {
  std::vector<float>& data = points.data;
  points.point.push_back({uint32_t(point.material), uint32_t(data.size())});
  for (const PointSlot& slot : layout.slots) {
    switch (slot.kind) {
      case PointSlot::Kind::Texcoord: {
        const int32_t index = trace.texcoordSlot(hit, slot.name);
        TexcoordPoint st{{slot.fallback[0], slot.fallback[1]}, {}, {}};
        if (index >= 0) st = trace.texcoord(hit, point, index, dpdx, dpdy);
        add(data, st.st), add(data, st.dstdx), add(data, st.dstdy);
        break;
      }
      case PointSlot::Kind::DisplayColor:
        add(data, trace.displayColor(hit));
        break;
      case PointSlot::Kind::Primvar: {
        const int32_t index = trace.primvarSlot(hit, slot.name);
        const auto& f = slot.fallback;
        const Vec4f v = index >= 0 ? trace.primvar(hit, index) : Vec4f{f[0], f[1], f[2], f[3]};
        data.insert(data.end(), {v.x, v.y, v.z, v.w});
        break;
      }
      case PointSlot::Kind::Position:
        add(data, trace.worldPosition(point.position));
        break;
      case PointSlot::Kind::ObjectPosition:
        add(data, trace.objectPosition(hit));
        break;
      case PointSlot::Kind::Normal:
        add(data, dot(point.ns, direction) > 0 ? -point.ns : point.ns);
        break;
      case PointSlot::Kind::Parameter:
        add(data, point.uv);
        break;
    }
  }
}

// Tangents are made orthogonal to the shading normal and keep their handedness, so that mirrored texture coordinates
// mirror the map (as UsdPreviewSurface 2.6, "normal", asks for).
Vec3f mappedNormal(const TraceScene& trace, const Hit& hit, const SurfacePoint& point, const std::string& texcoord,
                   Vec3f normal) {
  if (normal == Vec3f{0, 0, 1} || !isFinite(normal)) return point.ns;
  Vec3f dpds, dpdt;
  const int32_t slot = trace.texcoordSlot(hit, texcoord);
  if (slot < 0 || !trace.tangents(hit, point, slot, dpds, dpdt)) return point.ns;
  const Vec3f n = point.ns;
  const Vec3f s = normalize(dpds);
  const Vec3f tangent = normalize(s - n * dot(n, s));
  if (!isFinite(tangent) || tangent == Vec3f{}) return n;
  const Vec3f across = cross(n, tangent);
  const Vec3f bitangent = dot(across, dpdt) < 0 ? -across : across;
  Vec3f mapped = normalize(tangent * normal.x + bitangent * normal.y + n * normal.z);
  if (!isFinite(mapped) || mapped == Vec3f{}) return n;
  // Below the geometric surface nothing could be seen of what it faces.
  const float c = dot(mapped, point.ng);
  if (c < kLeastCosine) mapped = normalize(mapped + point.ng * (kLeastCosine - c));
  return mapped;
}

}  // namespace encore
