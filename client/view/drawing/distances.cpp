#include "client/view/drawing/distances.h"

#include <fmt/core.h>

#include <algorithm>

namespace palpate::view {

void MeasureState::AddPoint(const Vec3& p_W) {
  if (begun_W) {
    distances.push_back({*begun_W, p_W});
    begun_W.reset();
  } else {
    begun_W = p_W;
  }
}

void MeasureState::RemoveLast() {
  if (begun_W) {
    begun_W.reset();
  } else if (!distances.empty()) {
    distances.pop_back();
  }
}

void MeasureState::Remove(std::size_t number) {
  if (number < distances.size()) {
    distances.erase(distances.begin() + static_cast<std::ptrdiff_t>(number));
  }
}

std::string TextOf(const Distance& distance) {
  const double mm = distance.mm();
  return fmt::format("{:.{}f} mm", mm, mm < 1.0 ? 3 : mm < 10.0 ? 2 : 1);
}

double PixelsToLine(const Eigen::Vector2d& point_px, const Eigen::Vector2d& from_px,
                    const Eigen::Vector2d& to_px) {
  const Eigen::Vector2d line = to_px - from_px;
  const double squared = line.squaredNorm();
  const double share =
      squared > 0.0 ? std::clamp((point_px - from_px).dot(line) / squared, 0.0, 1.0) : 0.0;
  return (point_px - from_px - share * line).norm();
}

std::optional<std::size_t> DistanceAt(const std::vector<Distance>& distances,
                                      const Eigen::Vector2d& point_px, double most_px,
                                      const PixelOfPoint& pixel_of) {
  std::optional<std::size_t> nearest;
  for (std::size_t n = 0; n < distances.size(); ++n) {
    const auto from_px = pixel_of(distances[n].from_W);
    const auto to_px = pixel_of(distances[n].to_W);
    if (!from_px || !to_px) continue;
    const double away_px = PixelsToLine(point_px, *from_px, *to_px);
    if (away_px > most_px) continue;
    most_px = away_px;
    nearest = n;
  }
  return nearest;
}

std::optional<DistanceEnd> EndAt(const std::vector<Distance>& distances,
                                 const Eigen::Vector2d& point_px, double most_px,
                                 const PixelOfPoint& pixel_of) {
  std::optional<DistanceEnd> nearest;
  for (std::size_t n = 0; n < distances.size(); ++n) {
    for (const auto point : {&Distance::from_W, &Distance::to_W}) {
      const auto at_px = pixel_of(distances[n].*point);
      if (!at_px || (point_px - *at_px).norm() > most_px) continue;
      most_px = (point_px - *at_px).norm();
      nearest = DistanceEnd{n, point};
    }
  }
  return nearest;
}

}  // namespace palpate::view
