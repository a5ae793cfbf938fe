// Material inputs at the vertices of one shade() call: constants from tables, the rest from one dispatch.
#pragma once

#include <span>
#include <vector>

#include "core/shade/shade.h"

namespace encore {

class VertexInputs {
 public:
  // Evaluates what varies, the two parts in one dispatch each. Keeps references to its arguments.
  VertexInputs(const ShadeContext& context, std::span<const PathVertex> vertices);

  // material: of vertex i. Thread-safe.
  const ShadingInputs& shading(size_t i, int32_t material) const;
  const PathInputs& path(size_t i, int32_t material) const;

 private:
  template <class Value>
  struct Varying {
    std::vector<uint32_t> slots;  // per vertex; empty where no material of the scene varies
    std::vector<Value> values;
  };
  template <class Value>
  void gather(std::span<const PathVertex> vertices, PatternPart which, Varying<Value>& part) const;
  PatternPoints points(std::span<const PathVertex> vertices, PatternPart which, std::span<const uint32_t> slots) const;

  const ShadeContext& context_;
  Varying<ShadingInputs> shading_;
  Varying<PathInputs> path_;
};

}  // namespace encore
