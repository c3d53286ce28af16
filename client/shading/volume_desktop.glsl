// The buffers are those of client/view/render/brick_cache.h: of a block, its range as bits, its
// table and its coarse slot; of a cell brick in a table, its range and slot.
#define PRECISE precise

uniform ATLAS atlas;
uniform usamplerBuffer blocks;
uniform samplerBuffer ranges;
uniform usamplerBuffer slots;
uniform float texel_factor;  // from texels to scaled values
uniform float background;
uniform ivec3 block_count;
uniform ivec3 cells;  // along each axis

layout(std430, binding = 0) buffer Marks { uint marks[]; };

const uint kNone = 0xFFFFFFFFu;

// A cell brick was missing that this pixel wants.
bool is_unfinished = false;

float Texel(ivec3 at) { return float(texelFetch(atlas, at, 0).r) * texel_factor; }

// In texels, whose axes are those of the lattice in reverse.
ivec3 SlotOrigin(uint slot) { return 9 * ivec3(slot & 63u, slot >> 6 & 63u, slot >> 12); }

uvec4 BlockAt(ivec3 block) {
  return texelFetch(blocks, (block.x * block_count.y + block.y) * block_count.z + block.z);
}

// Of a cell brick in a block with a table.
int EntryOf(uvec4 block, ivec3 brick) {
  ivec3 place = brick & 7;
  return int(block.z) * 512 + (place.x << 6 | place.y << 3 | place.z);
}

vec2 BrickRange(int entry) { return texelFetch(ranges, entry).rg; }

// Marks a cell brick as wanted, and returns its slot.
uint WantedSlot(int entry) {
  uint bit = 1u << (entry & 31);
  if ((marks[entry >> 5] & bit) == 0u) atomicOr(marks[entry >> 5], bit);
  uint slot = texelFetch(slots, entry).r;
  if (slot == kNone) is_unfinished = true;
  return slot;
}
