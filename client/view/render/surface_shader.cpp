#include "client/view/render/surface_shader.h"

#include "client/view/render/color_texture.h"

namespace palpate::view {

const char* const kShaderInputs = R"(
layout(location = 0) out vec4 surface_color;
layout(location = 1) out vec4 veil_color;
layout(location = 2) out float veil_depth;

layout(location = 3) out float surface_depth;
layout(early_fragment_tests) in;  // the depth test masks finished pixels

// Of each pixel: 1 if it wants bricks that were missing.
layout(std430, binding = 1) buffer Unfinished { uint unfinished[]; };
uniform int image_width;

uniform sampler2D color_map;

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
const bool veil_shown = VEIL;
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
  surface_depth = Depth(p);
}

void Cast() {
  if (!FindRay()) return;
  Walk();
  if (veil_shown) DrawVeil();
  if (is_hit) DrawHit();
}

void main() {
  surface_color = vec4(0.0);
  veil_color = vec4(0.0);
  veil_depth = 1.0;
  surface_depth = 1.0;
  Cast();
  int pixel = int(gl_FragCoord.y) * image_width + int(gl_FragCoord.x);
  unfinished[pixel] = is_unfinished ? 1u : 0u;
}
)";

std::string SurfaceShader(bool with_veil) {
  return std::string("#define VEIL ") + (with_veil ? "true" : "false") + "\n#define MOST_LAYERS " +
         std::to_string(kMostVeilLayers) + "\n" + kShaderInputs + kShaderRay + kShaderWalk +
         kShaderColors + kShaderLight + kShaderMain;
}

}  // namespace palpate::view
