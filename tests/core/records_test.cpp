// shaders/records.h means the same bytes in C++ and in GLSL: every field is written by a kernel and
// compared with the C++ record.
#include "shaders/records.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstring>

#include "core/vulkan/device.h"
#include "kernels/vulkan/records_layout.h"

namespace encore {
namespace {

static_assert(sizeof(Vec2f) == 8 && sizeof(Vec3f) == 12);
static_assert(kBlockArea == kBlockPixels * kBlockPixels);
static_assert(offsetof(SurfaceKey, primitive_side) == 4);
static_assert(offsetof(PatternPoint, first) == 4 && offsetof(PathInputs, normal) == 48);
static_assert(offsetof(DisplacementInputs, along_normal) == 12);
static_assert(offsetof(ShadingInputs, emissive_color) == 12);
static_assert(offsetof(PathInputs, specular_color) == 12 && offsetof(PathInputs, metallic) == 24);
static_assert(offsetof(PathInputs, roughness) == 28 && offsetof(PathInputs, clearcoat) == 32);
static_assert(offsetof(PathInputs, clearcoat_roughness) == 36 && offsetof(PathInputs, opacity) == 40);
static_assert(offsetof(PathInputs, ior) == 44);

constexpr uint32_t kElements = 3;  // as in records_layout.comp

// The twins of what records_layout.comp writes.
SurfaceKey keyRecord(uint32_t n) { return {n, n + 1}; }
Vec2f pair(float f) { return {f, f + 1}; }
Vec3f triple(float f) { return {f, f + 1, f + 2}; }
PatternPoint pointRecord(uint32_t n) { return {n, n + 1}; }
OpacityInputs opacityRecord(uint32_t n) { return {float(n)}; }
DisplacementInputs displacementRecord(uint32_t n) { return {triple(float(n)), float(n) + 3}; }
ShadingInputs shadingRecord(uint32_t n) { return {triple(float(n)), triple(float(n) + 3)}; }
PathInputs pathRecord(uint32_t n) {
  const float f = float(n);
  return {triple(f), triple(f + 3), f + 6, f + 7, f + 8, f + 9, f + 10, f + 11, triple(f + 12)};
}

template <class T, class Make>
void expectBytes(Buffer<T>& buffer, Make make, const char* record) {
  buffer.toHost();
  for (uint32_t i = 0; i < kElements; ++i) {
    const T expected = make(100 * i);
    EXPECT_EQ(std::memcmp(&buffer.host()[i], &expected, sizeof(T)), 0) << record << " " << i;
  }
  const auto bytes = std::as_bytes(buffer.host().subspan(kElements));
  for (const std::byte b : bytes) ASSERT_EQ(b, std::byte(0xcd)) << record << ": written past the last element";
}

TEST(Records, HaveTheSameBytesInGlsl) {
  const auto device = Device::create({.validation = true});
  const size_t size = kElements + 1;
  Buffer<SurfaceKey> keys(*device, size, "keys");
  Buffer<PatternPoint> points(*device, size, "points");
  Buffer<ShadingInputs> shadings(*device, size, "shadings");
  Buffer<PathInputs> paths(*device, size, "paths");
  Buffer<OpacityInputs> opacities(*device, size, "opacities");
  Buffer<DisplacementInputs> displacements(*device, size, "displacements");
  Buffer<Vec2f> vectors2(*device, size, "vectors2");
  Buffer<Vec3f> vectors3(*device, size, "vectors3");
  Buffer<uint32_t> constants(*device, 5, "constants");
  struct Arguments {
    uint64_t keys, points, shadings, paths, opacities, displacements, vectors2, vectors3, constants;
  };
  const Kernel kernel(*device, "records_layout", kRecordsLayoutSpirv);
  Commands commands(*device);
  for (RawBuffer* buffer : {&keys.raw(), &points.raw(), &shadings.raw(), &paths.raw(), &opacities.raw(),
                            &displacements.raw(), &vectors2.raw(), &vectors3.raw()}) {
    commands.fill(*buffer, 0xcdcdcdcd);
  }
  commands.dispatch(
      kernel, 1,
      Arguments{keys.address(), points.address(), shadings.address(), paths.address(), opacities.address(),
                displacements.address(), vectors2.address(), vectors3.address(), constants.address()});
  commands.run();

  expectBytes(keys, keyRecord, "SurfaceKey");
  expectBytes(points, pointRecord, "PatternPoint");
  expectBytes(shadings, shadingRecord, "ShadingInputs");
  expectBytes(paths, pathRecord, "PathInputs");
  expectBytes(opacities, opacityRecord, "OpacityInputs");
  expectBytes(displacements, displacementRecord, "DisplacementInputs");
  expectBytes(vectors2, [](uint32_t n) { return pair(float(n)); }, "vec2");
  expectBytes(vectors3, [](uint32_t n) { return triple(float(n)); }, "vec3");
  constants.toHost();
  const uint32_t expected[] = {kBlockPixels, kBlockArea, kNoInstance, kShadeNotFound, kShadeNone};
  for (size_t i = 0; i < std::size(expected); ++i) EXPECT_EQ(constants.host()[i], expected[i]) << i;
}

}  // namespace
}  // namespace encore
