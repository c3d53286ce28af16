#include "server/simulated_hand/touch_planner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <vector>

#include "server/haptics/proxy.h"
#include "server/simulated_hand/touch_strokes.h"

namespace palpate {
namespace {

// A hand that tries, with the proxy itself, whether the surface can be followed.
//
// What a plan takes from the trilinear density, the proxy may not do: noise has pits that hold
// it, and a wall of less than a voxel bars its way.
//
// Frame D (mm). Threads: one; borrows the surface. Not real-time.
class Rehearsal {
 public:
  explicit Rehearsal(const HapticSurface& surface);

  // The hand comes down on point `from` from above and slides to point `to`. Returns the number of
  // points, that one included, over which the proxy stays with the hand; 0: it did not come down.
  std::size_t Slide(const std::vector<TouchPoint>& points, std::size_t from, std::size_t to);

  // The hand leaves one touch by the arc. Whether the proxy comes to the other one.
  bool Crosses(const TouchPoint& from, const TouchPoint& to, const TouchArc& arc);

  // Of the proxy so far; one of many moves counts more than once.
  std::int64_t steps() const { return steps_; }

 private:
  bool ComeDown(const TouchPoint& point);
  bool Touches(const TouchPoint& point) const;
  void MoveTo(const Vec3& p_D_mm);

  const HapticSurface& surface_;
  std::unique_ptr<CellCache> cache_ = std::make_unique<CellCache>();
  Proxy proxy_;
  Vec3 hand_mm_ = Vec3::Zero();
  std::int64_t steps_ = 0;
};

constexpr double kAboveMm = 2.0;
constexpr double kStepMm = 0.4;
// What the proxy may be farther away from the hand than the surface is.
constexpr double kSlackShare = 0.6;
constexpr double kSlackMm = 0.3;
constexpr double kEjectLimitMm = 3.0;
constexpr int kMovesPerStep = 8;  // that the work of a step is counted for

Rehearsal::Rehearsal(const HapticSurface& surface) : surface_(surface) {}

std::size_t Rehearsal::Slide(const std::vector<TouchPoint>& points, std::size_t from,
                             std::size_t to) {
  if (!ComeDown(points[from])) return 0;
  std::size_t followed = 1;
  const std::size_t step = from < to ? 1 : static_cast<std::size_t>(-1);
  for (std::size_t n = from; n != to; ++followed) {
    n += step;
    MoveTo(points[n].p_DHand_mm);
    if (!Touches(points[n])) return followed;
  }
  return followed;
}

bool Rehearsal::Crosses(const TouchPoint& from, const TouchPoint& to, const TouchArc& arc) {
  if (!ComeDown(from)) return false;
  const double looks = std::ceil(arc.LengthMm() / (2.0 * kStepMm)) + 4.0;
  for (double look = 1.0; look <= looks; ++look) MoveTo(arc.At(look / looks));
  return Touches(to);
}

bool Rehearsal::ComeDown(const TouchPoint& point) {
  hand_mm_ = point.p_D_mm + kAboveMm * point.normal_D;
  proxy_ = Proxy();
  MoveTo(hand_mm_);
  MoveTo(point.p_DHand_mm);
  return Touches(point);
}

bool Rehearsal::Touches(const TouchPoint& point) const {
  const double depth_mm = (point.p_D_mm - point.p_DHand_mm).norm();
  return proxy_.on_surface() &&
         (proxy_.p_DH_mm - hand_mm_).norm() <= (1.0 + kSlackShare) * depth_mm + kSlackMm;
}

// In steps as of ticks, or a few of them.
void Rehearsal::MoveTo(const Vec3& p_D_mm) {
  const Vec3 way_mm = p_D_mm - hand_mm_;
  const double parts = std::max(1.0, std::ceil(way_mm.norm() / kStepMm));
  for (double part = 1.0; part <= parts; ++part) {
    const Vec3 hand_mm = p_D_mm - (1.0 - part / parts) * way_mm;
    const ProxyStep step = StepProxy(surface_, hand_mm, kEjectLimitMm, proxy_, *cache_);
    steps_ += 1 + step.moves / kMovesPerStep;
  }
  hand_mm_ = p_D_mm;
}

constexpr double kLongMm = 8.0;  // a stroke that shows something
constexpr std::array kLiftsMm = {2.0, 4.0, 8.0, 16.0, 30.0};
constexpr std::size_t kNearestTried = 8;

constexpr std::int64_t kReadsPerStep = 8;  // that a step of the proxy is worth

// Whether one gets from the point, at least along one of a few lines, out of the volume.
bool IsInTheOpen(SurfaceProbe& probe, const SurfacePoint& point, const Vec3& middle_D_mm) {
  constexpr int kMostSteps = 1000;
  const double step_mm = 0.8 * probe.surface().voxel_mm;
  const Vec3 outwards = (point.p_D_mm - middle_D_mm).normalized();
  for (const Vec3& away :
       {point.normal_D, Vec3(point.normal_D + outwards), Vec3(point.normal_D + Vec3::UnitZ())}) {
    if (away.norm() < 0.1) continue;
    const Vec3 step = step_mm * away.normalized();
    Vec3 p_D_mm = point.p_D_mm + 1.25 * probe.surface().voxel_mm * point.normal_D;
    int steps = 0;
    while (steps < kMostSteps && probe.IsInLattice(p_D_mm) && !probe.IsMaterial(p_D_mm)) {
      p_D_mm += step;
      ++steps;
    }
    if (steps == kMostSteps || !probe.IsInLattice(p_D_mm)) return true;
  }
  return false;
}

std::int64_t Work(const SurfaceProbe& probe, const Rehearsal& rehearsal) {
  return probe.reads() + kReadsPerStep * rehearsal.steps();
}

// Points that are not near a stroke that there is.
class Coverage {
 public:
  void Add(const TouchStroke& stroke) {
    constexpr std::size_t kEach = 6;
    for (std::size_t n = 0; n < stroke.points.size(); n += kEach) {
      covered_mm_.push_back(stroke.points[n].p_D_mm);
    }
  }
  bool Has(const Vec3& p_D_mm, double within_mm) const {
    return std::any_of(covered_mm_.begin(), covered_mm_.end(), [&](const Vec3& covered) {
      return (covered - p_D_mm).squaredNorm() < within_mm * within_mm;
    });
  }

