layout(location = 0) out vec4 surface_color;
layout(location = 1) out vec4 veil_color;
layout(location = 2) out float veil_depth;
layout(location = 3) out float surface_depth;

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
uniform vec2 isovalue;  // all values are split: see brick_cache.h
uniform bool material_above;
uniform bool caps;
// Veils: VEILS of them, each with an isovalue and a colour of its own.
const bool veil_shown = VEILS > 0;
const int kVeils = VEILS > 0 ? VEILS : 1;
uniform vec2 veil_isovalue[kVeils];

uniform mat3 D_from_P;  // of directions
uniform mat3 normal_D_from_P;
uniform vec3 right_D;
uniform vec3 up_D;
uniform vec3 plain_color;
uniform vec3 veil_plain_color[kVeils];
uniform float veil_opacity;
uniform int coloring;
uniform vec2 window_min;
uniform float window_range;
uniform float steepest;  // gradient per mm that has the colour map's last colour
