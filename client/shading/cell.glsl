vec2 RangeOf(uvec4 block) { return uintBitsToFloat(block.xy); }

// Values at the corners of a cell: `low` at its lower x, `high` at its upper x. Each has (y, z) =
// (0, 0), (0, 1), (1, 0), (1, 1).
struct Corners {
  vec4 low;
  vec4 high;
};

// From the texel of the cell's first corner on.
Corners CornersAt(ivec3 t) {
  return Corners(vec4(Texel(t), Texel(t + ivec3(1, 0, 0)), Texel(t + ivec3(0, 1, 0)),
                      Texel(t + ivec3(1, 1, 0))),
                 vec4(Texel(t + ivec3(0, 0, 1)), Texel(t + ivec3(1, 0, 1)),
                      Texel(t + ivec3(0, 1, 1)), Texel(t + ivec3(1, 1, 1))));
}

ivec3 CellAt(vec3 p) { return clamp(ivec3(floor(p)), ivec3(0), cells - 1); }

// The cell at a point, as it can be drawn: a coarse one spans a cell brick.
struct Cell {
  Corners corners;
  vec3 u;      // the point within it, 0 to 1
  float edge;  // 1 or 8
};

// The range of the cell brick at a point.
vec2 RangeAt(vec3 p) {
  ivec3 brick = CellAt(p) >> 3;
  uvec4 block = BlockAt(brick >> 3);
  return block.z == kNone ? RangeOf(block) : BrickRange(EntryOf(block, brick));
}

Cell CellOf(vec3 p) {
  ivec3 cell = CellAt(p);
  ivec3 brick = cell >> 3;
  uvec4 block = BlockAt(brick >> 3);
  vec2 range = RangeOf(block);
  int entry = EntryOf(block, brick);
  if (block.z != kNone) range = BrickRange(entry);
  if (range.x == range.y) return Cell(Corners(vec4(range.x), vec4(range.x)), vec3(0.0), 1.0);
  uint slot = WantedSlot(entry);
  bool is_fine = slot != kNone;
  ivec3 low = is_fine ? cell : brick << 3;
  float edge = is_fine ? 1.0 : 8.0;
  ivec3 texel = SlotOrigin(is_fine ? slot : block.w) + ((is_fine ? cell : brick) & 7).zyx;
  return Cell(CornersAt(texel), clamp((p - vec3(low)) / edge, 0.0, 1.0), edge);
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

// F - value. If both are near each other, as exact as with doubles. Above 0 exactly where F is
// above the value.
vec4 Above(vec4 f, vec2 value) {
  PRECISE vec4 above = (f - value.x) - value.y;
  return above;
}

// The same within a cell. The same expressions as for the cubic's value at its start.
float Above(Corners c, vec2 value, vec3 u) {
  return Face(Between(Above(c.low, value), Above(c.high, value), u.x), u);
}

float AboveAt(vec3 p, vec2 value) {
  Cell cell = CellOf(p);
  return Above(cell.corners, value, cell.u);
}

// The trilinear gradient, of the values less `level`.
vec3 TrilinearGradient(Cell cell, vec2 level) {
  vec4 low = Above(cell.corners.low, level);
  vec4 high = Above(cell.corners.high, level);
  vec4 at = Between(low, high, cell.u.x);
  return vec3(Face(high - low, cell.u), FaceByY(at, cell.u), FaceByZ(at, cell.u)) / cell.edge;
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
