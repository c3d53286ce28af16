// GLSL that casts the exact trilinear isosurface of a volume. It is the same source for the desktop
// viewer (GLSL 4.30) and for the page (GLSL ES 3.00). The build reads the text from the .glsl
// files.
//
// Frame P, the padded lattice: voxel (i, j, k) is at (i + 1, j + 1, k + 1), and cells go from 0 to
// size, so that no index is negative. A cell brick is 8³ cells with 9³ points; a block is 8³ cell
// bricks. Lengths along a ray are in voxels. A suffix _D means the device frame, as elsewhere.
// Values are scaled and split as brick_cache.h says.
//
// A platform's volume part comes first. It offers what differs:
// - float Texel(ivec3 at): a scaled value
// - uvec4 BlockAt(ivec3 block): its range as bits, its table, its coarse slot. kNone: no such one
// - int EntryOf(uvec4 block, ivec3 brick), vec2 BrickRange(int entry): a cell brick, and its range
// - uint WantedSlot(int entry): where its points are; kNone if they are missing
// - ivec3 SlotOrigin(uint slot): the texel of a slot's first point
// - void Finish(): ends a pixel of the surface
// - PRECISE: a qualifier that forbids to reorder an expression. GLSL ES 3.00 has none: a driver
// that
//   reorders loses the second part of split values, which is below the last digit of the voxels.
//
// Before it come #version and:
// - ATLAS: the kind of the sampler of values, such as usampler3D
// - of the surface: VEIL, true or false, and MOST_LAYERS, the most layers of the veil
//
// Threads: constants.
#pragma once

namespace palpate::shading {

// The parts in the order of their dependencies. kColors needs none. Slices use kVolumeDesktop,
// kCell and kColors. The page has volume_web.glsl instead of the two desktop parts.
extern const char* const kVolumeDesktop;   // the tables, atlas and marks of a brick cache
extern const char* const kCell;            // the values of a cell, and F within it
extern const char* const kSurfaceDesktop;  // Finish: stores which pixels want more bricks
extern const char* const kSurfaceInputs;   // uniforms, outputs
extern const char* const kRay;             // the part of a pixel's ray that the cuts leave
extern const char* const kWalk;            // blocks, bricks and cells along the ray
extern const char* const kColors;          // the colour of a value, from a table
extern const char* const kLight;           // normals, colours, light
extern const char* const kSurface;         // main

}  // namespace palpate::shading
