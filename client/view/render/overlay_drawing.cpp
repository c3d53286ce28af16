#include "client/view/render/overlay_drawing.h"

#include <epoxy/gl.h>

#include <cstddef>
#include <span>
#include <string>

#include "client/view/render/gl_state.h"

namespace palpate::view {
namespace {

constexpr double kLineWidth_px = 1.5;

constexpr char kSolidVertexShader[] = R"(#version 430 core
layout(location = 0) in vec3 position_D;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 rgba;
layout(location = 3) in float alpha_behind;
uniform mat4 clip_from_D;
uniform int behind;
out vec3 fragment_D;
out vec3 fragment_normal;
flat out vec4 fragment_color;

void main() {
  fragment_D = position_D;
  fragment_normal = normal;
  fragment_color = vec4(rgba.rgb, behind != 0 ? alpha_behind : rgba.a);
  bool unseen = behind != 0 && alpha_behind == 0.0;
  gl_Position = unseen ? vec4(2.0, 2.0, 2.0, 1.0) : clip_from_D * vec4(position_D, 1.0);
}
)";

// The veil tints everything behind its nearest layer.
constexpr char kVeil[] = R"(
uniform sampler2D veil_color;
uniform sampler2D veil_depth;
uniform int has_veil;

vec3 Veiled(vec3 seen) {
  if (has_veil == 0) return seen;
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  if (texelFetch(veil_depth, pixel, 0).r >= gl_FragCoord.z) return seen;
  vec4 veil = texelFetch(veil_color, pixel, 0);
  return seen * (1.0 - veil.a) + veil.rgb;
}
)";

// Light from above and from the left of the eye, so that round bodies look round.
constexpr char kSolidFragmentShader[] = R"(
uniform vec3 eye_D;
uniform vec3 light_D;
in vec3 fragment_D;
in vec3 fragment_normal;
flat in vec4 fragment_color;
out vec4 color;

void main() {
  vec3 normal = normalize(fragment_normal);
  vec3 to_eye = normalize(eye_D - fragment_D);
  vec3 to_light = normalize(to_eye + light_D);
  float diffuse = max(dot(normal, to_light), 0.0);
  float gloss = pow(max(dot(normal, normalize(to_light + to_eye)), 0.0), 48.0);
  vec3 seen = fragment_color.rgb * (0.30 + 0.75 * diffuse) + 0.30 * gloss;
  color = vec4(Veiled(min(seen, 1.0)), fragment_color.a);
}
)";

// A line is a rectangle that faces the eye. It is a pixel wider than the line, so that its edge can
// fade.
constexpr char kLineVertexShader[] = R"(#version 430 core
layout(location = 0) in vec3 from_D;
layout(location = 1) in vec4 from_rgba;
layout(location = 2) in float from_alpha_behind;
layout(location = 3) in vec3 to_D;
layout(location = 4) in vec4 to_rgba;
layout(location = 5) in float to_alpha_behind;
uniform mat4 clip_from_D;
uniform vec2 half_size_px;
uniform float half_width_px;
uniform int behind;
noperspective out float across_px;
out vec4 fragment_color;

void main() {
  vec4 from = clip_from_D * vec4(from_D, 1.0);
  vec4 to = clip_from_D * vec4(to_D, 1.0);
  bool at_end = gl_VertexID >= 2;
  float side = (gl_VertexID & 1) == 0 ? -1.0 : 1.0;
  float alpha = at_end ? to_rgba.a : from_rgba.a;
  if (behind != 0) alpha = at_end ? to_alpha_behind : from_alpha_behind;
  fragment_color = vec4(at_end ? to_rgba.rgb : from_rgba.rgb, alpha);
  across_px = side * (half_width_px + 0.5);

  // A point beside or behind the eye has no place on the screen.
  const float nearest = 1e-4;
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (alpha == 0.0 || max(from.w, to.w) <= nearest) return;
  if (from.w < nearest) from = mix(to, from, (to.w - nearest) / (to.w - from.w));
  if (to.w < nearest) to = mix(from, to, (from.w - nearest) / (from.w - to.w));
  vec2 along = (to.xy / to.w - from.xy / from.w) * half_size_px;
  float length_px = length(along);
  if (length_px < 1e-3) return;
  vec2 aside = across_px * vec2(-along.y, along.x) / length_px;
  vec4 end = at_end ? to : from;
  gl_Position = vec4(end.xy + aside / half_size_px * end.w, end.zw);
}
)";

constexpr char kLineFragmentShader[] = R"(
uniform float half_width_px;
noperspective in float across_px;
in vec4 fragment_color;
out vec4 color;

void main() {
  float cover = clamp(half_width_px + 0.5 - abs(across_px), 0.0, 1.0);
  color = vec4(Veiled(fragment_color.rgb), fragment_color.a * cover);
}
)";

std::string WithVeil(const char* fragment_shader) {
  std::string text = "#version 430 core\n";
  text += kVeil;
  return text += fragment_shader;
}

// Of a shader, by location. Bytes are shares of 255.
struct Attribute {
  GLint numbers;
  GLenum type;
  std::size_t offset;
};
constexpr Attribute kSolidAttributes[] = {
    {3, GL_FLOAT, offsetof(SolidVertex, position_D)},
    {3, GL_FLOAT, offsetof(SolidVertex, normal)},
    {4, GL_UNSIGNED_BYTE, offsetof(SolidVertex, rgba)},
    {1, GL_UNSIGNED_BYTE, offsetof(SolidVertex, alpha_behind)}};
