// Every cell brick has its voxels, in one texture of the whole padded lattice. An entry, and a slot,
// is a cell brick's place, 10 bits for each axis.
#define PRECISE

precision highp float;
precision highp int;
precision highp sampler2D;
precision highp ATLAS;
precision highp sampler3D;

uniform ATLAS atlas;
uniform sampler3D block_ranges;
uniform sampler3D brick_ranges;
uniform float texel_factor;  // from texels to scaled values
uniform float background;
uniform ivec3 block_count;
uniform ivec3 cells;  // along each axis

const uint kNone = 0xFFFFFFFFu;

float Texel(ivec3 at) { return float(texelFetch(atlas, at, 0).r) * texel_factor; }

// In texels, whose axes are those of the lattice in reverse.
ivec3 SlotOrigin(uint slot) { return 8 * ivec3(slot & 1023u, slot >> 10 & 1023u, slot >> 20); }

// A table without a number, and no coarse slot.
uvec4 BlockAt(ivec3 block) {
  return uvec4(floatBitsToUint(texelFetch(block_ranges, block.zyx, 0).rg), 0u, kNone);
}

int EntryOf(uvec4 block, ivec3 brick) { return brick.x << 20 | brick.y << 10 | brick.z; }

vec2 BrickRange(int entry) {
  return texelFetch(brick_ranges, ivec3(entry, entry >> 10, entry >> 20) & 1023, 0).rg;
}

uint WantedSlot(int entry) { return uint(entry); }

void Finish() {}
