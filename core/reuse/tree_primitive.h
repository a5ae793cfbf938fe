// What is known of one primitive that has shading samples; shaders/reuse/trees.glsl declares the same.
#pragma once

#include <cstddef>
#include <cstdint>

#include "shaders/records.h"

namespace encore {

struct TreePrimitive {
  SurfaceKey key;
  uint32_t first;       // its samples are first .. first + count
  uint32_t count;       // at least 1
  uint32_t first_node;  // its node number j is at first_node + j; 1 is the root
  uint32_t levels;      // depth | u_levels << 8

  uint32_t depth() const { return levels & 0xff; }
  uint32_t uLevels() const { return levels >> 8; }
};
static_assert(sizeof(TreePrimitive) == 24 && offsetof(TreePrimitive, first) == 8);

}  // namespace encore
