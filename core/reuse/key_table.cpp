#include "core/reuse/key_table.h"

#include <bit>

#include "kernels/reuse/key_table_find.h"
#include "kernels/reuse/key_table_insert.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;

struct InsertArguments {  // of key_table_insert.comp
  uint64_t primitives, slots;
  uint32_t primitive_count, capacity, stride;
};
struct FindArguments {  // of key_table_find.comp
  uint64_t primitives, slots, keys, found;
  uint32_t count, capacity;
};

}  // namespace

KeyTable::KeyTable(Device& device)
    : device_(device),
      insert_(device, "key_table_insert", kKeyTableInsertSpirv),
      find_(device, "key_table_find", kKeyTableFindSpirv) {}

uint64_t KeyTable::capacityFor(uint64_t primitives) { return primitives == 0 ? 0 : std::bit_ceil(2 * primitives); }

KeyTable::Slots KeyTable::create(uint32_t primitives) const {
  return Slots(device_, capacityFor(primitives), "key table");
}

void KeyTable::recordInsert(Commands& commands, Slots& slots, uint64_t primitives, uint32_t count,
                            uint32_t record_bytes) {
  commands.fill(slots.raw(), kNoPrimitive);
  commands.dispatch(insert_, groupsFor(count, kLocalSize),
                    InsertArguments{primitives, slots.address(), count, uint32_t(slots.size()), record_bytes / 4});
}

void KeyTable::recordFind(Commands& commands, const Slots& slots, uint64_t primitives, uint64_t keys, uint64_t found,
                          uint32_t count) {
  commands.dispatch(find_, groupsFor(count, kLocalSize),
                    FindArguments{primitives, slots.address(), keys, found, count, uint32_t(slots.size())});
}

}  // namespace encore
