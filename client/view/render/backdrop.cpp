#include "client/view/render/backdrop.h"

#include <epoxy/gl.h>

#include "client/view/render/gl_state.h"

namespace palpate::view {
namespace {

// The noise hides bands: the gradient is so weak that single steps of 1/255 would show.
constexpr char kBackdropShader[] = R"(#version 430 core
uniform sampler2D surface_color;
uniform sampler2D surface_depth;
uniform sampler2D veil_color;
uniform int has_surface;
uniform float height_px;
out vec4 color;

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
  vec3 seen = mix(vec3(0.060, 0.068, 0.084), vec3(0.168, 0.188, 0.224), gl_FragCoord.y / height_px);
  seen += (noise - 0.5) / 255.0;
  gl_FragDepth = 1.0;
  if (has_surface != 0) {
    vec4 surface = texelFetch(surface_color, pixel, 0);
    vec4 veil = texelFetch(veil_color, pixel, 0);
    seen = mix(seen, surface.rgb, surface.a);
    seen = seen * (1.0 - veil.a) + veil.rgb;
    gl_FragDepth = texelFetch(surface_depth, pixel, 0).r;
  }
  color = vec4(seen, 1.0);
}
)";

void BindTexture(int unit, GLuint texture) {
  glActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
  glBindTexture(GL_TEXTURE_2D, texture);
}

}  // namespace

Backdrop::Backdrop() : program_(kBackdropShader) {}

void Backdrop::Compose(const SurfaceCaster* surface, const ImageSize& size) {
  target_.Resize(size);
  if (target_.empty()) return;
  target_.Bind();
  ResetState();
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_ALWAYS);
  BindTexture(2, surface ? surface->veil_color() : 0);
  BindTexture(1, surface ? surface->depth() : 0);
  BindTexture(0, surface ? surface->color() : 0);
  program_.Use();
  program_.Set("surface_color", 0);
  program_.Set("surface_depth", 1);
  program_.Set("veil_color", 2);
  program_.Set("has_surface", surface ? 1 : 0);
  program_.Set("height_px", static_cast<double>(size.height));
  program_.Draw();
}

std::vector<float> Backdrop::ReadDepths() const {
  if (target_.empty()) return {};
  const ImageSize& size = target_.size();
  std::vector<float> depths(static_cast<std::size_t>(size.width) * size.height);
  glBindFramebuffer(GL_FRAMEBUFFER, target_.framebuffer());
  glReadPixels(0, 0, size.width, size.height, GL_DEPTH_COMPONENT, GL_FLOAT, depths.data());
  return depths;
}

float Backdrop::ReadDepth(int x_px, int y_from_bottom_px) const {
  float depth = 1.0f;
  glBindFramebuffer(GL_FRAMEBUFFER, target_.framebuffer());
  glReadPixels(x_px, y_from_bottom_px, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &depth);
  return depth;
}

}  // namespace palpate::view
