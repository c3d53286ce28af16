#include "client/view/render/slice_drawing.h"

#include <epoxy/gl.h>

#include <string>

#include "client/view/scene/slice_view.h"

namespace palpate::view {
namespace {

constexpr char kVersion[] = "#version 430 core\n";

// The distance to an isoline is the difference of value and isovalue, divided by the gradient per
// pixel. A dark rim makes the line visible on any colour map.
constexpr char kSliceShader[] = R"(
uniform sampler3D voxels;
uniform sampler2D color_table;
uniform ivec3 lattice_size;
uniform vec3 corner_I;     // at the picture's upper left corner
uniform vec3 right_I;      // for a pixel to the right
uniform vec3 down_I;       // for a pixel down
uniform float height_px;
uniform vec2 window_min;   // value of the colour map's first colour, split
uniform float window_range;
uniform vec2 isovalues;    // of surface and veil, above window_min
uniform int isolines;      // how many of the two are shown
uniform vec3 isoline_color;
uniform vec3 veil_color;
uniform vec3 empty_color;
uniform vec2 cross_px;     // pixels from the upper left corner; negative: none
out vec4 color;

// Reads a voxel with the layout of volume_texture.h. The result is relative to window_min, so that
// small differences of large values keep their digits.
float At(ivec3 voxel) {
  precise float above = (texelFetch(voxels, voxel.zyx + 1, 0).r - window_min.x) - window_min.y;
  return above;
}

// The value relative to window_min, and its gradient along the axes of I.
vec4 ValueAndGradient(vec3 p) {
  ivec3 cell = clamp(ivec3(floor(p)), ivec3(-1), lattice_size - 1);
  vec3 t = p - vec3(cell);
  vec4 low = vec4(At(cell), At(cell + ivec3(0, 0, 1)), At(cell + ivec3(0, 1, 0)),
                  At(cell + ivec3(0, 1, 1)));
  vec4 high = vec4(At(cell + ivec3(1, 0, 0)), At(cell + ivec3(1, 0, 1)),
                   At(cell + ivec3(1, 1, 0)), At(cell + ivec3(1, 1, 1)));
  vec4 at_x = mix(low, high, t.x);
  vec4 rise_x = high - low;
  vec2 at_xy = mix(at_x.xy, at_x.zw, t.y);
  vec2 rise_y = at_x.zw - at_x.xy;
  vec2 rise_x_at_y = mix(rise_x.xy, rise_x.zw, t.y);
  return vec4(mix(rise_x_at_y.x, rise_x_at_y.y, t.z), mix(rise_y.x, rise_y.y, t.z),
              at_xy.y - at_xy.x, mix(at_xy.x, at_xy.y, t.z));
}

vec3 WithIsoline(vec3 seen, float difference, float slope_per_px, vec3 line_color) {
  if (slope_per_px <= 0.0) return seen;
  float distance_px = abs(difference) / slope_per_px;
  seen = mix(seen, vec3(0.0), 0.55 * clamp(2.5 - distance_px, 0.0, 1.0));
  return mix(seen, line_color, clamp(1.5 - distance_px, 0.0, 1.0));
}

void main() {
  vec2 at_px = vec2(gl_FragCoord.x, height_px - gl_FragCoord.y);
  vec3 p = corner_I + at_px.x * right_I + at_px.y * down_I;
  vec3 seen = empty_color;
  if (all(greaterThanEqual(p, vec3(-1.0))) && all(lessThanEqual(p, vec3(lattice_size)))) {
    vec4 found = ValueAndGradient(p);
    seen = ColorAt(color_table, ShareOf(found.w, window_range));
    float slope = length(vec2(dot(found.xyz, right_I), dot(found.xyz, down_I)));
    if (isolines > 1) seen = WithIsoline(seen, found.w - isovalues.y, slope, veil_color);
    if (isolines > 0) seen = WithIsoline(seen, found.w - isovalues.x, slope, isoline_color);
  }
  if (cross_px.x >= 0.0) {
    vec2 away = abs(at_px - cross_px);
    // The centre of the cross-hair stays free.
    if (min(away.x, away.y) <= 0.5 && max(away.x, away.y) > 6.0) {
      seen = mix(seen, vec3(0.55, 0.95, 1.0), 0.75);
    }
  }
  color = vec4(seen, 1.0);
}
)";

}  // namespace

SliceDrawing::SliceDrawing() : program_(std::string(kVersion) + kShaderColors + kSliceShader) {}

void SliceDrawing::Draw(const VolumeTexture& volume, const SliceRequest& request) {
  std::optional<Drawn>& drawn = drawn_[request.picture];
  const Drawn wanted{request, volume.version()};
  FrameTarget& picture = pictures_[request.picture];
  if (drawn == wanted && picture.size() == request.size) return;
  picture.Resize(request.size);
  if (!picture.empty()) Cast(volume, request);
  drawn = wanted;
}

void SliceDrawing::Cast(const VolumeTexture& volume, const SliceRequest& request) {
  ++casts_;
  pictures_[request.picture].Bind();
  if (volume.voxels() == 0) {
    glClearColor(kEmptySliceColor.x(), kEmptySliceColor.y(), kEmptySliceColor.z(), 1.0f);
    glClear(GL_COLOR_BUFFER_BIT);
    return;
  }
  program_.Use();
  program_.Set("empty_color", Vec3(kEmptySliceColor.cast<double>()));
  SetVolume(volume, request);
  SetColors(request.surface, volume.scale());
  program_.Draw();
}

void SliceDrawing::SetVolume(const VolumeTexture& volume, const SliceRequest& request) const {
  const SliceView view(request.axes, volume.size(), VoxelEdges(volume.X_DI()), request.size);
  const Vec3 corner_I = view.PointAt({0.0, 0.0}, request.position_voxels);
  program_.Set("lattice_size", volume.size());
  program_.Set("corner_I", corner_I);
  program_.Set("right_I", Vec3(view.PointAt({1.0, 0.0}, request.position_voxels) - corner_I));
  program_.Set("down_I", Vec3(view.PointAt({0.0, 1.0}, request.position_voxels) - corner_I));
  program_.Set("height_px", static_cast<double>(request.size.height));
  Eigen::Vector2d cross_px = {-1.0, -1.0};
  if (request.cross_I) {
    // At the centre of a pixel, so that the lines are one pixel wide.
    cross_px = view.PixelOf(*request.cross_I).array().floor() + 0.5;
  }
  program_.Set("cross_px", cross_px);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_3D, volume.voxels());
  program_.Set("voxels", 0);
}

void SliceDrawing::SetColors(const SurfaceOptions& surface, const ValueScale& scale) {
  glActiveTexture(GL_TEXTURE1);
  color_table_.Show(surface.color_map);
  program_.Set("color_table", 1);
  const double least = scale.Scaled(surface.window_min);
  program_.Set("window_min", scale.Split(surface.window_min));
  program_.Set("window_range", scale.Scaled(surface.window_max) - least);
  program_.Set("isovalues", Eigen::Vector2d(scale.Scaled(surface.isovalue) - least,
                                            scale.Scaled(surface.veil.isovalue) - least));
  program_.Set("isolines", surface.veil.shown ? 2 : 1);
  program_.Set("isoline_color", Vec3(kIsolineColor.cast<double>()));
  program_.Set("veil_color", Vec3(surface.veil.color.cast<double>()));
  glActiveTexture(GL_TEXTURE0);
}

}  // namespace palpate::view
