// How far the proxy is from the HIP on a sphere, against the exact distance.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <random>

#include "server/haptics/proxy.h"
#include "tests/support/exact_surface.h"

namespace palpate {
namespace {

using namespace testing;

constexpr double kFarMm = 1e9;  // an eject limit that never bites
constexpr int kSphereEdge = 128;
constexpr double kRadius = 0.35 * kSphereEdge;
const Vec3 kSphereCentre = Vec3::Constant((kSphereEdge - 1) / 2.0);

// Where H lies, over all its facets: no point of a facet is nearer to the centre than
// its plane or farther than a corner, and none is seen at a larger angle between
// normal and radius than the farthest corner, whose distance by that of the plane
// is the cosine.
struct SphereOfH {
  double low = std::numeric_limits<double>::infinity();  // least distance from the centre
  double high = 0.0;                                     // greatest
  double cos_tilt = 1.0;  // of the greatest angle between normal and radius
};

SphereOfH MeasureSphere(const VolumeSnapshot& volume) {
  SphereOfH h;
  VisitFacets(volume, [&](const Facet& facet) {
    double farthest = 0.0, plane = std::numeric_limits<double>::infinity();
    for (int n = 0; n < facet.count; ++n) {
      const Vec3 radius = facet.corner[n] - kSphereCentre;
      farthest = std::max(farthest, radius.norm());
      plane = std::min(plane, facet.normal.dot(radius));
    }
    h.low = std::min(h.low, plane);
    h.high = std::max(h.high, farthest);
    h.cos_tilt = std::min(h.cos_tilt, plane / farthest);
  });
  return h;
}

// HIP at r from the centre, proxy x at ρ, the force at an angle a to the radius at x.
// Then r² = ρ² - 2 ρ t cos a + t² for their distance t. The near root,
//   t = ρ cos a - √(r² - ρ² sin² a),
// grows with ρ and with a: it is greatest at the greatest of both. The far root, with
// a plus, is a proxy that a facet on the far side holds, where the HIP is straight
// below it: a local minimum too, which 2 of 25 000 teleports to anywhere found. It is at
// least FarDepth. Distances to the HIP only fall, so that a proxy that starts nearer
// ends at the near root.
class DepthBound {
 public:
  explicit DepthBound(const SphereOfH& h) : h_(h) {
    const double tilt = std::acos(h.cos_tilt) + std::asin(kRestResidual);
    cos_ = std::cos(tilt);
    sin_ = std::sin(tilt);
  }
  double Depth(double r) const { return h_.high * cos_ - Root(r); }
  double FarDepth(double r) const { return h_.low * cos_ + Root(r); }

 private:
  double Root(double r) const { return std::sqrt(r * r - h_.high * h_.high * sin_ * sin_); }

  SphereOfH h_;
  double cos_ = 1.0, sin_ = 0.0;
};

struct Excess {  // of |SCP_H - HIP| over R - r
  double worst_mm = -std::numeric_limits<double>::infinity();
  double least_mm = std::numeric_limits<double>::infinity();
  double worst_share = 0.0;      // of what the bound allows at that r
  double greatest_gap_mm = 0.0;  // below the bound
  int redrawn = 0;
};

// HIPs between half the radius and H.
class SphereRun {
 public:
  SphereRun(const VolumeSnapshot& volume, const SphereOfH& h, double voxels_per_mm, Motion motion)
      : surface_(Surface(volume, voxels_per_mm)),
        h_(h),
        bound_(h),
        voxels_per_mm_(voxels_per_mm),
        motion_(motion) {}

  // Stops at the first failure.
  Excess Run(int hips) {
    StepProxy(surface_, (kSphereCentre + 1.2 * kRadius * Vec3::UnitX()) / voxels_per_mm_, kFarMm,
              proxy_, cache_);
    for (int n = 0; n < hips && !::testing::Test::HasFatalFailure(); ++n) Press(NextHip(n));
    return excess_;
  }

 private:
  double StartDepth(const Vec3& hip) const {
    return (proxy_.p_DH_mm * voxels_per_mm_ - kSphereCentre - hip).norm();
  }

