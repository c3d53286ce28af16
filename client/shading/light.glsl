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

// Where the values around a cell are: in the slots of up to eight cell bricks.
struct Near {
  ivec3 texel;  // that lattice point (0, 0, 0) would have
  ivec3 low;    // the first point of the slot
  bool is_one_value;
  float value;
};

// A cell brick by the cell `own`. If it is missing, the nearest values of `own_near` take its place.
Near NearAt(ivec3 brick, ivec3 own_brick, Near own_near) {
  if (brick == own_brick) return own_near;
  uvec4 block = BlockAt(brick >> 3);
  vec2 range = RangeOf(block);
  int entry = EntryOf(block, brick);
  if (block.z != kNone) range = BrickRange(entry);
  if (range.x == range.y) return Near(own_near.texel, own_near.low, true, range.x);
  uint slot = WantedSlot(entry);
  if (slot == kNone) return own_near;
  ivec3 low = brick << 3;
  return Near(SlotOrigin(slot) - low.zyx, low, false, 0.0);
}

float ValueIn(Near near, ivec3 at) {
  float value = Texel(near.texel + clamp(at, near.low, near.low + 8).zyx);
  return near.is_one_value ? near.value : value;
}

// The gradient of the volume's B-spline at a cell whose own brick is there.
vec3 SplineGradient(ivec3 cell, vec3 u, Near own, vec2 level) {
  vec4 x = Spline(u.x), y = Spline(u.y), z = Spline(u.z);
  vec4 dx = SplineSlope(u.x), dy = SplineSlope(u.y), dz = SplineSlope(u.z);
  // Beyond the outermost layer, the layer is repeated. The last points belong to the last cells.
  ivec3 b = cell >> 3;
  ivec3 l = max(cell - 1, ivec3(0)) >> 3;
  ivec3 h = min(cell + 2, cells - 1) >> 3;
  Near lll = NearAt(l, b, own), llh = NearAt(ivec3(l.xy, h.z), b, own);
  Near lhl = NearAt(ivec3(l.x, h.y, l.z), b, own), lhh = NearAt(ivec3(l.x, h.yz), b, own);
  Near hll = NearAt(ivec3(h.x, l.yz), b, own), hlh = NearAt(ivec3(h.x, l.y, h.z), b, own);
  Near hhl = NearAt(ivec3(h.xy, l.z), b, own), hhh = NearAt(h, b, own);
  vec3 sum = vec3(0.0);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      vec4 f;
      for (int k = 0; k < 4; ++k) {
        ivec3 at = clamp(cell + ivec3(i, j, k) - 1, ivec3(0), cells);
        bvec3 is_low = equal(min(at, cells - 1) >> 3, l);
        // GLSL ES has no ?: for structs.
        Near near = hhh;
        if (is_low.x) {
          if (is_low.y) {
            if (is_low.z) near = lll; else near = llh;
          } else {
            if (is_low.z) near = lhl; else near = lhh;
          }
        } else if (is_low.y) {
          if (is_low.z) near = hll; else near = hlh;
        } else if (is_low.z) {
          near = hhl;
        }
        f[k] = ValueIn(near, at) - level.x;
      }
      sum += vec3(dx[i] * y[j] * dot(z, f), x[i] * dy[j] * dot(z, f), x[i] * y[j] * dot(dz, f));
    }
  }
  return sum;
}

// The gradient of F in P, used only for light. The gradient of the trilinear F jumps from cell to
// cell, which would be visible. The one of the volume's B-spline is smooth. Values are summed as
// differences from `level`, a value nearby, which loses no digits. A coarse cell has its own.
vec3 Gradient(vec3 p, vec2 level) {
  ivec3 cell = CellAt(p);
  ivec3 brick = cell >> 3;
  uvec4 block = BlockAt(brick >> 3);
  vec2 range = RangeOf(block);
  int entry = EntryOf(block, brick);
  if (block.z != kNone) range = BrickRange(entry);
  bool is_one_value = range.x == range.y;
  uint slot = 0u;
  if (!is_one_value) slot = WantedSlot(entry);
  if (slot == kNone) return TrilinearGradient(CellOf(p), level);
  ivec3 low = brick << 3;
  Near own = Near(SlotOrigin(slot) - low.zyx, low, is_one_value, range.x);
  return SplineGradient(cell, clamp(p - vec3(cell), 0.0, 1.0), own, level);
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
