#include "client/view/drawing/lines.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate::view {
namespace {

constexpr Rgba8 kDark = {24, 28, 36, 0};
constexpr Rgba8 kLight = {236, 240, 246, 0};
constexpr double kMostDashes = 400.0;
constexpr Rgba8 kLetterColor = {235, 238, 245, 255};

// Corners of strokes, as digits x and y, on a grid of 4 by 6 from the lower left corner.
constexpr std::pair<char, std::string_view> kStrokes[] = {
    {'L', "06 00 40"},
    {'R', "00 06 36 45 44 33 03/23 40"},
    {'A', "00 26 40/12 32"},
    {'P', "00 06 36 45 44 33 03"},
    {'S', "45 36 16 05 04 13 33 42 41 30 10 01"},
    {'I', "20 26/10 30/16 36"}};

int DashesIn(double length_mm, double dash_mm) {
  return static_cast<int>(std::ceil(std::clamp(length_mm / dash_mm, 1.0, kMostDashes)));
}

double RadiusAt(double along_mm, const Ring& low, const Ring& high) {
  const double span_mm = high.along_mm - low.along_mm;
  const double share = span_mm > 0.0 ? (along_mm - low.along_mm) / span_mm : 0.0;
  return low.radius_mm + std::clamp(share, 0.0, 1.0) * (high.radius_mm - low.radius_mm);
}

void AddLetter(std::string_view strokes, const Vec3& center_D, const Vec3& right_D,
               const Vec3& up_D, Overlay& overlay) {
  const auto corner = [&](std::size_t at) -> Vec3 {
    const double x = (strokes[at] - '0' - 2) / 6.0;
    const double y = (strokes[at + 1] - '0' - 3) / 6.0;
    return center_D + x * right_D + y * up_D;
  };
  for (std::size_t at = 3; at < strokes.size(); at += 3) {
    if (strokes[at - 1] != '/') AddLine(corner(at - 3), corner(at), kLetterColor, 0, overlay);
  }
}

}  // namespace

void AddLine(const Vec3& from_D, const Vec3& to_D, const Rgba8& rgba, std::uint8_t alpha_behind,
             Overlay& overlay) {
  overlay.lines.push_back({from_D.cast<float>(), rgba, alpha_behind});
  overlay.lines.push_back({to_D.cast<float>(), rgba, alpha_behind});
}

void AddOutline(std::span<const Vec3> corners_D, const Rgba8& rgba, std::uint8_t alpha_behind,
                Overlay& overlay) {
  for (std::size_t n = 0; n < corners_D.size(); ++n) {
    AddLine(corners_D[n], corners_D[(n + 1) % corners_D.size()], rgba, alpha_behind, overlay);
  }
}

void AddBox(const AffineMap& X_DI, const Vec3& min_I, const Vec3& max_I, const Rgba8& rgba,
            std::uint8_t alpha_behind, Overlay& overlay) {
  for (int axis = 0; axis < 3; ++axis) {
    for (int corner = 0; corner < 4; ++corner) {
      Vec3 from_I = min_I;
      if (corner & 1) from_I[(axis + 1) % 3] = max_I[(axis + 1) % 3];
      if (corner & 2) from_I[(axis + 2) % 3] = max_I[(axis + 2) % 3];
      Vec3 to_I = from_I;
      to_I[axis] = max_I[axis];
      AddLine(X_DI.Apply(from_I), X_DI.Apply(to_I), rgba, alpha_behind, overlay);
    }
  }
}

void AddGhostOutline(std::span<const Vec3> corners_D, Rgba8 rgba, Overlay& overlay) {
  rgba[3] = 0;
  AddOutline(corners_D, rgba, kGhostLine, overlay);
}

void AddGhostDashes(const Vec3& from_D, const Vec3& to_D, double dash_mm, Rgba8 rgba,
                    Overlay& overlay) {
  rgba[3] = 0;
  const Vec3 way = to_D - from_D;
  const int steps = DashesIn(way.norm(), dash_mm);
  for (int n = 0; n < steps; n += 2) {
    AddLine(from_D + way * n / steps, from_D + way * (n + 1) / steps, rgba, kGhostLine, overlay);
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
      AddLine(last_D, next_D, step % 2 == 1 ? kDark : kLight, kGhostLine, overlay);
      last_D = next_D;
    }
  }
}

void AddLetters(std::string_view letters, const Vec3& center_D, const Vec3& right_D,
                const Vec3& up_D, Overlay& overlay) {
  constexpr double kApart = 0.9;  // of the height
  double aside = -0.5 * kApart * static_cast<double>(letters.size() - 1);
  for (const char letter : letters) {
    for (const auto& [name, strokes] : kStrokes) {
      if (name == letter) AddLetter(strokes, center_D + aside * right_D, right_D, up_D, overlay);
    }
    aside += kApart;
  }
}

}  // namespace palpate::view
