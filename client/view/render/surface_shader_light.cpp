#include "client/view/render/surface_shader.h"

namespace palpate::view {

const char* const kShaderLight = R"(
// Weights of the cubic B-spline for the points -1 .. 2, and their derivatives.
vec4 Spline(float u) {
  float v = 1.0 - u;
  return vec4(v * v * v, 4.0 - 6.0 * u * u + 3.0 * u * u * u, 4.0 - 6.0 * v * v + 3.0 * v * v * v,
              u * u * u) / 6.0;
}
vec4 SplineSlope(float u) {
  float v = 1.0 - u;
  return vec4(-v * v, u * (3.0 * u - 4.0), v * (4.0 - 3.0 * v), u * u) / 2.0;
}

// The gradient of F in P, used only for light. The gradient of the trilinear F jumps from cell to
// cell, which would be visible. This gradient is of the volume's B-spline and is smooth. Values are
// summed as differences from `level`, a value nearby, which loses no digits.
vec3 Gradient(vec3 p, vec2 level) {
  ivec3 cell = CellAt(p);
  vec3 u = clamp(p - vec3(cell), 0.0, 1.0);
  vec4 x = Spline(u.x), y = Spline(u.y), z = Spline(u.z);
  vec4 dx = SplineSlope(u.x), dy = SplineSlope(u.y), dz = SplineSlope(u.z);
  vec3 sum = vec3(0.0);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      vec4 f;
      for (int k = 0; k < 4; ++k) {
        // Beyond the outermost layer, the layer is repeated.
        ivec3 at = clamp(cell + ivec3(i, j, k) - 1, ivec3(0), cells);
        f[k] = texelFetch(voxels, at.zyx, 0).r - level.x;
      }
      sum += vec3(dx[i] * y[j] * dot(z, f), x[i] * dy[j] * dot(z, f), x[i] * y[j] * dot(dz, f));
    }
  }
  return sum;
}

vec3 ToEye() { return -normalize(D_from_P * direction); }

// The normal in D, on the side from which the ray comes, because both sides of a surface are lit.
// `from_above`: that is the side of higher values. This gradient may point away from the eye where
// the trilinear one does not. It is then turned until it is at right angles to the line of sight.
vec3 Normal(vec3 gradient, bool from_above) {
  vec3 n = normal_D_from_P * (from_above ? gradient : -gradient);
  float size = length(n);
  if (size < 1e-20) return ToEye();
  n /= size;
  float towards_eye = dot(n, ToEye());
  if (towards_eye >= 0.0) return n;
  n -= towards_eye * ToEye();
  size = length(n);
  return size < 1e-3 ? ToEye() : n / size;
}

vec3 Linear(vec3 screen) { return pow(screen, vec3(2.2)); }
vec3 Screen(vec3 linear) { return pow(clamp(linear, 0.0, 1.0), vec3(1.0 / 2.2)); }

// A lamp above the left shoulder, a weak lamp at the eye, and a sky that is brighter above. Light
// is summed in linear colours.
vec3 Lit(vec3 screen_color, vec3 n) {
  vec3 to_eye = ToEye();
  vec3 to_lamp = normalize(to_eye + 0.8 * up_D - 0.7 * right_D);
  float lamp = max(dot(n, to_lamp), 0.0);
  float head = max(dot(n, to_eye), 0.0);
  float sky = 0.5 + 0.5 * dot(n, up_D);
  float shine = pow(max(dot(n, normalize(to_lamp + to_eye)), 0.0), 50.0);
  vec3 color = Linear(screen_color) * (0.85 * lamp + 0.2 * head * head + 0.01 + 0.06 * sky);
  return Screen(color + 0.12 * shine);
}

vec3 SurfaceColor(vec3 p) {
  vec3 gradient = Gradient(p, isovalue);
  vec3 color = plain_color;
  if (coloring == 1) color = ColorAt(color_map, (p.z - 1.0) / max(float(cells.z - 2), 1.0));
  if (coloring == 2) color = ColorAt(color_map, length(normal_D_from_P * (gradient / steepest)));
  return Lit(color, Normal(gradient, above));
}

// Without light: users read values off a cut.
vec3 CapColor(vec3 p) {
  return ColorAt(color_map, ShareOf(AboveAt(p, window_min), window_range));
}
)";

}  // namespace palpate::view
