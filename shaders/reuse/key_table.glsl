// Hash table from SurfaceKey to the number of its primitive: open addressing, linear probing, at most half full.

const uint kEmptySlot = 0xffffffffu;
const uint kNoPrimitive = 0xffffffffu;

// Finalisers of MurmurHash3 (Appleby, public domain), one after the other over both words.
uint hashOf(SurfaceKey key) {
  uint h = key.primitive_side;
  h = (h ^ (h >> 16)) * 0x85ebca6bu;
  h = (h ^ (h >> 13)) * 0xc2b2ae35u;
  h ^= (h >> 16) ^ (key.instance * 0x9e3779b1u);
  h = (h ^ (h >> 16)) * 0x85ebca6bu;
  h = (h ^ (h >> 13)) * 0xc2b2ae35u;
  return h ^ (h >> 16);
}

// kNoPrimitive when no primitive has this key. capacity: a power of two, or 0 when there are no primitives.
uint findPrimitive(Words slots, uint capacity, Primitives primitives, SurfaceKey key) {
  if (capacity == 0) return kNoPrimitive;
  for (uint slot = hashOf(key);; ++slot) {
    const uint primitive = slots.at[slot & (capacity - 1)];
    if (primitive == kEmptySlot) return kNoPrimitive;
    const SurfaceKey found = primitives.at[primitive].key;
    if (found.instance == key.instance && found.primitive_side == key.primitive_side) return primitive;
  }
}
