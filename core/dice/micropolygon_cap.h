// The cap on micropolygons: an error instead of a machine out of memory.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

#include "core/scene/error.h"
#include "core/scene/mesh.h"

namespace encore {

// Where and what to do: the same for one mesh and for the scene.
inline Error overMicropolygonCap(const Mesh& mesh, const std::string& what) {
  return Error(ErrorKind::Memory, what, mesh.path + ".primvars:encore:targetEdgeLength",
               "Author a longer primvars:encore:targetEdgeLength on the mesh, or raise max_micropolygons");
}

inline std::string lengthText(double length) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", length);
  return text;
}

// count: in words. edge_length: in prototype space.
inline Error tooManyMicropolygons(const Mesh& mesh, const std::string& count, double edge_length, uint64_t cap) {
  return overMicropolygonCap(mesh, "an edge length of " + lengthText(edge_length) + " in prototype space makes " +
                                       count + " micropolygons, more than the cap of " + std::to_string(cap));
}

}  // namespace encore
