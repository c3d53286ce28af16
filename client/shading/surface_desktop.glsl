layout(early_fragment_tests) in;  // the depth test masks finished pixels

// Of each pixel: 1 if it wants bricks that were missing.
layout(std430, binding = 1) buffer Unfinished { uint unfinished[]; };
uniform int image_width;

void Finish() {
  int pixel = int(gl_FragCoord.y) * image_width + int(gl_FragCoord.x);
  unfinished[pixel] = is_unfinished ? 1u : 0u;
}
