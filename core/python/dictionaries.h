// Fields of core's structures out of Python dictionaries, and small values.
#pragma once

#include <array>
#include <string>

#include "core/python/arrays.h"
#include "core/python/names.h"

namespace encore::python {

using Triple = std::array<float, 3>;
using TripleD = std::array<double, 3>;
// USD's row-vector convention: point * matrix, translation in the last row.
using MatrixArray = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
using MatricesArray = nb::ndarray<const double, nb::shape<-1, 4, 4>, nb::c_contig, nb::device::cpu>;

template <class T>
Vec3<T> toVec(const std::array<T, 3>& v) {
  return {v[0], v[1], v[2]};
}

// The rows of USD's matrix are the images of the axes and of the origin.
inline Affine3d toAffine(const double* m) {
  return {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}, {m[12], m[13], m[14]}};
}
inline std::vector<Affine3d> toAffines(const std::optional<MatricesArray>& matrices) {
  std::vector<Affine3d> affines;
  for (size_t i = 0; matrices && i < matrices->shape(0); ++i) affines.push_back(toAffine(matrices->data() + i * 16));
  return affines;
}

inline nb::dict copyOf(nb::handle dictionary) { return nb::cast<nb::dict>(dictionary.attr("copy")()); }
// Reads `d[key]` into value when there is such a key, and takes the key off the dictionary.
template <class T>
void take(nb::dict& d, const char* key, T& value) {
  if (!d.contains(key)) return;
  value = nb::cast<T>(nb::object(d[key]));
  nb::del(d[key]);
}
inline void take(nb::dict& d, const char* key, Vec3f& value) {
  Triple triple{value.x, value.y, value.z};
  take(d, key, triple);
  value = toVec(triple);
}
inline void take(nb::dict& d, const char* key, Vec3d& value) {
  TripleD triple{value.x, value.y, value.z};
  take(d, key, triple);
  value = toVec(triple);
}
inline void take(nb::dict& d, const char* key, Vec2f& value) {
  std::array<float, 2> pair{value.x, value.y};
  take(d, key, pair);
  value = {pair[0], pair[1]};
}
// Enumerations by their names; where: for messages.
template <class T>
void takeField(nb::dict& d, const char* key, T& value, const std::string& where) {
  if constexpr (std::is_enum_v<T>) {
    std::string name = toName(namesOf(value), value);
    take(d, key, name);
    value = fromName(namesOf(value), name, where + "." + key);
  } else {
    take(d, key, value);
  }
}
inline void requireEmpty(const nb::dict& d, const std::string& where) {
  if (d.size() == 0) return;
  throw Error(ErrorKind::Internal, "unknown key '" + nb::cast<std::string>(nb::str(nb::list(d.keys())[0])) + "'",
              where);
}

}  // namespace encore::python
