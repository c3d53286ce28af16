#include "client/view/render/surface_shader.h"

namespace palpate::view {

const char* const kShaderWalk = R"(
// What the ray has hit.
bool is_hit = false;
bool hit_is_cap = false;
float hit = 0.0;
int layer_count = 0;
float layers[MOST_LAYERS];

// The sides on which the ray is. They are carried from cell to cell. If the next cell begins on the
// other side, even only by rounding, the surface is in between.
bool above;
bool veil_above;
bool veil_begins_above;

void MeetVeil(float t) {
  veil_above = !veil_above;
  if (layer_count >= MOST_LAYERS) return;
  layers[layer_count] = t;
  ++layer_count;
}

void MeetSurface(float t) {
  is_hit = true;
  hit = t;
}

// Passes cells from t on whose values are all within `range`. `range` contains neither isovalue.
void PassUniform(float t, vec2 range) {
  if (veil_shown && (range.x > veil_isovalue.x) != veil_above) MeetVeil(t);
  if (surface_shown && (range.x > isovalue.x) != above) MeetSurface(t);
}

bool Crossed(vec2 range, vec2 value) { return range.x <= value.x && range.y > value.x; }

bool Active(vec2 range) {
  return (surface_shown && Crossed(range, isovalue)) ||
         (veil_shown && Crossed(range, veil_isovalue));
}

void PassVeil(Corners corners, vec3 u, float t, float length) {
  vec4 cubic = CubicAlong(corners, veil_isovalue, u, direction);
  float from = 0.0;
  float crossing;
  // At most a different side at the start and the cubic's three roots.
  for (int n = 0; n < 4 && FindCrossing(cubic, from, length, veil_above, crossing); ++n) {
    MeetVeil(t + crossing);
    from = max(crossing, 1e-30);
  }
}

// Passes the part of the ray from t to t_next, which is in this cell.
void PassCell(ivec3 cell, float t, float t_next) {
  Corners corners = CornersOf(cell);
  vec2 range = vec2(Least(corners), Greatest(corners));
  if (!Active(range)) {
    PassUniform(t, range);
    return;
  }
  vec3 u = clamp(origin + t * direction - vec3(cell), 0.0, 1.0);
  float length = t_next - t;
  if (surface_shown) {
    float crossing;
    if (FindCrossing(CubicAlong(corners, isovalue, u, direction), 0.0, length, above, crossing)) {
      MeetSurface(t + crossing);
      length = crossing;
    }
  }
  if (veil_shown) PassVeil(corners, u, t, length);
}

// Passes the cells of a brick from t to t_end.
void WalkCells(ivec3 low, ivec3 high, float t, float t_end) {
  // Near a border, rounding may choose the cell before or after the right one. The ray's part in
  // the wrong cell then has length 0.
  ivec3 cell = clamp(ivec3(floor(origin + t * direction)), low, high - 1);
  while (!is_hit) {
    vec3 leave = LeaveOf(cell, cell + 1);
    int axis = FirstAxis(leave);
    float t_next = clamp(leave[axis], t, t_end);
    PassCell(cell, t, t_next);
    if (leave[axis] >= t_end) return;
    cell[axis] += direction[axis] > 0.0 ? 1 : -1;
    if (cell[axis] < low[axis] || cell[axis] >= high[axis]) return;
    t = t_next;
  }
}

// The range of the background, which surrounds the lattice.
vec2 OutsideRange() { return texelFetch(voxels, ivec3(0), 0).rr; }

// Sets the sides on which the ray begins: from the background in the outermost layer, or from the
// value at the start if that is at a cut or at the eye.
void BeginSides() {
  Corners start = CornersOf(CellAt(origin));
  vec3 u = clamp(origin - vec3(CellAt(origin)), 0.0, 1.0);
  above = Above(start, isovalue, u) > 0.0;
  veil_above = Above(start, veil_isovalue, u) > 0.0;
  veil_begins_above = veil_above;
}

void WalkBricks() {
  ivec3 brick = CellAt(origin) >> 3;
  ivec3 bricks = (cells + 7) >> 3;
  float t = 0.0;
  while (!is_hit) {
    ivec3 low = brick << 3;
    ivec3 high = min(low + 8, cells);
    vec3 leave = LeaveOf(low, high);
    int axis = FirstAxis(leave);
    float t_next = clamp(leave[axis], t, reach);
    vec2 range = texelFetch(ranges, brick.zyx, 0).rg;
    if (Active(range)) {
      WalkCells(low, high, t, t_next);
    } else {
      PassUniform(t, range);
    }
    if (leave[axis] >= reach) return;
    brick[axis] += direction[axis] > 0.0 ? 1 : -1;
    if (brick[axis] < 0 || brick[axis] >= bricks[axis]) return;
    t = t_next;
  }
}

void Walk() {
  BeginSides();
  if (surface_shown && caps && at_cut && above == material_above) {
    hit_is_cap = true;
    MeetSurface(0.0);
    return;
  }
  WalkBricks();
  // A surface that reaches the volume's border is closed there.
  if (!is_hit && ends_outside) PassUniform(reach, OutsideRange());
}
)";

}  // namespace palpate::view
