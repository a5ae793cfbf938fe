#include "core/path/aovs.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace encore {
namespace {

constexpr size_t kGrain = 4096;  // samples that are looked at in one go

template <class Work>
void forRanges(size_t count, const Work& work) {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, count, kGrain), [&](const auto& range) {
    const FlushDenormals flush;
    for (size_t i = range.begin(); i < range.end(); ++i) work(i);
  });
}

const Mesh& meshOf(const Scene& scene, const Hit& hit, uint32_t& index) {
  index = scene.prototypes[scene.instances[hit.instance].prototype].meshes[hit.mesh];
  return scene.meshes[index];
}

// Reads the primvar `name` at one hit after the other, most of which are on the same mesh as the one before.
class PrimvarReader {
 public:
  PrimvarReader(const ShadeContext& context, const std::string& name) : context_(context), name_(name) {}

  Vec4f read(const Hit& hit) {
    if (hit.instance != instance_ || hit.mesh != mesh_) find(hit);
    switch (from_) {
      case From::Primvar:
        return context_.trace.primvar(hit, slot_);
      case From::Texcoord: {
        const Vec2f st = context_.trace.texcoord(hit, {}, slot_, {}, {}).st;
        return {st.x, st.y, 0, 0};
      }
      case From::DisplayColor: {
        const Vec3f color = context_.trace.displayColor(hit);
        return {color.x, color.y, color.z, 0};
      }
      case From::Nothing:
        break;
    }
    return {};
  }

 private:
  enum class From { Nothing, Primvar, Texcoord, DisplayColor };

  template <class T>
  bool holds(const std::vector<Primvar<T>>& sets) const {
    return std::any_of(sets.begin(), sets.end(), [&](const Primvar<T>& set) { return set.name == name_; });
  }

  // What the mesh and its instance have under this name, as materials would be given it.
  void find(const Hit& hit) {
    instance_ = hit.instance, mesh_ = hit.mesh;
    uint32_t index = 0;
    const Mesh& mesh = meshOf(context_.scene, hit, index);
    slot_ = context_.trace.primvarSlot(hit, name_);
    const int32_t texcoord = context_.trace.texcoordSlot(hit, name_);
    // Without a primvar of its own the slot is an instance's, which texture coordinates of the mesh may stand above.
    if (!holds(mesh.primvars) && holds(mesh.texcoords) && texcoord != slot_) {
      slot_ = texcoord;
      from_ = From::Texcoord;
      return;
    }
    from_ = slot_ >= 0 ? From::Primvar : From::Nothing;
    if (name_ == "displayColor" && (!mesh.display_color.empty() || slot_ >= 0)) from_ = From::DisplayColor;
  }

  const ShadeContext& context_;
  const std::string& name_;
  uint32_t instance_ = kNoInstance, mesh_ = 0;
  From from_ = From::Nothing;
  int32_t slot_ = -1;
};

// Where the world's axes go in the camera's space: normals are transformed by the transpose of the way back, less
// its scale.
Affine3d normalTransform(const Affine3d& to_world) {
  const double volume = std::abs(dot(cross(to_world.ex, to_world.ey), to_world.ez));
  const double scale = volume > 0 ? 1 / std::cbrt(volume) : 1;
  return {Vec3d{to_world.ex.x, to_world.ey.x, to_world.ez.x} * scale,
          Vec3d{to_world.ex.y, to_world.ey.y, to_world.ez.y} * scale,
          Vec3d{to_world.ex.z, to_world.ey.z, to_world.ez.z} * scale,
          {}};
}

}  // namespace

AovValues::AovValues(const ShadeContext& context, const CameraRays& camera)
    : context_(context),
      camera_(camera),
      to_camera_(inverse(context.scene.camera.to_world)),
      normal_to_camera_(normalTransform(context.scene.camera.to_world)) {}

std::vector<uint32_t> AovValues::closest(std::span<const FirstHit> first, uint32_t per_pixel) const {
  std::vector<uint32_t> slots(first.size() / per_pixel, kNoSample);
  forRanges(slots.size(), [&](size_t pixel) {
    float nearest = std::numeric_limits<float>::infinity();
    for (size_t slot = pixel * per_pixel; slot < (pixel + 1) * per_pixel; ++slot) {
      const FirstHit& f = first[slot];
      if (!f.active() || !f.hit.valid()) continue;
      const Ray ray = camera_.ray(f);
      const float depth = camera_.depth(ray.origin + ray.direction * f.hit.t);
      if (depth < nearest) nearest = depth, slots[pixel] = uint32_t(slot);
    }
  });
  return slots;
}

void AovValues::positions(const Aov& aov, std::span<const FirstHit> first, std::span<const uint32_t> slots,
                          std::span<float> values) const {
  forRanges(slots.size(), [&](size_t pixel) {
    Vec3f value{};
    if (slots[pixel] != kNoSample) {
      const FirstHit& f = first[slots[pixel]];
      const Ray ray = camera_.ray(f);
      const Vec3f p = ray.origin + ray.direction * f.hit.t;
      value =
          aov.kind == Aov::Kind::Position ? context_.trace.worldPosition(p) : toFloat(to_camera_.point(toDouble(p)));
    }
    values[3 * pixel] = value.x, values[3 * pixel + 1] = value.y, values[3 * pixel + 2] = value.z;
  });
}

void AovValues::ids(const Aov& aov, std::span<const FirstHit> first, std::span<const uint32_t> slots,
                    std::span<int32_t> ids) const {
  forRanges(slots.size(), [&](size_t pixel) {
    ids[pixel] = -1;
    if (slots[pixel] == kNoSample) return;
    const Hit& hit = first[slots[pixel]].hit;
    uint32_t id = hit.instance;
    if (aov.kind == Aov::Kind::PrimId) meshOf(context_.scene, hit, id);
    if (aov.kind == Aov::Kind::ElementId) id = context_.trace.element(hit);
    ids[pixel] = int32_t(id);
  });
}

void AovValues::primvar(const Aov& aov, std::span<const FirstHit> first, std::span<float> values) const {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, first.size(), kGrain), [&](const auto& range) {
    const FlushDenormals flush;
    PrimvarReader reader(context_, aov.primvar);
    for (size_t slot = range.begin(); slot < range.end(); ++slot) {
      const Vec4f value = first[slot].hit.valid() ? reader.read(first[slot].hit) : Vec4f{};
      std::copy_n(&value.x, aov.components, &values[slot * aov.components]);
    }
  });
}

void AovValues::eyeNormals(std::span<const Vec3f> normals, std::span<float> values) const {
  for (size_t i = 0; i < normals.size(); ++i) {
    const Vec3f n = toFloat(normal_to_camera_.vector(toDouble(normals[i])));
    values[3 * i] = n.x, values[3 * i + 1] = n.y, values[3 * i + 2] = n.z;
  }
}

}  // namespace encore
