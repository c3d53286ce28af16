// How exact the proxy and its force are: the depth on a sphere, the direction on a bumpy ball.
//
// Next to the surface s = 0, the density of these volumes is ½ - s / 8, with s smooth and in
// voxels.
//
// Why facets bound the proxy and its force: a proxy at rest is a local minimum of its distance to
// the HIP. No direction into free space at the proxy's place x comes closer to the HIP. These
// directions include all that no facet of H through x excludes. So (Farkas) the spring force lies
// in the cone that the normals of those facets span. For a given direction, all directions within
// an angle below 90° also form a convex cone. So the force deviates from the exact normal by no
// more than the facets' normals do.
//
// How far H is from s = 0: the density of H at a point is a weighted mean of the densities at the
// cell's corners. The centre of the weights is the point, and their variance is at most ¼ per axis.
// So s is off by at most 3/8 of the greatest second derivative of s. If vertices are in the middle
// of faces and cells, each component of H's gradient is a mean of that component of ∇s over edges
// of the cell: H turns away no more than ∇s does across the cell. Both hold for these volumes
// although saddles move vertices; the tests check this.
//
// Frame: index coordinates, in voxels, unless the name says otherwise.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <string_view>

#include "server/haptics/renderer.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

constexpr double kIsovalue = 0.5;
constexpr double kVoxelsPerDensity = 8.0;  // change of s per density
constexpr double kStepMm = 0.1;            // of the HIP per tick: 10 cm/s
// The most that s moves because densities are stored as float near ½, and ties are lowered.
constexpr double kStoredError = kVoxelsPerDensity * (0x1p-25 + kTieStep);
// The greatest allowed residual of HIP - SCP_H at a resting proxy. The force is then at most this
// far from its cone, as a sine (Moreau).
constexpr double kRestResidual = 1e-6;
// The most steps towards the same HIP, after which the bound on moves no longer matters.
constexpr int kMaxSteps = 8;

std::shared_ptr<const VolumeSnapshot> Load(std::string_view source) {
  const BuiltinVolume builtin = MakeBuiltin(source);
  return MakeSnapshot(builtin.grid, builtin.metadata, 1);
}

HapticSurface Surface(const VolumeSnapshot& volume, double voxels_per_mm) {
  return MakeHapticSurface(volume, {Mat3::Identity() / voxels_per_mm, Vec3::Zero()}, kIsovalue,
                           DecompositionMethod::kTpbcc, 1);
}

double Degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

// The part of H within a tetrahedron: a flat convex polygon.
struct Facet {
  Vec3 normal = Vec3::Zero();  // towards free space, unit
  int count = 0;
  std::array<Vec3, 4> corner{};  // in no order
};

Facet FacetIn(const Decomposition& parts, int tetrahedron, const Vec3& origin) {
  const auto& v = parts.complex.vertices[tetrahedron];
  Facet facet;
  Mat3 edges;
  Vec3 rises;
  for (int a = 0; a < 4; ++a) {
    if (a > 0) {
      edges.row(a - 1) = (parts.position[v[a]] - parts.position[v[0]]).transpose();
      rises[a - 1] = parts.density[v[a]] - parts.density[v[0]];
    }
    for (int b = 0; b < a; ++b) {
      const double low = parts.density[v[a]] - kIsovalue, high = parts.density[v[b]] - kIsovalue;
      if ((low > 0.0) == (high > 0.0)) continue;
      const double share = low / (low - high);
      facet.corner[facet.count++] =
          origin + (1.0 - share) * parts.position[v[a]] + share * parts.position[v[b]];
    }
  }
  facet.normal = -(edges.inverse() * rises).normalized();
  return facet;
}

