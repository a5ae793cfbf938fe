// numpy arrays ↔ std::vector, one memcpy each way.
#pragma once

#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/python/nanobind.h"
#include "core/scene/math.h"
#include "core/scene/shared_vector.h"

namespace encore::python {

namespace nb = nanobind;

// How an element of a core array looks in numpy: (scalar type, trailing dimension).
template <class T>
struct ElementTraits {
  using Scalar = T;
  using Shape = nb::shape<-1>;
  static constexpr size_t kWidth = 1;
};
template <>
struct ElementTraits<Vec2f> {
  using Scalar = float;
  using Shape = nb::shape<-1, 2>;
  static constexpr size_t kWidth = 2;
};
template <>
struct ElementTraits<Vec3f> {
  using Scalar = float;
  using Shape = nb::shape<-1, 3>;
  static constexpr size_t kWidth = 3;
};
template <>
struct ElementTraits<Vec4f> {
  using Scalar = float;
  using Shape = nb::shape<-1, 4>;
  static constexpr size_t kWidth = 4;
};
static_assert(sizeof(Vec2f) == 8 && sizeof(Vec3f) == 12 && sizeof(Vec4f) == 16);

// A contiguous numpy array of elements T: (n), (n, 2), (n, 3) or (n, 4).
template <class T>
using ArrayOf = nb::ndarray<const typename ElementTraits<T>::Scalar, typename ElementTraits<T>::Shape, nb::c_contig,
                            nb::device::cpu>;
template <class T>
using OptionalArrayOf = std::optional<ArrayOf<T>>;

template <class T>
std::vector<T> toVector(const ArrayOf<T>& array) {
  std::vector<T> values(array.shape(0));
  if (!values.empty()) std::memcpy(static_cast<void*>(values.data()), array.data(), values.size() * sizeof(T));
  return values;
}
template <class T>
std::vector<T> toVector(const OptionalArrayOf<T>& array) {
  return array ? toVector<T>(*array) : std::vector<T>{};
}

// A numpy array that owns the vector. lead: all dimensions but an element's own.
template <class T>
nb::object toNumpy(std::vector<T>&& values, std::initializer_list<size_t> lead) {
  using Traits = ElementTraits<T>;
  std::vector<size_t> shape(lead);
  if (Traits::kWidth > 1) shape.push_back(Traits::kWidth);
  auto owned = std::make_unique<std::vector<T>>(std::move(values));
  T* const data = owned->data();
  const nb::capsule owner(owned.get(), [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  (void)owned.release();
  using Scalar = typename Traits::Scalar;
  return nb::cast(nb::ndarray<nb::numpy, Scalar>(reinterpret_cast<Scalar*>(data), shape.size(), shape.data(), owner));
}
// A copy: stays valid whatever becomes of the scene.
template <class T>
nb::object copyToNumpy(const std::vector<T>& values) {
  const size_t size = values.size();
  return toNumpy(std::vector<T>(values), {size});
}
template <class T>
nb::object copyToNumpy(const SharedVector<T>& values) {
  return copyToNumpy(values.get());
}

}  // namespace encore::python
