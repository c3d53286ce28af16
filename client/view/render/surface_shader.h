// The fragment shader that casts a ray per pixel, in GLSL 4.30.
//
// Its frame is the padded lattice P: voxel (i, j, k) is at (i + 1, j + 1, k + 1), and cells go from
// 0 to size, so that no index is negative. Lengths along a ray are in voxels. A suffix _D means the
// device frame, as elsewhere.
// Threads: pure.
#pragma once

#include <string>

namespace palpate::view {

// The most blended layers of the veil. Layers behind are left out.
inline constexpr int kMostVeilLayers = 16;

// The parts in the order of their dependencies. Each part lists what it offers.
extern const char* const kShaderInputs;  // uniforms, outputs
extern const char* const kShaderCell;    // F within a cell, and where it crosses
extern const char* const kShaderRay;     // the part of a pixel's ray that the cuts leave
extern const char* const kShaderWalk;    // bricks and cells along the ray
extern const char* const kShaderLight;   // normals, colours, light
extern const char* const kShaderMain;

std::string SurfaceShader();

}  // namespace palpate::view
