#include "client/view/render/frame_renderer.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "client/view/render/backdrop.h"
#include "client/view/render/brick_cache.h"
#include "client/view/render/frame_target.h"
#include "client/view/render/gl_state.h"
#include "client/view/render/overlay_drawing.h"
#include "client/view/render/slice_drawing.h"
#include "client/view/render/surface_caster.h"

namespace palpate::view {
namespace {

// The bounds of the padded lattice, where the surface ends.
Bounds BoundsOf(const BrickCache& volume) {
  if (!volume.has_volume() || !volume.X_DI()) return {};
  constexpr double kFar = std::numeric_limits<double>::infinity();
  Bounds bounds = {Vec3::Constant(kFar), Vec3::Constant(-kFar)};
  for (int corner = 0; corner < 8; ++corner) {
    Vec3 p_I = Vec3::Constant(-1.0);
    for (int axis = 0; axis < 3; ++axis) {
      if (corner >> axis & 1) p_I[axis] = volume.size()[axis];
    }
    const Vec3 p_D = volume.X_DI()->Apply(p_I);
    bounds.min_mm = bounds.min_mm.cwiseMin(p_D);
    bounds.max_mm = bounds.max_mm.cwiseMax(p_D);
  }
  return bounds;
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

struct FrameRenderer::Parts {
  explicit Parts(std::size_t budget_bytes) : volume(budget_bytes) {}

  BrickCache volume;
  SurfaceCaster caster;
  Backdrop backdrop;
  FrameTarget frame{FrameTarget::Depth::kFloat};
  OverlayDrawing overlay;
  SliceDrawing slices;
  // Set by the last Draw.
  Mat4 clip_from_D = Mat4::Identity();
  Vec3 eye_D = Vec3::Zero();
  bool surface_shown = false;
  std::uint64_t composed_casts = 0;  // of the caster, when the backdrop was composed
  std::uint64_t surface_version = 0;
  double rows_per_ms = 0.2;  // of Prepare

  void UpdateBackdrop(const FrameRequest& request);
  void Compose(const SurfaceCaster* shown, const ImageSize& size) {
    ++surface_version;
    backdrop.Compose(shown, size);
  }
};

FrameRenderer::FrameRenderer(std::size_t budget_bytes)
    : parts_(std::make_unique<Parts>(budget_bytes)) {}
FrameRenderer::~FrameRenderer() = default;

bool FrameRenderer::TakeUp(ViewVolume& volume, std::size_t most_bricks) {
  ResetState();
  return parts_->volume.TakeUp(volume, most_bricks);
}

std::uint64_t FrameRenderer::volume_version() const { return parts_->volume.version(); }

bool FrameRenderer::is_full() const { return parts_->volume.is_full(); }

void FrameRenderer::Parts::UpdateBackdrop(const FrameRequest& request) {
  const bool shown = request.surface.shown && volume.has_volume() && volume.X_DI();
  const bool cast =
      shown && caster.Cast(volume, {request.size, eye_D, clip_from_D, request.surface});
  if (!shown) volume.Forget(BrickCache::kSurface);
  const bool is_composed = shown == surface_shown && composed_casts == caster.casts() &&
                           backdrop.target().size() == request.size;
  if (!cast && is_composed) return;
  surface_shown = shown;
  composed_casts = caster.casts();
  Compose(shown ? &caster : nullptr, request.size);
}

void FrameRenderer::Draw(const FrameRequest& request) {
  Parts& parts = *parts_;
  ResetState();
  const bool resized = parts.frame.Resize(request.size);
  if (parts.frame.empty()) {
    if (resized) parts.Compose(nullptr, request.size);
    parts.surface_shown = false;
    return;
  }
  parts.clip_from_D = request.camera.ClipFromD(request.size, BoundsOf(parts.volume));
  parts.eye_D = request.camera.Eye();
  parts.UpdateBackdrop(request);
  parts.frame.CopyFrom(parts.backdrop.target());
  if (!request.overlay) return;
  parts.frame.Bind();
  OverlayView view = {request.size, parts.clip_from_D, parts.eye_D};
  if (parts.surface_shown && request.surface.veil.shown) {
    view.veil_color = parts.caster.veil_color();
    view.veil_depth = parts.caster.veil_depth();
  }
  parts.overlay.Draw(*request.overlay, view);
}

bool FrameRenderer::Prepare(const FrameRequest& request, std::chrono::milliseconds time) {
  Parts& parts = *parts_;
  if (!request.surface.shown || !parts.volume.has_volume() || !parts.volume.X_DI()) return true;
  using Clock = std::chrono::steady_clock;
  // Long enough that its fixed costs are small.
  constexpr double kPart_ms = 30.0;
  ResetState();
  const CastRequest cast = {request.size, request.camera.Eye(),
                            request.camera.ClipFromD(request.size, BoundsOf(parts.volume)),
                            request.surface};
  const auto end = Clock::now() + time;
  for (auto begin = Clock::now(); begin < end; begin = Clock::now()) {
    const int rows = std::clamp(static_cast<int>(kPart_ms * parts.rows_per_ms), 1,
                                std::max(1, request.size.height));
    const auto progress = parts.caster.CastRows(parts.volume, cast, rows);
    if (progress != SurfaceCaster::Progress::kMore) {
      return progress == SurfaceCaster::Progress::kWhole;
    }
    glFinish();
    const double ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
    // Rows differ: a few that are cheap say little of the next ones.
    parts.rows_per_ms = std::min(2.0 * parts.rows_per_ms, rows / std::max(ms, 0.01));
  }
  return false;
}

unsigned FrameRenderer::DrawnTexture() const { return parts_->frame.color(); }

Image FrameRenderer::ReadBack() const { return {parts_->frame.size(), parts_->frame.ReadColors()}; }

std::uint64_t FrameRenderer::surface_version() const { return parts_->surface_version; }

std::uint64_t FrameRenderer::casts() const { return parts_->caster.casts(); }

std::optional<Vec3> FrameRenderer::SurfaceAt(int x_px, int y_px) const {
  const ImageSize& size = parts_->frame.size();
  if (x_px < 0 || y_px < 0 || x_px >= size.width || y_px >= size.height) return std::nullopt;
  const int from_bottom_px = size.height - 1 - y_px;
  const float depth = parts_->backdrop.ReadDepth(x_px, from_bottom_px);
  if (depth >= 1.0f) return std::nullopt;
  return Unprojected(parts_->clip_from_D.inverse(), size, x_px, from_bottom_px, depth);
}

std::vector<float> FrameRenderer::SurfaceDistances() const {
  const ImageSize& size = parts_->frame.size();
  const std::vector<float> depths = parts_->backdrop.ReadDepths();
  std::vector<float> distances;
  distances.reserve(depths.size());
  const Mat4 D_from_clip = parts_->clip_from_D.inverse();
  for (int y = size.height - 1; y >= 0 && !depths.empty(); --y) {
    for (int x = 0; x < size.width; ++x) {
      const float depth = depths[static_cast<std::size_t>(y) * size.width + x];
      const Vec3 p_D = Unprojected(D_from_clip, size, x, y, depth);
      distances.push_back(depth < 1.0f ? static_cast<float>((p_D - parts_->eye_D).norm())
                                       : std::numeric_limits<float>::infinity());
    }
  }
  return distances;
}

unsigned FrameRenderer::DrawSlice(const SliceRequest& request) {
  ResetState();
  parts_->slices.Draw(parts_->volume, request);
  return parts_->slices.picture(request.picture).color();
}

void FrameRenderer::ForgetSlices() {
  for (int picture = 0; picture < BrickCache::kSurface; ++picture) parts_->volume.Forget(picture);
}

std::uint64_t FrameRenderer::slice_casts() const { return parts_->slices.casts(); }

Image FrameRenderer::ReadSlice(int picture) const {
  const FrameTarget& target = parts_->slices.picture(picture);
  return {target.size(), target.ReadColors()};
}

}  // namespace palpate::view
