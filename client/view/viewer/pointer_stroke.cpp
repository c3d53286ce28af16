#include "client/view/viewer/pointer_stroke.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate::view {
namespace {

constexpr double kStep_px = 2.0;
// If the depth changes this many times more than next to it, there is an edge and not a slope.
constexpr double kSteepest = 4.0;

}  // namespace

std::optional<Vec3> SeenSurface::At(const Eigen::Vector2d& point_px, const ImageSize& view) const {
  const int x = static_cast<int>(std::floor(point_px.x() * size.width / view.width));
  const int y = static_cast<int>(std::floor(point_px.y() * size.height / view.height));
  if (x < 0 || y < 0 || x >= size.width || y >= size.height) return std::nullopt;
  const std::size_t n = static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width) +
                        static_cast<std::size_t>(x);
  if (n >= distances_mm.size() || !std::isfinite(distances_mm[n])) return std::nullopt;
  const Ray ray = camera.RayThrough(x + 0.5, y + 0.5, size);
  return Vec3(ray.origin + static_cast<double>(distances_mm[n]) * ray.direction);
}

bool PointerStroke::Begin(SeenSurface surface, const Eigen::Vector2d& at_px, const ImageSize& view,
                          double jump_mm, const Sink& sink) {
  const std::optional<Vec3> p_D = surface.At(at_px, view);
  if (!p_D) return false;
  has_pointer_ = true;
  surface_ = std::move(surface);
  jump_mm_ = jump_mm;
  at_px_ = at_px;
  since_step_px_ = 0.0;
  last_D_ = p_D;
  sink.draw(*p_D);
  return true;
}

void PointerStroke::MoveTo(const Eigen::Vector2d& at_px, const ImageSize& view, const Sink& sink) {
  if (!surface_) return;
  const Eigen::Vector2d from_px = std::exchange(at_px_, at_px);
  const double way_px = (at_px - from_px).norm();
  double next_px = kStep_px - since_step_px_;
  for (; next_px <= way_px; next_px += kStep_px) {
    Draw(from_px + (at_px - from_px) * (next_px / way_px), view, sink);
  }
  since_step_px_ = way_px - (next_px - kStep_px);
}

void PointerStroke::Draw(const Eigen::Vector2d& at_px, const ImageSize& view, const Sink& sink) {
  const std::optional<Vec3> p_D = surface_->At(at_px, view);
  if (!p_D) {
    if (last_D_) sink.lift();
    last_D_.reset();
    return;
  }
  if (last_D_) {
    const Vec3 eye_D = surface_->camera.Eye();
    const double last_mm = (*last_D_ - eye_D).norm();
    const double farther_mm = std::abs((*p_D - eye_D).norm() - last_mm);
    const double beside_mm = (*last_D_ - eye_D - last_mm * (*p_D - eye_D).normalized()).norm();
    if (farther_mm > std::max(jump_mm_, kSteepest * beside_mm)) sink.lift();
  }
  last_D_ = p_D;
  sink.draw(*p_D);
}

void PointerStroke::Release() {
  has_pointer_ = false;
  surface_.reset();
  last_D_.reset();
}

}  // namespace palpate::view
