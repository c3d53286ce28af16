// Share 0 has the first colour, 1 the last.
vec3 ColorAt(sampler2D table, float share) {
  float entry = clamp(share, 0.0, 1.0) * 255.0;
  int below = min(int(entry), 254);
  return mix(texelFetch(table, ivec2(below, 0), 0).rgb,
             texelFetch(table, ivec2(below + 1, 0), 0).rgb, entry - float(below));
}

// The place of a value in a window of values. above_min: the value less the window's least value. A
// window of range 0 is a step.
float ShareOf(float above_min, float range) {
  return range != 0.0 ? above_min / range : step(0.0, above_min);
}