  // From the centre.
  Vec3 NextHip(int n) {
    if (motion_ == Motion::kPath) {
      const double share = 0.5 - 0.5 * std::cos(n * 0.0071);
      const double r = 0.5 * kRadius + share * (h_.low - 0.5 * kRadius);
      return r * wanderer_.Next(kStepMm * voxels_per_mm_ / r);
    }
    std::uniform_real_distribution<double> radius(0.5 * kRadius, h_.low);
    for (;; ++excess_.redrawn) {
      const Vec3 hip = radius(random_) * RandomDirection(random_);
      // The very first comes from outside.
      if (!proxy_.on_surface || StartDepth(hip) < bound_.FarDepth(hip.norm())) return hip;
    }
  }

  void Press(const Vec3& hip) {
    const double start = StartDepth(hip), r = hip.norm();
    const Vec3 hip_mm = (kSphereCentre + hip) / voxels_per_mm_;
    ProxyStep step;
    for (int n = 0; n < kMaxSteps && (n == 0 || step.capped); ++n) {
      step = StepProxy(surface_, hip_mm, kFarMm, proxy_, cache_);
    }
    ASSERT_EQ(step.mode, ProxyMode::kConstrained);
    ASSERT_FALSE(step.capped);
    ASSERT_LE(RestResidual(surface_, hip_mm, proxy_, cache_), kRestResidual);
    const double depth = (step.p_DH_mm - hip_mm).norm() * voxels_per_mm_;
    ASSERT_LE(depth, start * (1.0 + 1e-12));
    ASSERT_LE(depth, bound_.Depth(r)) << "HIP " << hip.transpose();
    ASSERT_GE(depth, h_.low - r) << "HIP " << hip.transpose();
    Note(r, depth);
  }

  void Note(double r, double depth) {
    const double excess = depth - (kRadius - r), allowed = bound_.Depth(r) - (kRadius - r);
    excess_.worst_mm = std::max(excess_.worst_mm, excess / voxels_per_mm_);
    excess_.least_mm = std::min(excess_.least_mm, excess / voxels_per_mm_);
    excess_.worst_share = std::max(excess_.worst_share, excess / allowed);
    excess_.greatest_gap_mm =
        std::max(excess_.greatest_gap_mm, (allowed - excess) / voxels_per_mm_);
  }

  HapticSurface surface_;
  SphereOfH h_;
  DepthBound bound_;
  double voxels_per_mm_;
  Motion motion_;
  Proxy proxy_;
  CellCache cache_;
  std::mt19937_64 random_{31};
  Wanderer wanderer_{32};
  Excess excess_;
};

// s is convex with second derivatives of at most 1 / r: H is inside the sphere, by 3 / (8 r)
// at most.
TEST(Accuracy, OfTheDepthOnASphere) {
  const auto volume = Load("builtin:sphere:128");
  const SphereOfH h = MeasureSphere(*volume);
  std::printf("H: R %+.5f to %+.5f voxels, tilt %.3f degrees\n", h.low - kRadius, h.high - kRadius,
              Degrees(std::acos(h.cos_tilt)));
  const double nearest = kRadius - std::numbers::sqrt3;  // of a corner of a crossed cell
  EXPECT_GE(h.low, kRadius - 3.0 / (8.0 * nearest) - kStoredError);
  EXPECT_LE(h.high, kRadius + kStoredError);
  // As much as the radius turns across the diagonal of a cell.
  EXPECT_LE(std::acos(h.cos_tilt), std::numbers::sqrt3 / nearest);

  for (double voxels_per_mm : {0.5, 3.0}) {
    for (Motion motion : {Motion::kPath, Motion::kTeleports}) {
      SphereRun run(*volume, h, voxels_per_mm, motion);
      const int hips = motion == Motion::kPath ? 35'000 : 15'000;
      const Excess excess = run.Run(hips);
      if (HasFatalFailure()) return;
      std::printf(
          "%.1f voxels/mm, %s: |SCP_H - HIP| - exact from %.5f to %.5f mm, at R/2 at most "
          "%.5f, %.0f%% of the bound, gap up to %.5f mm, %d redrawn\n",
          voxels_per_mm, motion == Motion::kPath ? "path" : "teleports", excess.least_mm,
          excess.worst_mm, (DepthBound(h).Depth(0.5 * kRadius) - 0.5 * kRadius) / voxels_per_mm,
          100.0 * excess.worst_share, excess.greatest_gap_mm, excess.redrawn);
      EXPECT_GT(excess.worst_share, 0.05);
      // Every proxy would break the bound if it were 0.1 mm farther from its HIP.
      EXPECT_LT(excess.greatest_gap_mm, 0.1);
      EXPECT_LT(excess.redrawn, 0.01 * hips);
    }
  }
}

}  // namespace
}  // namespace palpate
