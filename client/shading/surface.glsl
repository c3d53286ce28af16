float Depth(vec3 p) {
  vec4 q = vec4(p, 1.0);
  return clamp(0.5 * dot(clip_z, q) / dot(clip_w, q) + 0.5, 0.0, 1.0);
}

void DrawVeil() {
  vec4 sum = vec4(0.0);
  bool from_above[kVeils] = veil_begins_above;
  for (int n = 0; n < layer_count; ++n) {
    int veil = layer_veil[n];
    vec3 p = origin + layers[n] * direction;
    vec3 normal = Normal(Gradient(p, veil_isovalue[veil]), from_above[veil]);
    from_above[veil] = !from_above[veil];
    vec3 color = Lit(veil_plain_color[veil], normal);
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
  Finish();
}
