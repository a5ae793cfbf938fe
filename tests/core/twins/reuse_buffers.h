// Vectors to device buffers and back, for the tests of core/reuse.
#pragma once

#include <algorithm>
#include <memory>
#include <string_view>
#include <vector>

#include "core/reuse/key_table.h"
#include "core/reuse/radix_sort.h"
#include "core/reuse/reuse.h"
#include "core/reuse/scan.h"
#include "core/reuse/trees.h"
#include "core/vulkan/device.h"
#include "tests/core/twins/trees_twin.h"

namespace encore::twin {

template <class T>
Buffer<T> upload(Device& device, const std::vector<T>& values, std::string_view name = "test data") {
  Buffer<T> buffer(device, values.size(), name);
  std::copy(values.begin(), values.end(), buffer.host().begin());
  buffer.toDevice();
  return buffer;
}

template <class T>
std::vector<T> download(Buffer<T>& buffer) {
  buffer.toHost();
  return {buffer.host().begin(), buffer.host().end()};
}

inline ShadingSamples uploadShading(Device& device, const Samples& samples) {
  ShadingSamples uploaded;
  uploaded.count = uint32_t(samples.keys.size());
  uploaded.key = upload(device, samples.keys, "key");
  uploaded.uv = upload(device, samples.uv, "uv");
  uploaded.footprint = upload(device, samples.footprints, "footprint");
  if (!samples.aspects.empty()) uploaded.aspect = upload(device, samples.aspects, "aspect");
  return uploaded;
}

inline AaSamples uploadAa(Device& device, const Samples& samples, uint32_t samples_per_pixel = 1) {
  AaSamples uploaded;
  uploaded.count = uint32_t(samples.keys.size());
  uploaded.samples_per_pixel = samples_per_pixel;
  uploaded.key = upload(device, samples.keys, "key");
  uploaded.uv = upload(device, samples.uv, "uv");
  uploaded.footprint = upload(device, samples.footprints, "footprint");
  if (!samples.aspects.empty()) uploaded.aspect = upload(device, samples.aspects, "aspect");
  uploaded.shade = {device, samples.keys.size(), "shade"};
  return uploaded;
}

// What builds trees, without what else ReuseKernels holds.
struct TreeKernels {
  explicit TreeKernels(Device& device)
      : scan(device), sort(device, scan), table(device), builder(device, scan, sort, table) {}

  Trees build(const ShadingSamples& samples, float footprint_weight = 0) {
    Trees trees;
    builder.build(samples, trees, footprint_weight);
    return trees;
  }

  Scan scan;
  RadixSort sort;
  encore::KeyTable table;
  TreeBuilder builder;
};

}  // namespace encore::twin