 private:
  std::vector<Vec3> covered_mm_;
};

class StrokeMaker {
 public:
  StrokeMaker(SurfaceProbe& probe, Rehearsal& rehearsal, const DeviceDescription& device,
              double depth_mm, const GuideBudget& budget)
      : probe_(probe),
        rehearsal_(rehearsal),
        device_(device),
        depth_mm_(depth_mm),
        budget_(budget) {
    const HapticSurface& surface = probe.surface();
    middle_D_mm_ =
        surface.X_DI.Apply(0.5 * (surface.volume->size() - Vec3i::Ones()).cast<double>());
  }

  std::vector<TouchStroke> Make(const std::vector<SurfacePoint>& points) {
    constexpr std::size_t kFew = 8;
    std::vector<Access> access(points.size(), Access::kUnknown);
    if (probe_.surface().IsFreeOutside()) Spread(points, access, true);
    if (long_.size() + short_.size() < kFew) Spread(points, access, false);
    // Dust only where there is little else.
    if (long_.size() < kFew) long_.insert(long_.end(), short_.begin(), short_.end());
    return long_.empty() ? std::move(unsteady_) : std::move(long_);
  }

 private:
  enum class Access : std::uint8_t { kUnknown, kHidden, kUsed };

  // First far from each other, then nearer and nearer.
  void Spread(const std::vector<SurfacePoint>& points, std::vector<Access>& access,
              bool in_the_open) {
    const Vec3 sizes_mm = device_.workspace_max_mm - device_.workspace_min_mm;
    for (double apart_mm = sizes_mm.minCoeff() / 3.0; apart_mm > 2.0; apart_mm *= 0.6) {
      for (std::size_t n = 0; n < points.size(); ++n) {
        if (IsEnough()) return;
        if (access[n] == Access::kUsed || (in_the_open && access[n] == Access::kHidden)) continue;
        if (coverage_.Has(points[n].p_D_mm, apart_mm)) continue;
        if (in_the_open && !IsInTheOpen(probe_, points[n], middle_D_mm_)) {
          access[n] = Access::kHidden;
          continue;
        }
        access[n] = Access::kUsed;
        TouchStroke stroke = MakeStroke(probe_, points[n], device_, depth_mm_);
        coverage_.Add(stroke);
        if (!KeepFollowed(stroke)) continue;
        std::vector<TouchStroke>& kind = !IsSteady(probe_, stroke, device_) ? unsteady_
                                         : LengthMm(stroke) >= kLongMm      ? long_
                                                                            : short_;
        kind.push_back(std::move(stroke));
      }
    }
  }

