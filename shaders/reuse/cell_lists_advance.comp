// Counts the entries that cell_lists_write stored.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words starts;  // as in cell_lists_write
  Words totals;  // [1]: entries stored
  uint leaves;
};

void main() {
  if (invocation() == 0) totals.at[1] += starts.at[leaves];
}
