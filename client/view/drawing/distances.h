// Distances that the user measures between pairs of points.
//
// Frame: W (mm), so that they stay with the volume wherever it is placed. Pixels of the view.
// Threads: plain values.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate::view {

struct Distance {
  Vec3 from_W = Vec3::Zero();
  Vec3 to_W = Vec3::Zero();

  double mm() const { return (to_W - from_W).norm(); }
};

struct MeasureState {
  std::vector<Distance> distances{};
  std::optional<Vec3> begun_W{};  // the first point of the next distance

  // The first point of a distance, or its second.
  void AddPoint(const Vec3& p_W);
  // Takes away the point that was begun, or else the last distance.
  void RemoveLast();
  void Remove(std::size_t number);
  void Clear() { *this = {}; }
};

// One end of one of several distances.
struct DistanceEnd {
  std::size_t number = 0;
  Vec3 Distance::*point = &Distance::from_W;
};

// "12.3 mm"
std::string TextOf(const Distance& distance);

// Distance in pixels from a point to the line between two others.
double PixelsToLine(const Eigen::Vector2d& point_px, const Eigen::Vector2d& from_px,
                    const Eigen::Vector2d& to_px);

// Where a point of W appears in a picture; none: not in it.
using PixelOfPoint = std::function<std::optional<Eigen::Vector2d>(const Vec3& p_W)>;
// The distance whose line is nearest to a point of the picture, and at most `most_px` from it.
std::optional<std::size_t> DistanceAt(const std::vector<Distance>& distances,
                                      const Eigen::Vector2d& point_px, double most_px,
                                      const PixelOfPoint& pixel_of);
// The nearest end, at most `most_px` from the point.
std::optional<DistanceEnd> EndAt(const std::vector<Distance>& distances,
                                 const Eigen::Vector2d& point_px, double most_px,
                                 const PixelOfPoint& pixel_of);

}  // namespace palpate::view