  // The part of the stroke on which the proxy stays with the hand, there and back.
  bool KeepFollowed(TouchStroke& stroke) {
    std::vector<TouchPoint>& points = stroke.points;
    constexpr std::size_t kSpare = 2;
    const auto slide = [&](std::size_t from, std::size_t to) {
      const std::size_t whole = (from < to ? to - from : from - to) + 1;
      const std::size_t followed = rehearsal_.Slide(points, from, to);
      return followed == whole ? whole : followed - std::min(kSpare, followed);
    };
    const std::size_t middle = points.size() / 2;
    const std::size_t there = slide(middle, points.size() - 1);
    if (there == 0) return false;
    points.resize(middle + there);
    const std::size_t back = slide(points.size() - 1, 0);
    if (back == 0) return false;
    points.erase(points.begin(), points.end() - static_cast<std::ptrdiff_t>(back));
    const std::size_t again = slide(0, points.size() - 1);
    points.resize(again);
    return again > 0;
  }

  bool IsEnough() const {
    const auto most = static_cast<std::size_t>(budget_.strokes);
    return long_.size() >= most || short_.size() >= 2 * most || unsteady_.size() >= 4 * most ||
           Work(probe_, rehearsal_) > budget_.reads * 2 / 3;
  }

  SurfaceProbe& probe_;
  Rehearsal& rehearsal_;
  const DeviceDescription& device_;
  double depth_mm_;
  const GuideBudget& budget_;
  Vec3 middle_D_mm_;  // of the volume
  Coverage coverage_;
  std::vector<TouchStroke> long_, short_, unsteady_;
};

// Orders strokes: always on to the nearest end of another one that has a free way to it.
class TourMaker {
 public:
  TourMaker(SurfaceProbe& probe, Rehearsal& rehearsal, const DeviceDescription& device,
            double depth_mm, const GuideBudget& budget)
      : probe_(probe),
        rehearsal_(rehearsal),
        device_(device),
        near_mm_(depth_mm + 1.0),
        budget_(budget) {}

  std::vector<TouchStroke> Tour(std::vector<TouchStroke> strokes, std::size_t first) {
    std::vector<TouchStroke> tour;
    std::swap(strokes[first], strokes.back());
    tour.push_back(std::move(strokes.back()));
    strokes.pop_back();
    const auto most = static_cast<std::size_t>(budget_.strokes);
    while (tour.size() < most && AppendNext(strokes, tour)) {
    }
    return tour;
  }

 private:
  struct Next {
    double distance_mm;
    std::size_t stroke;
    bool backwards;
  };

  bool AppendNext(std::vector<TouchStroke>& strokes, std::vector<TouchStroke>& tour) {
    const TouchPoint& from = tour.back().points.back();
    std::vector<Next> ways;
    for (std::size_t n = 0; n < strokes.size(); ++n) {
      const std::vector<TouchPoint>& points = strokes[n].points;
      ways.push_back({(points.front().p_D_mm - from.p_D_mm).norm(), n, false});
      if (points.size() > 1) {
        ways.push_back({(points.back().p_D_mm - from.p_D_mm).norm(), n, true});
      }
    }
    const std::size_t tried = std::min(kNearestTried, ways.size());
    std::partial_sort(ways.begin(), ways.begin() + static_cast<std::ptrdiff_t>(tried), ways.end(),
                      [](const Next& a, const Next& b) { return a.distance_mm < b.distance_mm; });
    for (std::size_t n = 0; n < tried; ++n) {
      TouchStroke& next = strokes[ways[n].stroke];
      const TouchPoint& to = ways[n].backwards ? next.points.back() : next.points.front();
      const std::optional<double> lift_mm = FreeLift(from, to);
      if (!lift_mm) continue;
      tour.back().lift_to_next_mm = *lift_mm;
      if (ways[n].backwards) std::reverse(next.points.begin(), next.points.end());
      tour.push_back(std::move(next));
      strokes.erase(strokes.begin() + static_cast<std::ptrdiff_t>(ways[n].stroke));
      return true;
    }
    return false;
  }