// Calls visit(facet) for every facet of H. Ties are resolved, so no vertex lies on H, and every
// tetrahedron with a point of H has a facet.
template <class Visitor>
void VisitFacets(const VolumeSnapshot& volume, Visitor visit) {
  Vec3i cell;
  for (cell.x() = -1; cell.x() < volume.size().x(); ++cell.x()) {
    for (cell.y() = -1; cell.y() < volume.size().y(); ++cell.y()) {
      for (cell.z() = -1; cell.z() < volume.size().z(); ++cell.z()) {
        const CellDensities d = volume.StoredCell(cell);
        const auto [low, high] = std::minmax_element(d.begin(), d.end());
        if (*low > kIsovalue + kTieStep || *high < kIsovalue) continue;
        const Decomposition parts =
            Decompose(VolumeSnapshot::WithTiesResolved(d, cell), DecompositionMethod::kTpbcc);
        for (int t = 0; t < parts.complex.tetrahedron_count; ++t) {
          const Facet facet = FacetIn(parts, t, cell.cast<double>());
          if (facet.count > 0) visit(facet);
        }
      }
    }
  }
}

Vec3 RandomDirection(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  for (;;) {
    const Vec3 v(normal(random), normal(random), normal(random));
    if (v.norm() > 0.1) return v.normalized();
  }
}

// A direction that wanders over the whole sphere.
class Wanderer {
 public:
  explicit Wanderer(std::uint64_t seed)
      : random_(seed), direction_(RandomDirection(random_)), axis_(RandomDirection(random_)) {}

  const Vec3& Next(double angle_rad) {
    axis_ += 0.03 * RandomDirection(random_);
    axis_ = (axis_ - axis_.dot(direction_) * direction_).normalized();
    direction_ = (Eigen::AngleAxisd(angle_rad, axis_) * direction_).normalized();
    return direction_;
  }

 private:
  std::mt19937_64 random_;
  Vec3 direction_, axis_;
};

// --- Depth

constexpr double kNoEjectLimitMm = 1e9;
constexpr int kSphereEdge = 128;
constexpr double kSphereRadius = 0.35 * kSphereEdge;
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

struct Excess {                  // of |SCP_H - HIP| over R - r
  double worst_share = 0.0;      // of what the bound allows at that r
  double greatest_gap_mm = 0.0;  // below the bound
  int redrawn = 0;
};

// HIPs anywhere between half the radius and H, one after the other.
class SphereRun {
 public:
  SphereRun(const VolumeSnapshot& volume, const SphereOfH& h, double voxels_per_mm)
      : surface_(Surface(volume, voxels_per_mm)), h_(h), bound_(h), voxels_per_mm_(voxels_per_mm) {}

  // Stops at the first failure.
  Excess Run(int hips) {
    StepProxy(surface_, (kSphereCentre + 1.2 * kSphereRadius * Vec3::UnitX()) / voxels_per_mm_,
              kNoEjectLimitMm, proxy_, cache_);
    for (int n = 0; n < hips && !::testing::Test::HasFatalFailure(); ++n) Press(NextHip());
    return excess_;
  }

 private:
  double StartDepth(const Vec3& hip) const {
    return (proxy_.p_DH_mm * voxels_per_mm_ - kSphereCentre - hip).norm();
  }

  // From the centre.
  Vec3 NextHip() {
    std::uniform_real_distribution<double> radius(0.5 * kSphereRadius, h_.low);
    for (;; ++excess_.redrawn) {
      const Vec3 hip = radius(random_) * RandomDirection(random_);
      // The very first comes from outside.
      if (!proxy_.on_surface() || StartDepth(hip) < bound_.FarDepth(hip.norm())) return hip;
    }
  }

