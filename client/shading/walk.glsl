// What the ray has hit.
bool is_hit = false;
bool hit_is_cap = false;
float hit = 0.0;
int layer_count = 0;
float layers[MOST_LAYERS];  // where the ray meets veils, ascending
int layer_veil[MOST_LAYERS];

// The sides on which the ray is. They are carried from cell to cell. If the next cell begins on the
// other side, even only by rounding, the surface is in between.
bool above;
bool veil_above[kVeils];
bool veil_begins_above[kVeils];

// Within a cell, veils are met one after the other, not in the order along the ray.
void MeetVeil(int veil, float t) {
  veil_above[veil] = !veil_above[veil];
  if (layer_count >= MOST_LAYERS) return;
  int n = layer_count;
  for (; n > 0 && layers[n - 1] > t; --n) {
    layers[n] = layers[n - 1];
    layer_veil[n] = layer_veil[n - 1];
  }
  layers[n] = t;
  layer_veil[n] = veil;
  ++layer_count;
}

void MeetSurface(float t) {
  is_hit = true;
  hit = t;
}

// Passes cells from t on whose values are all within `range`. `range` contains neither isovalue.
void PassUniform(float t, vec2 range) {
  for (int v = 0; v < VEILS; ++v) {
    if ((range.x > veil_isovalue[v].x) != veil_above[v]) MeetVeil(v, t);
  }
  if (surface_shown && (range.x > isovalue.x) != above) MeetSurface(t);
}

bool Crossed(vec2 range, vec2 value) { return range.x <= value.x && range.y > value.x; }

bool Active(vec2 range) {
  bool crossed = surface_shown && Crossed(range, isovalue);
  for (int v = 0; v < VEILS; ++v) crossed = crossed || Crossed(range, veil_isovalue[v]);
  return crossed;
}

void PassVeil(int veil, Corners corners, vec3 u, vec3 d, float t, float length) {
  vec4 cubic = CubicAlong(corners, veil_isovalue[veil], u, d);
  float from = 0.0;
  float crossing;
  // At most a different side at the start and the cubic's three roots.
  for (int n = 0; n < 4 && FindCrossing(cubic, from, length, veil_above[veil], crossing); ++n) {
    MeetVeil(veil, t + crossing);
    from = max(crossing, 1e-30);
  }
}

// The three walks below have the same form: an inner loop finds the next part whose range contains an
// isovalue, and what is done there comes after that loop. Rays that are computed together wait for
// each other, so what is costly must not be in a loop that most of them only pass through.

// Meets the surface and the veil in a cell, from t to t_next. `d` is the direction in edges of the
// cell.
void CrossCell(Corners corners, vec3 u, vec3 d, float t, float t_next) {
  float length = t_next - t;
  if (surface_shown) {
    float crossing;
    if (FindCrossing(CubicAlong(corners, isovalue, u, d), 0.0, length, above, crossing)) {
      MeetSurface(t + crossing);
      length = crossing;
    }
  }
  for (int v = 0; v < VEILS; ++v) PassVeil(v, corners, u, d, t, length);
}

// Passes the cells of a brick, low .. high - 1, from t to t_end. Without a fine slot, the brick is
// one cell.
void WalkCells(uvec4 block, ivec3 brick, uint slot, float t, float t_end) {
  ivec3 low = brick << 3;
  ivec3 high = min(low + 8, cells);
  bool is_fine = slot != kNone;
  int edge = is_fine ? 1 : 8;
  float per_edge = is_fine ? 1.0 : 0.125;
  ivec3 first = SlotOrigin(is_fine ? slot : block.w) + (is_fine ? ivec3(0) : (brick & 7).zyx);
  // Near a border, rounding may choose the cell before or after the right one. The ray's part in
  // the wrong cell then has length 0.
  ivec3 cell = is_fine ? clamp(ivec3(floor(origin + t * direction)), low, high - 1) : low;
  bool more = true;
  while (more && !is_hit) {
    bool found = false;
    Corners corners;
    vec3 u;
    float from;
    while (more && !found && !is_hit) {
      vec3 leave = LeaveOf(cell, cell + edge);
      int axis = FirstAxis(leave);
      corners = CornersAt(first + (cell - low).zyx);
      vec2 range = vec2(Least(corners), Greatest(corners));
      found = Active(range);
      if (!found) PassUniform(t, range);
      u = clamp((origin + t * direction - vec3(cell)) * per_edge, 0.0, 1.0);
      from = t;
      t = clamp(leave[axis], t, t_end);
      cell[axis] += direction[axis] > 0.0 ? edge : -edge;
      more = leave[axis] < t_end && cell[axis] >= low[axis] && cell[axis] < high[axis];
    }
    if (found) CrossCell(corners, u, direction * per_edge, from, t);
  }
}