// Of both ends.
constexpr Attribute kLineAttributes[] = {
    {3, GL_FLOAT, offsetof(LineVertex, position_D)},
    {4, GL_UNSIGNED_BYTE, offsetof(LineVertex, rgba)},
    {1, GL_UNSIGNED_BYTE, offsetof(LineVertex, alpha_behind)},
    {3, GL_FLOAT, sizeof(LineVertex) + offsetof(LineVertex, position_D)},
    {4, GL_UNSIGNED_BYTE, sizeof(LineVertex) + offsetof(LineVertex, rgba)},
    {1, GL_UNSIGNED_BYTE, sizeof(LineVertex) + offsetof(LineVertex, alpha_behind)}};

// `stride`: bytes from vertex to vertex, or from instance to instance if `divisor` is 1.
void Describe(std::span<const Attribute> attributes, std::size_t stride, GLuint divisor,
              unsigned& vertices, unsigned& buffer) {
  glGenVertexArrays(1, &vertices);
  glBindVertexArray(vertices);
  glGenBuffers(1, &buffer);
  glBindBuffer(GL_ARRAY_BUFFER, buffer);
  for (GLuint n = 0; n < attributes.size(); ++n) {
    glVertexAttribPointer(n, attributes[n].numbers, attributes[n].type, GL_TRUE,
                          static_cast<GLsizei>(stride),
                          reinterpret_cast<const void*>(attributes[n].offset));
    glVertexAttribDivisor(n, divisor);
    glEnableVertexAttribArray(n);
  }
}

template <typename Vertex>
void Upload(GLuint buffer, const std::vector<Vertex>& vertices) {
  glBindBuffer(GL_ARRAY_BUFFER, buffer);
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(vertices.size() * sizeof(Vertex)),
               vertices.data(), GL_STREAM_DRAW);
}

void SetView(const ShaderProgram& program, const OverlayView& view, bool behind) {
  program.Use();
  program.Set("clip_from_D", view.clip_from_D);
  program.Set("behind", behind ? 1 : 0);
  program.Set("has_veil", view.veil_color != 0 ? 1 : 0);
  program.Set("veil_color", 0);
  program.Set("veil_depth", 1);
}

}  // namespace

OverlayDrawing::OverlayDrawing()
    : solid_program_(kSolidVertexShader, WithVeil(kSolidFragmentShader)),
      line_program_(kLineVertexShader, WithVeil(kLineFragmentShader)) {
  Describe(kSolidAttributes, sizeof(SolidVertex), 0, solid_vertices_, solid_buffer_);
  // A line is an instance.
  Describe(kLineAttributes, 2 * sizeof(LineVertex), 1, line_vertices_, line_buffer_);
}

OverlayDrawing::~OverlayDrawing() {
  glDeleteVertexArrays(1, &solid_vertices_);
  glDeleteBuffers(1, &solid_buffer_);
  glDeleteVertexArrays(1, &line_vertices_);
  glDeleteBuffers(1, &line_buffer_);
}

void OverlayDrawing::Draw(const Overlay& overlay, const OverlayView& view) {
  Upload(solid_buffer_, overlay.solids);
  Upload(line_buffer_, overlay.lines);
  BindTexture(1, GL_TEXTURE_2D, view.veil_depth);
  BindTexture(0, GL_TEXTURE_2D, view.veil_color);
  glEnable(GL_DEPTH_TEST);
  // A stylus may reach beyond the volume. It must not be cut at the far plane.
  glEnable(GL_DEPTH_CLAMP);
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
  // Drawn first, while the depth is that of the surface alone.
  DrawSide(/*behind=*/true, overlay, view);
  DrawSide(/*behind=*/false, overlay, view);
  glDisable(GL_BLEND);
  glDisable(GL_DEPTH_CLAMP);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_CULL_FACE);
  glDepthMask(GL_TRUE);
  glBindVertexArray(0);
}

void OverlayDrawing::DrawSide(bool behind, const Overlay& overlay, const OverlayView& view) const {
  glDepthFunc(behind ? GL_GREATER : GL_LESS);
  if (!overlay.solids.empty()) {
    glDepthMask(behind ? GL_FALSE : GL_TRUE);
    glEnable(GL_CULL_FACE);
    glCullFace(GL_BACK);
    glFrontFace(GL_CCW);
    SetView(solid_program_, view, behind);
    solid_program_.Set("eye_D", view.eye_D);
    // The rows of clip_from_D point right and up on the screen.
    const Vec3 right = view.clip_from_D.row(0).head<3>().normalized();
    const Vec3 up = view.clip_from_D.row(1).head<3>().normalized();
    solid_program_.Set("light_D", -0.45 * right + 0.6 * up);
    glBindVertexArray(solid_vertices_);
    glDrawArrays(GL_TRIANGLES, 0, static_cast<GLsizei>(overlay.solids.size()));
  }
  if (!overlay.lines.empty()) {
    // Faded edges must not hide other lines.
    glDepthMask(GL_FALSE);
    glDisable(GL_CULL_FACE);
    SetView(line_program_, view, behind);
    line_program_.Set("half_width_px", 0.5 * kLineWidth_px);
    line_program_.Set("half_size_px",
                      Eigen::Vector2d(0.5 * view.size.width, 0.5 * view.size.height));
    glBindVertexArray(line_vertices_);
    glDrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(overlay.lines.size() / 2));
  }
}

}  // namespace palpate::view
