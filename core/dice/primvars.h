// Primvars of meshes, per element and on limit surfaces.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/dice/limit_surface.h"
#include "core/scene/mesh.h"

namespace encore {

// Index into values of element i. Precondition: i is in range of the interpolation; 0 for Constant.
template <class T>
size_t valueIndex(const Primvar<T>& primvar, size_t i) {
  return primvar.indices.empty() ? i : size_t(primvar.indices[i]);
}

// Index into values of what is there at a corner of a polygon: linear schemes have no limit surface to ask.
template <class T>
size_t cornerIndex(const Primvar<T>& primvar, size_t face, size_t point, size_t face_corner) {
  switch (primvar.interpolation) {
    case Interpolation::Constant:
      return valueIndex(primvar, 0);
    case Interpolation::Uniform:
      return valueIndex(primvar, face);
    case Interpolation::Vertex:
    case Interpolation::Varying:
      return valueIndex(primvar, point);
    case Interpolation::FaceVarying:
      break;
  }
  return valueIndex(primvar, face_corner);
}
// 0 where there are no values at all.
template <class T>
T cornerValue(const Primvar<T>& primvar, size_t face, size_t point, size_t face_corner) {
  return primvar.empty() ? T{} : primvar.values[cornerIndex(primvar, face, point, face_corner)];
}

// A primvar of T (Vec2f, Vec3f or Vec4f), prepared for evaluation on limit surfaces.
template <class T>
class LimitPrimvar {
 public:
  // Appends the primvar's channel to channels if it is face-varying. Indices of such a primvar are its
  // topology (UsdGeomPrimvar): without indices no two corners are joined. primvar must outlive this.
  LimitPrimvar(const Primvar<T>& primvar, const Mesh& mesh, std::vector<FaceVaryingChannel>& channels)
      : primvar_(primvar) {
    const Interpolation kind = primvar.interpolation;
    if (primvar.empty()) return;
    if (kind == Interpolation::FaceVarying) {
      channel_ = int32_t(channels.size());
      FaceVaryingChannel channel{int32_t(primvar.values.size()), primvar.indices};
      if (channel.indices.empty())
        for (size_t i = 0; i < mesh.face_vertex_indices.size(); ++i) channel.indices.push_back(int32_t(i));
      channels.push_back(std::move(channel));
    } else if ((kind == Interpolation::Vertex || kind == Interpolation::Varying) && !primvar.indices.empty()) {
      for (const int32_t index : primvar.indices) per_point_.push_back(primvar.values[index]);
    }
  }

  // The same everywhere on each face.
  static bool isFlat(const Primvar<T>& primvar) {
    return primvar.empty() || primvar.interpolation == Interpolation::Constant ||
           primvar.interpolation == Interpolation::Uniform;
  }
  const Primvar<T>& primvar() const { return primvar_; }

  // Evaluates the primvar on one face after the other. One per thread.
  class Evaluator {
   public:
    Evaluator(const LimitPrimvar& primvar, const LimitTopology& topology) : primvar_(primvar.primvar_) {
      if (isFlat(primvar_)) return;
      const auto& values = primvar.per_point_.empty() ? primvar_.values.get() : primvar.per_point_;
      surface_.emplace(topology, primvar_.interpolation, primvar.channel_, &values[0].x, kWidth);
    }
    void bind(int32_t face) {
      if (surface_)
        surface_->bind(face);
      else
        constant_ = cornerValue(primvar_, size_t(face), 0, 0);
    }
    T operator()(int32_t corner, ParamCoord at) const {
      if (!surface_) return constant_;
      double value[kWidth];
      surface_->evaluate(corner, at, value);
      if constexpr (kWidth == 2)
        return {float(value[0]), float(value[1])};
      else if constexpr (kWidth == 3)
        return {float(value[0]), float(value[1]), float(value[2])};
      else
        return {float(value[0]), float(value[1]), float(value[2]), float(value[3])};
    }

   private:
    const Primvar<T>& primvar_;
    std::optional<LimitSurface> surface_;
    T constant_{};
  };

 private:
  static constexpr int kWidth = int(sizeof(T) / sizeof(float));
  const Primvar<T>& primvar_;
  std::vector<T> per_point_;  // indices resolved, where there are any
  int32_t channel_ = -1;
};

}  // namespace encore
