#include "server/simulated_hand/touch_strokes.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double kPressN = 0.6;
constexpr double kLeastDepthMm = 0.25;
constexpr double kMostDepthMm = 1.5;

constexpr double kStepVoxels = 0.7;
constexpr double kLeastStepMm = 0.1;
constexpr double kMostStepMm = 0.6;
constexpr double kMostHalfMm = 25.0;  // of a stroke
constexpr std::size_t kMostHalfPoints = 80;
constexpr double kSharpestTurn = 0.75;  // cosine between the normals of a step
constexpr int kDirections = 3;          // in which a stroke is tried, each both ways

constexpr double kSlideMmPerS = 60.0;
constexpr double kCarefulMmPerS = 25.0;  // on what is thin
constexpr double kThinMm = 0.4;          // depth
constexpr double kSlideMmPerS2 = 800.0;  // across the way, in a bend
constexpr double kCarefulMmPerS2 = 150.0;
constexpr double kSlowestMmPerS = 8.0;

constexpr double kShortStrokeMm = 3.0;
constexpr double kShortStrokeS = 1.4;
constexpr double kLongStrokeS = 2.5;

using Line = std::vector<SurfacePoint>;

class Tracer {
 public:
  Tracer(SurfaceProbe& probe, const DeviceDescription& device)
      : probe_(probe),
        device_(device),
        step_mm_(std::clamp(kStepVoxels * probe.surface().voxel_mm, kLeastStepMm, kMostStepMm)) {}

  std::size_t most_points() const {
    return std::min(kMostHalfPoints, static_cast<std::size_t>(kMostHalfMm / step_mm_));
  }

  // From the start on; without the start.
  Line Trace(const SurfacePoint& start, Vec3 heading) {
    Line line;
    SurfacePoint here = start;
    while (line.size() < most_points()) {
      SurfacePoint next{here.p_D_mm + step_mm_ * heading, {}};
      if (!probe_.Project(next.p_D_mm, here.normal_D, step_mm_)) break;
      next.normal_D = probe_.NormalAt(next.p_D_mm);
      const Vec3 way = next.p_D_mm - here.p_D_mm;
      const Vec3 across = way - next.normal_D * way.dot(next.normal_D);
      if (next.normal_D.dot(here.normal_D) < kSharpestTurn || across.norm() < 0.3 * step_mm_ ||
          !IsWithinReach(device_, next.p_D_mm) || !IsOpen(next)) {
        break;
      }
      heading = across.normalized();
      line.push_back(next);
      here = next;
    }
    return line;
  }

 private:
  // There is room for the hand above the point.
  bool IsOpen(const SurfacePoint& point) {
    const double voxel_mm = probe_.surface().voxel_mm;
    return !probe_.IsMaterial(point.p_D_mm + 0.75 * voxel_mm * point.normal_D) &&
           !probe_.IsMaterial(point.p_D_mm + 1.5 * voxel_mm * point.normal_D);
  }

  SurfaceProbe& probe_;
  const DeviceDescription& device_;
  double step_mm_;
};

Line LongestLine(Tracer& tracer, const SurfacePoint& start) {
  const Vec3 ahead = start.normal_D.unitOrthogonal();
  Line longest;
  for (int n = 0; n < kDirections; ++n) {
    const double angle_rad = n * 3.14159265358979 / kDirections;
    const Vec3 heading = Eigen::AngleAxisd(angle_rad, start.normal_D) * ahead;
    Line line = tracer.Trace(start, -heading);
    std::reverse(line.begin(), line.end());
    line.push_back(start);
    const Line rest = tracer.Trace(start, heading);
    line.insert(line.end(), rest.begin(), rest.end());
    if (line.size() > longest.size()) longest = std::move(line);
    if (longest.size() > 2 * tracer.most_points()) break;
  }
  return longest;
}

// How far material reaches from a point in it, up to `most_mm`.
double ReachMm(SurfaceProbe& probe, const Vec3& p_D_mm, const Vec3& way_D, double most_mm) {
  constexpr double kMostSteps = 40.0;
  const double step_mm =
      std::clamp(0.5 * probe.surface().voxel_mm, most_mm / kMostSteps, 0.5 * most_mm);
  double inside_mm = 0.0, outside_mm = step_mm;
  while (inside_mm < most_mm && probe.IsMaterial(p_D_mm + outside_mm * way_D)) {
    inside_mm = outside_mm;
    outside_mm += step_mm;
  }
  if (inside_mm >= most_mm) return most_mm;
  constexpr int kBisections = 3;
  for (int n = 0; n < kBisections; ++n) {
    const double middle_mm = 0.5 * (inside_mm + outside_mm);
    (probe.IsMaterial(p_D_mm + middle_mm * way_D) ? inside_mm : outside_mm) = middle_mm;
  }
  return inside_mm;
}

