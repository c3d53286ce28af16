// How far the force points from the exact normal on a bumpy ball.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>
#include <random>
#include <vector>

#include "server/haptics/renderer.h"
#include "tests/support/exact_surface.h"

namespace palpate {
namespace {

using namespace testing;

double AngleRad(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

constexpr double kDtS = 1e-3;
// Below the surface by so much, s is less than -0.1, three times SagBound(): inside H.
constexpr double kLeastDepth = 0.2;
constexpr int kBumpsEdge = 256;

// s = |p - c| - R - A b with b the product of the sines of k times the coordinates.
// Along a line in direction d, b is a mean of four cosines of frequency k (±d₁ ± d₂ ±
// d₃); over the signs the mean square is k², the mean fourth power at most 7/3 k⁴. So
// the derivatives of b along any line are at most k, k² and, by Cauchy-Schwarz,
// √(7/3) k³; a symmetric form is greatest for equal arguments, so that these bound
// mixed ones too. Of |p - c| they are at most 1, 1 / r and 2 / (√3 r²).
class Bumps {
 public:
  static constexpr double kAmplitude = kBumpsEdge / 128.0;
  static constexpr double kFrequency = 2.0 * std::numbers::pi / (kBumpsEdge / 8.0);
  static constexpr double kMeanRadius = 0.39 * kBumpsEdge;
  static constexpr double kSlope = kAmplitude * kFrequency;  // greatest of the bumps
  // Of all that the proxy and its force are computed from.
  static constexpr double kLeastRadius = kMeanRadius - kAmplitude - 4.0;
  static constexpr double kLeastGradient = 1.0 - kSlope;

  static Vec3 Centre() { return Vec3::Constant((kBumpsEdge - 1) / 2.0); }
  static double Value(const Vec3& p) {
    const Vec3 sine = (kFrequency * p).array().sin();
    return (p - Centre()).norm() - kMeanRadius - kAmplitude * sine.prod();
  }
  static Vec3 Gradient(const Vec3& p) {
    const Vec3 sine = (kFrequency * p).array().sin(), cosine = (kFrequency * p).array().cos();
    const Vec3 bumps(cosine.x() * sine.y() * sine.z(), sine.x() * cosine.y() * sine.z(),
                     sine.x() * sine.y() * cosine.z());
    return (p - Centre()).normalized() - kSlope * bumps;
  }
  static double SecondBound() { return kSlope * kFrequency + 1.0 / kLeastRadius; }
  static double BallThirdBound() {
    return 2.0 / (std::numbers::sqrt3 * kLeastRadius * kLeastRadius);
  }
  static double ThirdBound() {
    return std::sqrt(7.0 / 3.0) * kSlope * kFrequency * kFrequency + BallThirdBound();
  }
  // Where the ray from the centre meets s = 0: s rises along it.
  static Vec3 OnSurface(const Vec3& direction) {
    double radius = kMeanRadius;
    for (int n = 0; n < 20; ++n) {
      const Vec3 p = Centre() + radius * direction;
      radius -= Value(p) / Gradient(p).dot(direction);
    }
    return Centre() + radius * direction;
  }
};

// The greatest angle between a facet of H and ∇s at any of its points. ∇s at a mean of
// the corners is the mean of ∇s at them but for half the third derivative times the
// variance, which for up to 4 corners within `width` is at most 3/8 width². The mean
// is no farther from the normal than the farthest corner's.
double TiltOnBumpsRad(const VolumeSnapshot& volume) {
  double tilt = 0.0;
  VisitFacets(volume, [&](const Facet& facet) {
    double at_corner = 0.0, width2 = 0.0;
    for (int a = 0; a < facet.count; ++a) {
      at_corner = std::max(at_corner, AngleRad(facet.normal, Bumps::Gradient(facet.corner[a])));
      for (int b = 0; b < a; ++b) {
        width2 = std::max(width2, (facet.corner[a] - facet.corner[b]).squaredNorm());
      }
    }
    const double error = 3.0 / 16.0 * width2 * Bumps::ThirdBound();
    tilt = std::max(tilt, at_corner + std::asin(error / Bumps::kLeastGradient));
  });
  return tilt;
}

// Error of the shaded gradient. Differences: those of the bumps are ∂b sin k / k, so that
// at most k² / 6 of ∇b is missing; those of |p - c| miss a sixth of the third derivative
// along each axis. Interpolation adds an eighth of the second derivatives of the
// gradient along each axis; those of ∇b are -k² ∇b. Rounding: that of two densities,
// halved, along each axis; less than 1e-4 of the rest, so that it does not matter.
double ShadedErrorBound() {
  // All vertices that count are within (2, 1, 1) of SCP_H: none is clamped at |s| = 4.
  static_assert(2.45 * (1.0 + Bumps::kSlope) < 3.5);
  using std::numbers::sqrt3;
  const double bumps =
      Bumps::kSlope * Bumps::kFrequency * Bumps::kFrequency * (1.0 / 6.0 + 3.0 / 8.0);
  const double ball = sqrt3 * Bumps::BallThirdBound() * (1.0 / 6.0 + 3.0 / 8.0);
  return bumps + ball + sqrt3 * kStoredError;
}

// How far from s = 0 the proxy is at most, as s.
double SagBound() { return 3.0 / 8.0 * Bumps::SecondBound() + kStoredError; }

class Angles {
 public:
  void Add(double rad) { rad_.push_back(rad); }
  double Mean() const {
    return std::accumulate(rad_.begin(), rad_.end(), 0.0) / static_cast<double>(rad_.size());
  }
  double Quantile(double share) const {
    std::vector<double> sorted = rad_;
    std::sort(sorted.begin(), sorted.end());
    return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
  }
  double Worst() const { return Quantile(1.0); }
  void Print(const char* name, double bound_rad) const {
    std::printf("  %-10s mean %.3f, p99 %.3f, worst %.3f, bound %.3f degrees\n", name,
                Degrees(Mean()), Degrees(Quantile(0.99)), Degrees(Worst()), Degrees(bound_rad));
  }

 private:
  std::vector<double> rad_;
};

// The same HIPs with and without shading. The exact normal is that of s at SCP_H itself,
// which is within SagBound() of s = 0.
class BumpsRun {
 public:
  BumpsRun(const VolumeSnapshot& volume, double tilt_rad, double voxels_per_mm)
      : surface_(Surface(volume, voxels_per_mm)),
        tilt_rad_(tilt_rad + std::asin(kRestResidual)),
        voxels_per_mm_(voxels_per_mm) {
    shading_.force_shading = true;
  }

  // 1 mm below the surface.
  void Slide(int ticks) {
    for (int n = 0; n < ticks && !::testing::Test::HasFatalFailure(); ++n) {
      const double angle = kStepMm * voxels_per_mm_ / Bumps::kMeanRadius;
      const Vec3 p = Bumps::OnSurface(wanderer_.Next(angle));
      if (n == 0) Lift(p);
      Press(p, 1.0);
    }
  }
  // From free space down at once, at random places, up to 2 mm deep.
  void PressAnywhere(int presses) {
    std::uniform_real_distribution<double> depth_mm(kLeastDepth / voxels_per_mm_, 2.0);
    for (int n = 0; n < presses && !::testing::Test::HasFatalFailure(); ++n) {
      const Vec3 p = Bumps::OnSurface(RandomDirection(random_));
      Lift(p);
      Press(p, depth_mm(random_));
    }
  }

  const Angles& flat() const { return flat_; }
  const Angles& shaded() const { return shaded_; }
  double worst_share_of_shaded() const { return worst_share_of_shaded_; }

 private:
  HapticOutput Step(const HapticSettings& settings, const Vec3& p, RendererState& state) {
    HapticOutput output;
    for (int n = 0; n < kMaxSteps && (n == 0 || output.proxy.capped); ++n) {
      output = StepRenderer(surface_, settings, p / voxels_per_mm_, kDtS, state);
    }
    return output;
  }
  // A new proxy in free space above p.
  void Lift(const Vec3& p) {
    for (RendererState* state : {&flat_state_, &shaded_state_}) {
      state->proxy = Proxy();
      Step({}, Bumps::Centre() + 1.05 * (p - Bumps::Centre()), *state);
    }
  }

  void Press(const Vec3& p, double depth_mm) {
    const Vec3 hip = p - depth_mm * voxels_per_mm_ * Bumps::Gradient(p).normalized();
    const HapticOutput flat = Step({}, hip, flat_state_);
    const HapticOutput shaded = Step(shading_, hip, shaded_state_);
    ASSERT_EQ(flat.proxy.mode, ProxyMode::kConstrained);
    ASSERT_FALSE(flat.proxy.capped);
    ASSERT_EQ(flat.proxy.p_DH_mm, shaded.proxy.p_DH_mm);
    ASSERT_LE(RestResidual(surface_, hip / voxels_per_mm_, flat_state_.proxy, flat_state_.cache),
              kRestResidual);
    const Vec3 p_H = flat.proxy.p_DH_mm * voxels_per_mm_;
    ASSERT_LE(std::abs(Bumps::Value(p_H)), SagBound());
    const Vec3 exact = Bumps::Gradient(p_H);
    const double flat_rad = AngleRad(flat.force_D_n, exact);
    const double shaded_rad = AngleRad(shaded.force_D_n, exact);
    const double shaded_bound_rad = std::asin(ShadedErrorBound() / exact.norm());
    ASSERT_LE(flat_rad, tilt_rad_) << "HIP " << hip.transpose();
    ASSERT_LE(shaded_rad, shaded_bound_rad) << "HIP " << hip.transpose();
    flat_.Add(flat_rad);
    shaded_.Add(shaded_rad);
    worst_share_of_shaded_ = std::max(worst_share_of_shaded_, shaded_rad / shaded_bound_rad);
  }

  HapticSurface surface_;
  double tilt_rad_;
  double voxels_per_mm_;
  HapticSettings shading_;
  RendererState flat_state_, shaded_state_;
  std::mt19937_64 random_{41};
  Wanderer wanderer_{42};
  Angles flat_, shaded_;
  double worst_share_of_shaded_ = 0.0;
};

// The error of the flat normal is of first order in the size of a voxel, that of the
// shaded one of second: for sines of frequency k, their ratio is about 1 / k, here 5.1.
TEST(Accuracy, OfTheDirectionOnBumps) {
  const auto volume = Load("builtin:bumps:256");
  const double tilt_rad = TiltOnBumpsRad(*volume);
  const double shaded_rad = std::asin(ShadedErrorBound() / Bumps::kLeastGradient);
  // As much as ∇s turns across the diagonal of a cell.
  EXPECT_LE(tilt_rad, std::numbers::sqrt3 * Bumps::SecondBound() / Bumps::kLeastGradient);
  for (double voxels_per_mm : {0.5, 3.0}) {
    for (Motion motion : {Motion::kPath, Motion::kTeleports}) {
      BumpsRun run(*volume, tilt_rad, voxels_per_mm);
      motion == Motion::kPath ? run.Slide(20'000) : run.PressAnywhere(10'000);
      if (HasFatalFailure()) return;
      std::printf("%.1f voxels/mm, %s\n", voxels_per_mm,
                  motion == Motion::kPath ? "slide" : "presses");
      run.flat().Print("flat", tilt_rad);
      run.shaded().Print("shaded", shaded_rad);
      std::printf("  ratio of means %.2f, shaded up to %.0f%% of its bound\n",
                  run.flat().Mean() / run.shaded().Mean(), 100.0 * run.worst_share_of_shaded());
      EXPECT_GT(run.flat().Worst(), 0.05 * tilt_rad);
      EXPECT_GT(run.worst_share_of_shaded(), 0.05);
      EXPECT_GT(run.flat().Mean(), 0.5 / Bumps::kFrequency * run.shaded().Mean());
    }
  }
}

}  // namespace
}  // namespace palpate
