#include "client/view/render/surface_shader.h"

#include "client/view/render/color_texture.h"

namespace palpate::view {

const char* const kShaderInputs = R"(
layout(location = 0) out vec4 surface_color;
layout(location = 1) out vec4 veil_color;
layout(location = 2) out float veil_depth;

// Values are scaled as in value_scale.h. In voxels, texel (k, j, i) is lattice point (i, j, k) of
// P. In ranges, texel (c, b, a) is the range of values of brick (a, b, c), which has 8^3 cells.
uniform sampler3D voxels;
uniform sampler3D ranges;
uniform sampler2D color_map;
uniform ivec3 cells;  // along each axis

uniform vec3 eye;
uniform vec3 image_center;  // of gl_FragCoord
uniform mat3 direction_from_pixel;  // of (x, y, 1) about the image's centre
uniform vec4 clip_z;  // rows of the map from P to clip coordinates
uniform vec4 clip_w;

// What the cuts leave.
uniform vec3 crop_min;
uniform vec3 crop_max;
uniform vec4 planes[2];  // xyz . p <= w

uniform bool surface_shown;
uniform vec2 isovalue;  // all values are split: see value_scale.h
uniform bool material_above;
uniform bool caps;
uniform bool veil_shown;
uniform vec2 veil_isovalue;

uniform mat3 D_from_P;  // of directions
uniform mat3 normal_D_from_P;
uniform vec3 right_D;
uniform vec3 up_D;
uniform vec3 plain_color;
uniform vec3 veil_plain_color;
uniform float veil_opacity;
uniform int coloring;
uniform vec2 window_min;
uniform float window_range;
uniform float steepest;  // gradient per mm that has the colour map's last colour
)";

const char* const kShaderMain = R"(
float Depth(vec3 p) {
  vec4 q = vec4(p, 1.0);
  return clamp(0.5 * dot(clip_z, q) / dot(clip_w, q) + 0.5, 0.0, 1.0);
}

void DrawVeil() {
  vec4 sum = vec4(0.0);
  for (int n = 0; n < layer_count; ++n) {
    vec3 p = origin + layers[n] * direction;
    bool from_above = veil_begins_above != (n % 2 == 1);
    vec3 color = Lit(veil_plain_color, Normal(Gradient(p, veil_isovalue), from_above));
    sum += (1.0 - sum.a) * veil_opacity * vec4(color, 1.0);
  }
  veil_color = sum;
  veil_depth = layer_count > 0 ? Depth(origin + layers[0] * direction) : 1.0;
}

void DrawHit() {
  vec3 p = origin + hit * direction;
  surface_color = vec4(hit_is_cap ? CapColor(p) : SurfaceColor(p), 1.0);
  gl_FragDepth = Depth(p);
}

void main() {
  surface_color = vec4(0.0);
  veil_color = vec4(0.0);
  veil_depth = 1.0;
  gl_FragDepth = 1.0;
  if (!FindRay()) return;
  Walk();
  DrawVeil();
  if (is_hit) DrawHit();
}
)";

std::string SurfaceShader() {
  return "#version 430 core\n#define MOST_LAYERS " + std::to_string(kMostVeilLayers) + "\n" +
         kShaderInputs + kShaderCell + kShaderRay + kShaderWalk + kShaderColors + kShaderLight +
         kShaderMain;
}

}  // namespace palpate::view