// Where the hand is to be below the point: in the middle of what is thinner than twice the depth,
// across it, too.
Vec3 HandPoint(SurfaceProbe& probe, const SurfacePoint& point, double depth_mm) {
  const double below_mm = ReachMm(probe, point.p_D_mm, -point.normal_D, 2.0 * depth_mm);
  if (below_mm >= 2.0 * depth_mm) return point.p_D_mm - depth_mm * point.normal_D;
  Vec3 hand_mm = point.p_D_mm - 0.5 * below_mm * point.normal_D;
  const Vec3 u = point.normal_D.unitOrthogonal(), v = point.normal_D.cross(u);
  const double across_mm = std::min(depth_mm, 2.0 * probe.surface().longest_voxel_mm);
  for (const Vec3& way : {u, v}) {
    const double ahead_mm = ReachMm(probe, hand_mm, way, across_mm);
    const double behind_mm = ReachMm(probe, hand_mm, -way, across_mm);
    hand_mm += 0.5 * (ahead_mm - behind_mm) * way;
  }
  const double up_mm = ReachMm(probe, hand_mm, point.normal_D, depth_mm);
  const double down_mm = ReachMm(probe, hand_mm, -point.normal_D, depth_mm);
  return hand_mm + 0.5 * (up_mm - down_mm) * point.normal_D;
}

// The hand's points without the jumps of the depth; where that would leave the material, as
// they are.
void Smooth(SurfaceProbe& probe, std::vector<TouchPoint>& points) {
  std::vector<Vec3> raw;
  for (const TouchPoint& point : points) raw.push_back(point.p_DHand_mm);
  for (std::size_t n = 2; n + 2 < points.size(); ++n) {
    const Vec3 mean =
        (raw[n - 2] + 2.0 * raw[n - 1] + 3.0 * raw[n] + 2.0 * raw[n + 1] + raw[n + 2]) / 9.0;
    if (probe.IsMaterial(mean)) points[n].p_DHand_mm = mean;
  }
}

// Slower on thin things and in bends.
void SetSpeeds(std::vector<TouchPoint>& points) {
  constexpr std::size_t kAround = 3;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const bool is_thin = (points[n].p_DHand_mm - points[n].p_D_mm).norm() < kThinMm;
    double speed_mm_s = is_thin ? kCarefulMmPerS : kSlideMmPerS;
    const Vec3& before = points[n - std::min(n, kAround)].p_DHand_mm;
    const Vec3& after = points[std::min(n + kAround, points.size() - 1)].p_DHand_mm;
    const Vec3 in = points[n].p_DHand_mm - before, out = after - points[n].p_DHand_mm;
    const double length_mm = 0.5 * (in.norm() + out.norm());
    const double turn_rad = std::atan2(in.cross(out).norm(), in.dot(out));
    if (turn_rad > 1e-3 && length_mm > 0.0) {
      const double most_mm_s2 = is_thin ? kCarefulMmPerS2 : kSlideMmPerS2;
      speed_mm_s = std::min(speed_mm_s, std::sqrt(most_mm_s2 * length_mm / turn_rad));
    }
    points[n].speed_mm_s = std::max(speed_mm_s, kSlowestMmPerS);
  }
}

}  // namespace

double PressDepthMm(double stiffness_n_per_mm) {
  return std::clamp(kPressN / std::max(stiffness_n_per_mm, 1e-3), kLeastDepthMm, kMostDepthMm);
}

double LengthMm(const TouchStroke& stroke) {
  double length_mm = 0.0;
  for (std::size_t n = 1; n < stroke.points.size(); ++n) {
    length_mm += (stroke.points[n].p_DHand_mm - stroke.points[n - 1].p_DHand_mm).norm();
  }
  return length_mm;
}

bool IsSteady(SurfaceProbe& probe, const TouchStroke& stroke, const DeviceDescription& device) {
  const double step_mm = device.position_resolution_mm;
  const auto is_held = [&](const TouchPoint& point) {
    for (int side = 0; side < 6; ++side) {
      const Vec3 off = (side & 1 ? step_mm : -step_mm) * Vec3::Unit(side / 2);
      if (!probe.IsMaterial(point.p_DHand_mm + off)) return false;
    }
    return true;
  };
  const auto held = std::count_if(stroke.points.begin(), stroke.points.end(), is_held);
  constexpr double kSteadyShare = 0.9;
  return static_cast<double>(held) >= kSteadyShare * static_cast<double>(stroke.points.size());
}

TouchStroke MakeStroke(SurfaceProbe& probe, const SurfacePoint& start,
                       const DeviceDescription& device, double depth_mm) {
  Tracer tracer(probe, device);
  TouchStroke stroke;
  for (const SurfacePoint& point : LongestLine(tracer, start)) {
    stroke.points.push_back({.p_D_mm = point.p_D_mm,
                             .normal_D = point.normal_D,
                             .p_DHand_mm = HandPoint(probe, point, depth_mm)});
  }
  Smooth(probe, stroke.points);
  SetSpeeds(stroke.points);
  stroke.least_s = LengthMm(stroke) < kShortStrokeMm ? kShortStrokeS : kLongStrokeS;
  return stroke;
}

}  // namespace palpate
