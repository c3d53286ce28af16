#include "client/view/scene/ghosts.h"

#include <algorithm>
#include <cmath>

namespace palpate::view {
namespace {

constexpr std::array<std::uint8_t, 4> kDark = {24, 28, 36, 0};
constexpr std::array<std::uint8_t, 4> kLight = {236, 240, 246, 0};
constexpr double kMostDashes = 400.0;

void AddGhostLine(const Vec3& from_D, const Vec3& to_D, std::array<std::uint8_t, 4> rgba,
                  Overlay& overlay) {
  rgba[3] = 0;
  overlay.lines.push_back({from_D.cast<float>(), rgba, kGhostLine});
  overlay.lines.push_back({to_D.cast<float>(), rgba, kGhostLine});
}

int DashesIn(double length_mm, double dash_mm) {
  return static_cast<int>(std::ceil(std::clamp(length_mm / dash_mm, 1.0, kMostDashes)));
}

double RadiusAt(double along_mm, const Ring& low, const Ring& high) {
  const double span_mm = high.along_mm - low.along_mm;
  const double share = span_mm > 0.0 ? (along_mm - low.along_mm) / span_mm : 0.0;
  return low.radius_mm + std::clamp(share, 0.0, 1.0) * (high.radius_mm - low.radius_mm);
}

}  // namespace

void AddGhostOutline(std::span<const Vec3> corners_D, const std::array<std::uint8_t, 4>& rgba,
                     Overlay& overlay) {
  for (std::size_t n = 0; n < corners_D.size(); ++n) {
    AddGhostLine(corners_D[n], corners_D[(n + 1) % corners_D.size()], rgba, overlay);
  }
}

void AddGhostDashes(const Vec3& from_D, const Vec3& to_D, double dash_mm,
                    const std::array<std::uint8_t, 4>& rgba, Overlay& overlay) {
  const int steps = DashesIn((to_D - from_D).norm(), dash_mm);
  for (int n = 0; n < steps; n += 2) {
    AddGhostLine(from_D + (to_D - from_D) * n / steps, from_D + (to_D - from_D) * (n + 1) / steps,
                 rgba, overlay);
  }
}

void AddGhostEdges(const Vec3& origin_D, const Vec3& axis, std::span<const Ring> rings,
                   const Vec3& eye_D, double dash_mm, Overlay& overlay) {
  const Vec3 across = axis.cross(eye_D - origin_D);
  if (rings.empty() || across.norm() < 1e-6) return;
  const Vec3 aside = across.normalized();
  const double begin_mm = rings.front().along_mm;
  const double length_mm = rings.back().along_mm - begin_mm;
  const int steps = DashesIn(length_mm, dash_mm);
  std::size_t part = 0;
  const auto edge = [&](int step, double side) -> Vec3 {
    const double along_mm = begin_mm + length_mm * step / steps;
    while (part + 2 < rings.size() && rings[part + 1].along_mm < along_mm) ++part;
    const double radius_mm = RadiusAt(along_mm, rings[part], rings[part + 1]);
    return origin_D + along_mm * axis + side * radius_mm * aside;
  };
  for (const double side : {-1.0, 1.0}) {
    part = 0;
    Vec3 last_D = edge(0, side);
    for (int step = 1; step <= steps; ++step) {
      const Vec3 next_D = edge(step, side);
      AddGhostLine(last_D, next_D, step % 2 == 1 ? kDark : kLight, overlay);
      last_D = next_D;
    }
  }
}

}  // namespace palpate::view