// Passes the cell bricks of a block from t to t_end.
void WalkBricks(uvec4 block, ivec3 block_place, float t, float t_end) {
  ivec3 low = block_place << 3;
  ivec3 high = min(low + 8, (cells + 7) >> 3);
  ivec3 brick = clamp(ivec3(floor(origin + t * direction)) >> 3, low, high - 1);
  bool more = true;
  while (more && !is_hit) {
    bool found = false;
    ivec3 place;
    int entry;
    float from;
    while (more && !found && !is_hit) {
      vec3 leave = LeaveOf(brick << 3, min((brick << 3) + 8, cells));
      int axis = FirstAxis(leave);
      place = brick;
      entry = EntryOf(block, brick);
      vec2 range = BrickRange(entry);
      found = Active(range);
      if (!found) PassUniform(t, range);
      from = t;
      t = clamp(leave[axis], t, t_end);
      brick[axis] += direction[axis] > 0.0 ? 1 : -1;
      more = leave[axis] < t_end && brick[axis] >= low[axis] && brick[axis] < high[axis];
    }
    if (found) WalkCells(block, place, WantedSlot(entry), from, t);
  }
}

void WalkBlocks() {
  ivec3 block = CellAt(origin) >> 6;
  float t = 0.0;
  bool more = true;
  while (more && !is_hit) {
    bool found = false;
    ivec3 place;
    uvec4 here;
    float from;
    while (more && !found && !is_hit) {
      vec3 leave = LeaveOf(block << 6, min((block << 6) + 64, cells));
      int axis = FirstAxis(leave);
      place = block;
      here = BlockAt(block);
      vec2 range = RangeOf(here);
      // A block without a table has one value.
      found = Active(range);
      if (!found) PassUniform(t, range);
      from = t;
      t = clamp(leave[axis], t, reach);
      block[axis] += direction[axis] > 0.0 ? 1 : -1;
      more = leave[axis] < reach && block[axis] >= 0 && block[axis] < block_count[axis];
    }
    if (found) WalkBricks(here, place, from, t);
  }
}

// Sets the sides on which the ray begins: from the background where it enters from outside, or from
// the value at the start if that is at a cut or at the eye.
void BeginSides() {
  vec2 range = begins_outside ? vec2(background) : RangeAt(origin);
  above = range.x > isovalue.x;
  for (int v = 0; v < kVeils; ++v) veil_above[v] = range.x > veil_isovalue[v].x;
  if (Active(range)) {
    Cell cell = CellOf(origin);
    above = Above(cell.corners, isovalue, cell.u) > 0.0;
    for (int v = 0; v < kVeils; ++v) {
      veil_above[v] = Above(cell.corners, veil_isovalue[v], cell.u) > 0.0;
    }
  }
  veil_begins_above = veil_above;
}

void Walk() {
  BeginSides();
  if (surface_shown && caps && at_cut && above == material_above) {
    hit_is_cap = true;
    MeetSurface(0.0);
    return;
  }
  WalkBlocks();
  // A surface that reaches the volume's border is closed there.
  if (!is_hit && ends_outside) PassUniform(reach, vec2(background));
}