  void Press(const Vec3& hip) {
    const double start = StartDepth(hip), r = hip.norm();
    const Vec3 hip_mm = (kSphereCentre + hip) / voxels_per_mm_;
    ProxyStep step;
    for (int n = 0; n < kMaxSteps && (n == 0 || step.capped); ++n) {
      step = StepProxy(surface_, hip_mm, kNoEjectLimitMm, proxy_, cache_);
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
    const double excess = depth - (kSphereRadius - r),
                 allowed = bound_.Depth(r) - (kSphereRadius - r);
    excess_.worst_share = std::max(excess_.worst_share, excess / allowed);
    excess_.greatest_gap_mm =
        std::max(excess_.greatest_gap_mm, (allowed - excess) / voxels_per_mm_);
  }

  HapticSurface surface_;
  SphereOfH h_;
  DepthBound bound_;
  double voxels_per_mm_;
  Proxy proxy_;
  CellCache cache_;
  std::mt19937_64 random_{31};
  Excess excess_;
};

// s is convex with second derivatives of at most 1 / r: H is inside the sphere, by 3 / (8 r)
// at most.
TEST(Accuracy, OfTheDepthOnASphere) {
  const auto volume = Load("builtin:sphere:128");
  const SphereOfH h = MeasureSphere(*volume);
  const double nearest = kSphereRadius - std::numbers::sqrt3;  // of a corner of a crossed cell
  EXPECT_GE(h.low, kSphereRadius - 3.0 / (8.0 * nearest) - kStoredError);
  EXPECT_LE(h.high, kSphereRadius + kStoredError);
  // As much as the radius turns across the diagonal of a cell.
  EXPECT_LE(std::acos(h.cos_tilt), std::numbers::sqrt3 / nearest);

  const int hips = std::max(2000, test::Scaled(3000));
  for (double voxels_per_mm : {0.5, 3.0}) {
    SphereRun run(*volume, h, voxels_per_mm);
    const Excess excess = run.Run(hips);
    if (HasFatalFailure()) return;
    std::printf("%.1f voxels/mm: %.0f%% of the bound, gap up to %.5f mm, %d redrawn\n",
                voxels_per_mm, 100.0 * excess.worst_share, excess.greatest_gap_mm, excess.redrawn);
    EXPECT_GT(excess.worst_share, 0.05);
    // Every proxy would break the bound if it were 0.1 mm farther from its HIP.
    EXPECT_LT(excess.greatest_gap_mm, 0.1);
    EXPECT_LT(excess.redrawn, 0.01 * hips);
  }
}

// --- Direction

double AngleRad(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

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

struct Angles {
  double sum_rad = 0.0, worst_rad = 0.0;
  long count = 0;

  void Add(double rad) {
    sum_rad += rad;
    worst_rad = std::max(worst_rad, rad);
    ++count;
  }
  double Mean() const { return sum_rad / static_cast<double>(count); }
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

  const Angles& flat() const { return flat_; }
  const Angles& shaded() const { return shaded_; }
  double worst_share_of_shaded() const { return worst_share_of_shaded_; }

 private:
  HapticOutput Step(const HapticSettings& settings, const Vec3& p, RendererState& state) {
    HapticOutput output;
    for (int n = 0; n < kMaxSteps && (n == 0 || output.proxy.capped); ++n) {
      output = StepRenderer(surface_, settings, p / voxels_per_mm_, 1e-3, state);
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
  Wanderer wanderer_{42};
  Angles flat_, shaded_;
  double worst_share_of_shaded_ = 0.0;
};

// The error of the flat normal is of first order in the size of a voxel, that of the
// shaded one of second: for sines of frequency k, their ratio is about 1 / k, here 5.1.
TEST(Accuracy, OfTheDirectionOnBumps) {
  const auto volume = Load("builtin:bumps:256");
  const double tilt_rad = TiltOnBumpsRad(*volume);
  // As much as ∇s turns across the diagonal of a cell.
  EXPECT_LE(tilt_rad, std::numbers::sqrt3 * Bumps::SecondBound() / Bumps::kLeastGradient);
  for (double voxels_per_mm : {0.5, 3.0}) {
    BumpsRun run(*volume, tilt_rad, voxels_per_mm);
    run.Slide(test::Scaled(5000));
    if (HasFatalFailure()) return;
    std::printf("%.1f voxels/mm: flat mean %.3f, worst %.3f of %.3f degrees; shaded mean %.3f\n",
                voxels_per_mm, Degrees(run.flat().Mean()), Degrees(run.flat().worst_rad),
                Degrees(tilt_rad), Degrees(run.shaded().Mean()));
    EXPECT_GT(run.flat().worst_rad, 0.05 * tilt_rad);
    EXPECT_GT(run.worst_share_of_shaded(), 0.05);
    EXPECT_GT(run.flat().Mean(), 0.5 / Bumps::kFrequency * run.shaded().Mean());
  }
}

}  // namespace
}  // namespace palpate
