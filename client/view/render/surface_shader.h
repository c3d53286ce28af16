// The fragment shader that casts a ray per pixel, in GLSL 4.30.
//
// Its frame is P of volume_shader.h. Lengths along a ray are in voxels. A suffix _D means the
// device frame, as elsewhere. Threads: pure.
#pragma once

#include <string>

namespace palpate::view {

// The most blended layers of the veil. Layers behind are left out.
inline constexpr int kMostVeilLayers = 16;

// The parts in the order of their dependencies. Each part lists what it offers.
extern const char* const kShaderInputs;  // uniforms, outputs
extern const char* const kShaderRay;     // the part of a pixel's ray that the cuts leave
extern const char* const kShaderWalk;    // blocks, bricks and cells along the ray
extern const char* const kShaderLight;   // normals, colours, light
extern const char* const kShaderMain;

// To go with VolumePrograms. Without a veil it is faster.
std::string SurfaceShader(bool with_veil);

}  // namespace palpate::view
