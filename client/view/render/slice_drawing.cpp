#include "client/view/render/slice_drawing.h"

#include <epoxy/gl.h>

#include <string>
#include <vector>

#include "client/shading/shading.h"
#include "client/view/drawing/slice_view.h"

namespace palpate::view {
namespace {

// Eight layers, and the user's veil.
constexpr int kMostIsolines = 9;

// The distance to an isoline is the difference of value and isovalue, divided by the gradient per
// pixel. Beside a steep slope, this may promise a crossing where there is none, so the value there
// is looked at, too. A dark rim makes the line visible on any colour map.
constexpr char kSliceShader[] = R"(
uniform sampler2D color_map;
uniform vec3 corner_I;     // at the picture's upper left corner
uniform vec3 right_I;      // for a pixel to the right
uniform vec3 down_I;       // for a pixel down
uniform float height_px;
uniform vec2 window_min;   // value of the colour map's first colour, split
uniform float window_range;
uniform float isovalues[MOST_ISOLINES];  // above window_min; the last ones are drawn over others
uniform vec3 isoline_colors[MOST_ISOLINES];
uniform int isolines;  // how many there are
uniform vec3 empty_color;
uniform vec2 cross_px;     // pixels from the upper left corner; negative: none
out vec4 color;

// The value relative to window_min, so that small differences of large values keep their digits, and
// its gradient along the axes of I.
vec4 ValueAndGradient(vec3 p) {
  Cell cell = CellOf(p + 1.0);
  return vec4(TrilinearGradient(cell, window_min), Above(cell.corners, window_min, cell.u));
}

vec3 WithIsoline(vec3 seen, vec3 p, vec2 slope, float difference, float isovalue,
                 vec3 line_color) {
  float slope_per_px = length(slope);
  if (slope_per_px <= 0.0) return seen;
  float distance_px = abs(difference) / slope_per_px;
  if (distance_px > 2.5) return seen;
  // A little beyond the crossing.
  vec2 way_px = -sign(difference) * (1.25 * distance_px + 0.25) * slope / slope_per_px;
  float beyond = ValueAndGradient(p + way_px.x * right_I + way_px.y * down_I).w - isovalue;
  if (beyond * difference > 0.0) return seen;
  seen = mix(seen, vec3(0.0), 0.55 * clamp(2.5 - distance_px, 0.0, 1.0));
  return mix(seen, line_color, clamp(1.5 - distance_px, 0.0, 1.0));
}

void main() {
  vec2 at_px = vec2(gl_FragCoord.x, height_px - gl_FragCoord.y);
  vec3 p = corner_I + at_px.x * right_I + at_px.y * down_I;
  vec3 seen = empty_color;
  if (all(greaterThanEqual(p, vec3(-1.0))) && all(lessThanEqual(p, vec3(cells - 1)))) {
    vec4 found = ValueAndGradient(p);
    seen = ColorAt(color_map, ShareOf(found.w, window_range));
    vec2 slope = vec2(dot(found.xyz, right_I), dot(found.xyz, down_I));
    for (int n = 0; n < isolines; ++n) {
      seen = WithIsoline(seen, p, slope, found.w - isovalues[n], isovalues[n], isoline_colors[n]);
    }
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

void SetPlace(const ShaderProgram& program, const BrickCache& volume, const SliceRequest& request) {
  const SliceView view(request.axes, volume.size(), VoxelEdges(volume.X_DI()), request.size,
                       request.zoom);
  const Vec3 corner_I = view.PointAt({0.0, 0.0}, request.position_voxels);
  program.Set("corner_I", corner_I);
  program.Set("right_I", view.PointAt({1.0, 0.0}, request.position_voxels) - corner_I);
  program.Set("down_I", view.PointAt({0.0, 1.0}, request.position_voxels) - corner_I);
  program.Set("height_px", static_cast<double>(request.size.height));
  Eigen::Vector2d cross_px = {-1.0, -1.0};
  if (request.cross_I) {
    // At the centre of a pixel, so that the lines are one pixel wide.
    cross_px = view.PixelOf(*request.cross_I).array().floor() + 0.5;
  }
  program.Set("cross_px", cross_px);
}

void SetColors(const ShaderProgram& program, const SurfaceOptions& surface,
               const ValueScale& scale) {
  const double least = scale.Scaled(surface.window_min);
  program.Set("window_min", scale.Split(surface.window_min));
  program.Set("window_range", scale.Scaled(surface.window_max) - least);
  std::vector<LayerVeil> lines;
  if (surface.veil.shown) lines.push_back({surface.veil.isovalue, surface.veil.color});
  lines.insert(lines.end(), surface.layers.begin(), surface.layers.end());
  if (surface.layers.empty()) lines.push_back({surface.isovalue, kIsolineColor});
  for (std::size_t n = 0; n < lines.size(); ++n) {
    const std::string at = "[" + std::to_string(n) + "]";
    program.Set(("isovalues" + at).c_str(), scale.Scaled(lines[n].isovalue) - least);
    program.Set(("isoline_colors" + at).c_str(), lines[n].color);
  }
  program.Set("isolines", static_cast<int>(lines.size()));
}

}  // namespace

SliceDrawing::SliceDrawing()
    : programs_("#define MOST_ISOLINES " + std::to_string(kMostIsolines) + "\n" +
                std::string(shading::kColors) + kSliceShader) {}

void SliceDrawing::Draw(BrickCache& volume, const SliceRequest& request) {
  Picture& picture = pictures_[static_cast<std::size_t>(request.picture)];
  const bool same_view = picture.request == request;
  const bool is_drawn = same_view && picture.content_version == volume.content_version() &&
                        picture.target.size() == request.size;
  if (is_drawn && (picture.missing == 0 || picture.version == volume.version())) return;
  picture.target.Resize(request.size);
  picture.missing = 0;
  picture.version = volume.version();
  if (!picture.target.empty()) {
    if (!is_drawn) ++casts_;
    volume.BeginPicture();
    Cast(volume, request, picture.target);
    picture.missing = volume.EndPicture(
        request.picture, same_view ? BrickCache::Marks::kAgain : BrickCache::Marks::kNewView, {});
  }
  picture.request = request;
  picture.content_version = volume.content_version();
}

void SliceDrawing::Cast(const BrickCache& volume, const SliceRequest& request,
                        const FrameTarget& target) {
  target.Bind();
  if (!volume.has_volume()) {
    glClearColor(kEmptySliceColor.x(), kEmptySliceColor.y(), kEmptySliceColor.z(), 1.0f);
    glClear(GL_COLOR_BUFFER_BIT);
    return;
  }
  const ShaderProgram& program = programs_.Use(volume, request.surface.color_map);
  program.Set("empty_color", kEmptySliceColor);
  SetPlace(program, volume, request);
  SetColors(program, request.surface, volume.scale());
  program.Draw();
}

}  // namespace palpate::view
