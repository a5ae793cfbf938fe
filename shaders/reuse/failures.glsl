// Groups of failed samples: those of one key and one pixel (§2.3), or of one key and one cell in one block.

layout(buffer_reference, scalar, buffer_reference_align = 8) buffer Keys64 {
  uint64_t at[];  // a SurfaceKey in one load
};

struct Grouping {
  Keys64 keys;          // by slot
  Words cells;          // by slot; null: none
  uint slots_per_unit;  // of a pixel, or of a block
};

uint cellOf(Grouping by, uint slot) { return uint64_t(by.cells) == 0 ? 0 : by.cells.at[slot]; }

bool sameGroup(Grouping by, uint a, uint b) {
  return by.keys.at[a] == by.keys.at[b] && a / by.slots_per_unit == b / by.slots_per_unit &&
         cellOf(by, a) == cellOf(by, b);
}

uint hashOfGroup(Grouping by, uint slot) {
  const uvec2 key = unpackUint2x32(by.keys.at[slot]);
  uint h = hashOf(SurfaceKey(key.x, key.y)) ^ ((slot / by.slots_per_unit) * 0x9e3779b1u);
  h = (h ^ (h >> 15)) + cellOf(by, slot) * 0x85ebca77u;
  h = (h ^ (h >> 16)) * 0x85ebca6bu;
  h = (h ^ (h >> 13)) * 0xc2b2ae35u;
  return h ^ (h >> 16);
}

// Runs: most samples of a group follow one another, and only the first of a run is looked up. An invocation goes
// through kStretch slots; runs end where its stretch does, which changes nothing but their number.
const uint kStretch = 248;  // core/reuse/failures.cpp has the same; not a power of two, as in scan.cpp

struct Run {
  uint64_t key;
  uint cell;
  uint unit_end;  // first slot of the next unit; 0: there is no run yet
};
const Run kNoRun = Run(0ul, 0, 0);

// Whether the failed sample at `slot` starts a run; it is part of `run` afterwards. Slots ascend.
bool startsRun(inout Run run, Grouping by, uint slot) {
  const uint64_t key = by.keys.at[slot];
  const uint cell = cellOf(by, slot);
  const bool in_unit = slot < run.unit_end;
  if (in_unit && key == run.key && cell == run.cell) return false;
  if (!in_unit) run.unit_end = (slot / by.slots_per_unit + 1) * by.slots_per_unit;
  run.key = key;
  run.cell = cell;
  return true;
}