  std::optional<double> FreeLift(const TouchPoint& from, const TouchPoint& to) {
    for (const double lift_mm : kLiftsMm) {
      if (Work(probe_, rehearsal_) > budget_.reads) return std::nullopt;
      const TouchArc there(from.p_DHand_mm, from.normal_D, to.p_DHand_mm, to.normal_D, lift_mm);
      const TouchArc back(to.p_DHand_mm, to.normal_D, from.p_DHand_mm, from.normal_D, lift_mm);
      if (IsFree(there) && rehearsal_.Crosses(from, to, there) &&
          rehearsal_.Crosses(to, from, back)) {
        return lift_mm;
      }
    }
    return std::nullopt;
  }

  // But for its two ends, which are below the surface.
  bool IsFree(const TouchArc& arc) {
    constexpr double kMostLooks = 150.0;
    const double looks =
        std::clamp(arc.LengthMm() / (0.7 * probe_.surface().voxel_mm), 8.0, kMostLooks);
    for (double look = 1.0; look < looks; ++look) {
      const Vec3 p_D_mm = arc.At(look / looks);
      if ((p_D_mm - arc.p_DFrom_mm).norm() < near_mm_) continue;
      if ((p_D_mm - arc.p_DTo_mm).norm() < near_mm_) continue;
      if (!IsWithinReach(device_, p_D_mm) || probe_.IsMaterial(p_D_mm)) return false;
    }
    return true;
  }

  SurfaceProbe& probe_;
  Rehearsal& rehearsal_;
  const DeviceDescription& device_;
  double near_mm_;  // to an end, where the arc is in material
  const GuideBudget& budget_;
};

}  // namespace

TouchPlan PlanTouches(const HapticSurface& surface, const DeviceDescription& device,
                      double stiffness_n_per_mm, const GuideBudget& budget, GuideCost* cost) {
  GuideCost spent;
  const std::vector<SurfacePoint> points = FindTouchPoints(surface, device, budget, spent);
  SurfaceProbe probe(surface);
  const double depth_mm = PressDepthMm(stiffness_n_per_mm);
  Rehearsal rehearsal(surface);
  const std::vector<TouchStroke> strokes =
      StrokeMaker(probe, rehearsal, device, depth_mm, budget).Make(points);
  TouchPlan plan{.strokes = {},
                 .stiffness_n_per_mm = stiffness_n_per_mm,
                 .p_DFree_mm = FindFreePlaces(surface, device)};
  // Pieces without a way between them: the tour of the most.
  constexpr std::size_t kStarts = 3;
  for (std::size_t first = 0; first < std::min(kStarts, strokes.size()); ++first) {
    std::vector<TouchStroke> tour =
        TourMaker(probe, rehearsal, device, depth_mm, budget).Tour(strokes, first);
    if (tour.size() > plan.strokes.size()) plan.strokes = std::move(tour);
    if (2 * plan.strokes.size() > strokes.size()) break;
  }
  // A device counts its steps from below: what it reads is half a step less.
  for (TouchStroke& stroke : plan.strokes) {
    for (TouchPoint& point : stroke.points) {
      point.p_DHand_mm += Vec3::Constant(0.5 * device.position_resolution_mm);
    }
  }
  spent.reads += Work(probe, rehearsal);
  if (cost != nullptr) *cost = spent;
  return plan;
}

}  // namespace palpate
