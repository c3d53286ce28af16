#include "client/view/render/frame_renderer.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <limits>

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

// Of the padded lattice, where the surface ends.
Bounds LatticeBounds(const BrickCache& volume) {
  if (!volume.has_volume() || !volume.X_DI()) return {};
  return BoundsOf(*volume.X_DI(), Vec3::Constant(-1.0), volume.size().cast<double>());
}

// The centre of a pixel at a depth from 0 to 1.
Vec3 Unprojected(const Mat4& D_from_clip, const ImageSize& size, int x_px, int y_from_bottom_px,
                 float depth) {
  const Eigen::Vector4d clip = {2.0 * (x_px + 0.5) / size.width - 1.0,
                                2.0 * (y_from_bottom_px + 0.5) / size.height - 1.0,
                                2.0 * static_cast<double>(depth) - 1.0, 1.0};
  return (D_from_clip * clip).hnormalized();
}

}  // namespace

FrameRenderer::FrameRenderer(std::size_t budget_bytes)
    : volume_(budget_bytes), backdrop_program_(kBackdropShader) {}

bool FrameRenderer::TakeUp(ViewVolume& volume, std::size_t most_bricks) {
  ResetState();
  return volume_.TakeUp(volume, most_bricks);
}

void FrameRenderer::UpdateBackdrop(const FrameRequest& request) {
  const bool shown = request.surface.shown && volume_.has_volume() && volume_.X_DI();
  const bool cast =
      shown && caster_.Cast(volume_, {request.size, eye_D_, clip_from_D_, request.surface});
  if (!shown) volume_.Forget(BrickCache::kSurface);
  const bool is_composed = shown == surface_shown_ && composed_casts_ == caster_.casts() &&
                           backdrop_.size() == request.size;
  if (!cast && is_composed) return;
  surface_shown_ = shown;
  composed_casts_ = caster_.casts();
  ComposeBackdrop(shown, request.size);
}

// The surface must have been cast at this size.
void FrameRenderer::ComposeBackdrop(bool with_surface, const ImageSize& size) {
  ++surface_version_;
  backdrop_.Resize(size);
  if (backdrop_.empty()) return;
  backdrop_.Bind();
  ResetState();
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_ALWAYS);
  BindTexture(2, GL_TEXTURE_2D, with_surface ? caster_.veil_color() : 0);
  BindTexture(1, GL_TEXTURE_2D, with_surface ? caster_.depth() : 0);
  BindTexture(0, GL_TEXTURE_2D, with_surface ? caster_.color() : 0);
  backdrop_program_.Use();
  backdrop_program_.Set("surface_color", 0);
  backdrop_program_.Set("surface_depth", 1);
  backdrop_program_.Set("veil_color", 2);
  backdrop_program_.Set("has_surface", with_surface ? 1 : 0);
  backdrop_program_.Set("height_px", static_cast<double>(size.height));
  backdrop_program_.Draw();
}

void FrameRenderer::Draw(const FrameRequest& request) {
  ResetState();
  const bool resized = frame_.Resize(request.size);
  if (frame_.empty()) {
    if (resized) ComposeBackdrop(false, request.size);
    surface_shown_ = false;
    return;
  }
  clip_from_D_ = request.camera.ClipFromD(request.size, LatticeBounds(volume_));
  eye_D_ = request.camera.Eye();
  UpdateBackdrop(request);
  frame_.CopyFrom(backdrop_);
  if (!request.overlay) return;
  frame_.Bind();
  OverlayView view = {request.size, clip_from_D_, eye_D_};
  if (surface_shown_ && (request.surface.veil.shown || request.surface.layers.size() > 1)) {
    view.veil_color = caster_.veil_color();
    view.veil_depth = caster_.veil_depth();
  }
  overlay_.Draw(*request.overlay, view);
}

bool FrameRenderer::Prepare(const FrameRequest& request, std::chrono::milliseconds time) {
  if (!request.surface.shown || !volume_.has_volume() || !volume_.X_DI()) return true;
  using Clock = std::chrono::steady_clock;
  // Long enough that its fixed costs are small.
  constexpr double kPart_ms = 30.0;
  ResetState();
  const CastRequest cast = {request.size, request.camera.Eye(),
                            request.camera.ClipFromD(request.size, LatticeBounds(volume_)),
                            request.surface};
  const auto end = Clock::now() + time;
  for (auto begin = Clock::now(); begin < end; begin = Clock::now()) {
    const int rows =
        std::clamp(static_cast<int>(kPart_ms * rows_per_ms_), 1, std::max(1, request.size.height));
    const auto progress = caster_.CastRows(volume_, cast, rows);
    if (progress != SurfaceCaster::Progress::kMore) {
      return progress == SurfaceCaster::Progress::kWhole;
    }
    glFinish();
    const double ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
    // Rows differ: a few that are cheap say little of the next ones.
    rows_per_ms_ = std::min(2.0 * rows_per_ms_, rows / std::max(ms, 0.01));
  }
  return false;
}

std::optional<Vec3> FrameRenderer::SurfaceAt(int x_px, int y_px) const {
  const ImageSize& size = frame_.size();
  if (x_px < 0 || y_px < 0 || x_px >= size.width || y_px >= size.height) return std::nullopt;
  const int from_bottom_px = size.height - 1 - y_px;
  const float depth = backdrop_.ReadDepth(x_px, from_bottom_px);
  if (depth >= 1.0f) return std::nullopt;
  return Unprojected(clip_from_D_.inverse(), size, x_px, from_bottom_px, depth);
}

std::vector<float> FrameRenderer::SurfaceDistances() const {
  const ImageSize& size = frame_.size();
  const std::vector<float> depths = backdrop_.ReadDepths();
  std::vector<float> distances;
  distances.reserve(depths.size());
  const Mat4 D_from_clip = clip_from_D_.inverse();
  for (int y = size.height - 1; y >= 0 && !depths.empty(); --y) {
    for (int x = 0; x < size.width; ++x) {
      const float depth = depths[static_cast<std::size_t>(y) * size.width + x];
      const Vec3 p_D = Unprojected(D_from_clip, size, x, y, depth);
      distances.push_back(depth < 1.0f ? static_cast<float>((p_D - eye_D_).norm())
                                       : std::numeric_limits<float>::infinity());
    }
  }
  return distances;
}

unsigned FrameRenderer::DrawSlice(const SliceRequest& request) {
  ResetState();
  slices_.Draw(volume_, request);
  return slices_.picture(request.picture).color();
}

void FrameRenderer::ForgetSlices() {
  for (int picture = 0; picture < BrickCache::kSurface; ++picture) volume_.Forget(picture);
}

Image FrameRenderer::ReadSlice(int picture) const {
  const FrameTarget& target = slices_.picture(picture);
  return {target.size(), target.ReadColors()};
}

}  // namespace palpate::view
