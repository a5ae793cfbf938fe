// The hash table of keys against its twin, a map.
#include "core/reuse/key_table.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "tests/core/twins/key_table_twin.h"
#include "tests/core/twins/reuse_buffers.h"

namespace encore {
namespace {

// hashOf() of shaders/reuse/key_table.glsl, to make keys that collide.
uint32_t hashOf(SurfaceKey key) {
  uint32_t h = key.primitive_side;
  h = (h ^ (h >> 16)) * 0x85ebca6bu;
  h = (h ^ (h >> 13)) * 0xc2b2ae35u;
  h ^= (h >> 16) ^ (key.instance * 0x9e3779b1u);
  h = (h ^ (h >> 16)) * 0x85ebca6bu;
  h = (h ^ (h >> 13)) * 0xc2b2ae35u;
  return h ^ (h >> 16);
}

class KeyTableTest : public testing::Test {
 protected:
  void expectFinds(const std::vector<SurfaceKey>& keys, const std::vector<SurfaceKey>& queries) {
    twin::KeyTable expected;
    std::vector<TreePrimitive> primitives;
    for (const SurfaceKey key : keys) {
      expected.insert(key, uint32_t(primitives.size()));
      primitives.push_back({key, 0, 1, 0, 0});
    }
    KeyTable table(*device_);
    const Buffer<TreePrimitive> device_primitives = twin::upload(*device_, primitives);
    const Buffer<SurfaceKey> device_queries = twin::upload(*device_, queries);
    KeyTable::Slots slots = table.create(uint32_t(keys.size()));
    EXPECT_GE(slots.size(), 2 * keys.size());
    Buffer<uint32_t> found(*device_, queries.size(), "found");
    Commands commands(*device_);
    table.recordInsert(commands, slots, device_primitives.address(), uint32_t(keys.size()));
    table.recordFind(commands, slots, device_primitives.address(), device_queries.address(), found.address(),
                     uint32_t(queries.size()));
    commands.run();
    const std::vector<uint32_t> result = twin::download(found);
    for (size_t i = 0; i < queries.size(); ++i) {
      ASSERT_EQ(result[i], expected.find(queries[i])) << queries[i].instance << " " << queries[i].primitive_side;
    }
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
};

TEST_F(KeyTableTest, FindsNothingInAnEmptyTable) { expectFinds({}, {{0, 0}, {1, 2}, {0xfffffffeu, 0xffffffffu}}); }

TEST_F(KeyTableTest, FindsWhatIsThereAndNothingElse) {
  std::mt19937 random(3);
  std::set<std::pair<uint32_t, uint32_t>> made;
  while (made.size() < 100'000) made.insert({uint32_t(random() % 7), uint32_t(random() % 60'000)});
  made.insert({0xfffffffeu, 0xffffffffu});
  made.insert({0, 0xffffffffu});
  std::vector<SurfaceKey> keys, queries;
  for (const auto& [instance, primitive] : made) keys.push_back({instance, primitive});
  for (uint32_t i = 0; i < 7; ++i) {
    for (uint32_t p = 0; p < 60'000; p += 3) queries.push_back({i, p});
  }
  queries.insert(queries.end(), {{0xfffffffeu, 0xffffffffu}, {0xfffffffeu, 0}, {0, 0xffffffffu}, {kNoInstance, 0}});
  expectFinds(keys, queries);
}

TEST_F(KeyTableTest, SurvivesKeysThatAllCollide) {
  std::vector<SurfaceKey> keys, queries;
  for (uint32_t p = 0; keys.size() < 300; ++p) {
    if ((hashOf({5, p}) & 1023) == 1000) keys.push_back({5, p});
  }
  for (const SurfaceKey key : keys) queries.insert(queries.end(), {key, {key.instance + 1, key.primitive_side}});
  expectFinds(keys, queries);
}

}  // namespace
}  // namespace encore
