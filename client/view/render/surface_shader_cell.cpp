#include "client/view/render/surface_shader.h"

namespace palpate::view {

const char* const kShaderCell = R"(
// Values at the corners of a cell: `low` at its lower x, `high` at its upper x. Each has (y, z) =
// (0, 0), (0, 1), (1, 0), (1, 1).
struct Corners {
  vec4 low;
  vec4 high;
};

Corners CornersOf(ivec3 cell) {
  ivec3 t = cell.zyx;
  return Corners(vec4(texelFetch(voxels, t, 0).r,
                      texelFetchOffset(voxels, t, 0, ivec3(1, 0, 0)).r,
                      texelFetchOffset(voxels, t, 0, ivec3(0, 1, 0)).r,
                      texelFetchOffset(voxels, t, 0, ivec3(1, 1, 0)).r),
                 vec4(texelFetchOffset(voxels, t, 0, ivec3(0, 0, 1)).r,
                      texelFetchOffset(voxels, t, 0, ivec3(1, 0, 1)).r,
                      texelFetchOffset(voxels, t, 0, ivec3(0, 1, 1)).r,
                      texelFetchOffset(voxels, t, 0, ivec3(1, 1, 1)).r));
}

float Least(Corners c) {
  vec4 m = min(c.low, c.high);
  return min(min(m.x, m.y), min(m.z, m.w));
}

float Greatest(Corners c) {
  vec4 m = max(c.low, c.high);
  return max(max(m.x, m.y), max(m.z, m.w));
}

// Exact at both ends, and never positive if a and b are not. So a face whose corners are all at or
// below the isovalue stays on that side.
float Between(float a, float b, float u) { return a * (1.0 - u) + b * u; }
vec4 Between(vec4 a, vec4 b, float u) { return a * (1.0 - u) + b * u; }

// Bilinear over (y, z), and its derivatives.
float Face(vec4 f, vec3 u) {
  return Between(Between(f.x, f.y, u.z), Between(f.z, f.w, u.z), u.y);
}
float FaceByY(vec4 f, vec3 u) { return Between(f.z, f.w, u.z) - Between(f.x, f.y, u.z); }
float FaceByZ(vec4 f, vec3 u) { return Between(f.y - f.x, f.w - f.z, u.y); }
float FaceByYZ(vec4 f) { return (f.w - f.z) - (f.y - f.x); }

ivec3 CellAt(vec3 p) { return clamp(ivec3(floor(p)), ivec3(0), cells - 1); }

// F - value. If both are near each other, as exact as with doubles. Above 0 exactly where F is
// above the value.
vec4 Above(vec4 f, vec2 value) {
  precise vec4 above = (f - value.x) - value.y;
  return above;
}

// The same within a cell. The same expressions as for the cubic's value at its start.
float Above(Corners c, vec2 value, vec3 u) {
  return Face(Between(Above(c.low, value), Above(c.high, value), u.x), u);
}

float AboveAt(vec3 p, vec2 value) {
  ivec3 cell = CellAt(p);
  return Above(CornersOf(cell), value, clamp(p - vec3(cell), 0.0, 1.0));
}

// F - isovalue along u + s d as powers of s. Subtracts the isovalue from the corners, which is
// exact or nearly so, and not from the sum.
vec4 CubicAlong(Corners c, vec2 isovalue, vec3 u, vec3 d) {
  vec4 low = Above(c.low, isovalue);
  vec4 high = Above(c.high, isovalue);
  vec4 at = Between(low, high, u.x);
  vec4 by_x = high - low;
  return vec4(Face(at, u),
              d.x * Face(by_x, u) + d.y * FaceByY(at, u) + d.z * FaceByZ(at, u),
              d.x * d.y * FaceByY(by_x, u) + d.x * d.z * FaceByZ(by_x, u) +
                  d.y * d.z * FaceByYZ(at),
              d.x * d.y * d.z * FaceByYZ(by_x));
}

float Cubic(vec4 c, float s) { return ((c.w * s + c.z) * s + c.y) * s + c.x; }

// Where the cubic turns within [from, to], ascending; `to` where it does not turn.
vec2 Turns(vec4 c, float from, float to) {
  float a = 3.0 * c.w;
  float b = c.z;
  float discriminant = b * b - a * c.y;
  if (!(discriminant > 0.0)) return vec2(to);
  // The sum without cancellation; the other root by Vieta's formula.
  float q = -(b + (b < 0.0 ? -1.0 : 1.0) * sqrt(discriminant));
  vec2 turns = vec2(a == 0.0 ? to : q / a, c.y / q);
  return clamp(vec2(min(turns.x, turns.y), max(turns.x, turns.y)), from, to);
}

// The crossing within [a, b]. The cubic must be monotone there and have different sides at the
// ends. Uses regula falsi, and bisection if that is slow. The result is on b's side, so that a
// search can continue from it.
float Refine(vec4 c, float a, float b) {
  const float kEnough = 2e-5;
  float at_a = Cubic(c, a);
  float at_b = Cubic(c, b);
  bool above_b = at_b > 0.0;
  for (int n = 0; n < 40 && b - a > kEnough; ++n) {
    float s = n % 3 == 2 ? 0.5 * (a + b) : a + (b - a) * (at_a / (at_a - at_b));
    s = clamp(s, a + 0.4 * kEnough, b - 0.4 * kEnough);
    float at_s = Cubic(c, s);
    if ((at_s > 0.0) == above_b) {
      b = s;
      at_b = at_s;
    } else {
      a = s;
      at_a = at_s;
    }
  }
  return b;
}

// Finds the first point of [from, to] that is not on the side `above`.
bool FindCrossing(vec4 c, float from, float to, bool above, out float crossing) {
  crossing = from;
  if ((c.x > 0.0) != above && from == 0.0) return true;
  vec2 turns = Turns(c, from, to);
  float ends[3] = float[3](turns.x, turns.y, to);
  float a = from;
  for (int n = 0; n < 3; ++n) {
    if ((Cubic(c, ends[n]) > 0.0) != above) {
      crossing = Refine(c, a, ends[n]);
      return true;
    }
    a = ends[n];
  }
  return false;
}
)";

}  // namespace palpate::view
