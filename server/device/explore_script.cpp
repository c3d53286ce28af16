#include "server/device/explore_script.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate {
namespace {

constexpr double kSlideMmPerS = 60.0;
constexpr double kSeekMmPerS = 150.0;
constexpr double kBrakingMm = 15.0;  // before the aim of a seek, from its speed to the slide's
constexpr double kPastAimMm = 4.0;
// A search has spread over the whole workspace after so many seeks.
constexpr double kMissesToLookEverywhere = 12.0;

constexpr double kPressN = 0.6;
constexpr double kContactN = 0.05;
constexpr double kFirmN = 0.3;
constexpr double kForceFilterS = 0.015;
constexpr double kContactLostS = 0.03;
constexpr double kShortestSlideS = 3.0;
constexpr double kLongestSlideS = 6.0;
constexpr double kTurnRateRadPerS = 1.0;  // about the largest
constexpr double kTurnMemoryS = 1.5;
// Where the surface's normal turns at this rate, the slide has half its speed.
constexpr double kHalfSpeedRadPerS = 20.0;
constexpr double kNormalFilterS = 0.1;

constexpr double kStuckMm = 4.0;
constexpr double kStuckS = 0.3;
constexpr double kBorderMm = 3.0;
// A slide along the border may go on; one with more than this share of its
// heading towards the border ends there.
constexpr double kBorderComponent = 0.2;
constexpr double kRetreatS = 0.1;
constexpr double kHopMm = 12.0;

// The lead of the target at which the spring balances the damper at full speed.
constexpr double kFullLeadMm = kHandDamperNsPerMm * kSlideMmPerS / kHandSpringNPerMm;

// `v` made a unit vector, or `fallback` where it has no direction.
Vec3 UnitOr(const Vec3& v, const Vec3& fallback) {
  const double length = v.norm();
  return length > 1e-9 ? Vec3(v / length) : fallback;
}

// The part of `v` across `normal`, as a unit vector; some such vector if it has none.
Vec3 UnitAcross(const Vec3& v, const Vec3& normal) {
  return UnitOr(v - normal * v.dot(normal), normal.unitOrthogonal());
}

// Point n of a sequence that fills the cube of edge 1 about the origin evenly
// (Roberts's R3: powers of the root of x⁴ = x + 1).
Vec3 SpreadOut(std::uint32_t n) {
  const Vec3 p = Vec3(0.8191725133961645, 0.6710436067037893, 0.5497004779019703) * n;
  return p.array() - p.array().round();
}

}  // namespace

ExploreScript::ExploreScript(const Vec3& workspace_min_mm, const Vec3& workspace_max_mm,
                             std::uint64_t seed)
    : workspace_min_mm_(workspace_min_mm),
      workspace_max_mm_(workspace_max_mm),
      random_state_(seed),
      contact_mm_(Centre()) {
  // The start is where some line from the middle leaves the workspace.
  const Vec3 outwards = RandomDirection();
  double distance_mm = std::numeric_limits<double>::max();
  for (int i = 0; i < 3; ++i) {
    const double edge_mm = outwards[i] > 0.0 ? workspace_max_mm_[i] : workspace_min_mm_[i];
    if (outwards[i] != 0.0) {
      distance_mm = std::min(distance_mm, (edge_mm - Centre()[i]) / outwards[i]);
    }
  }
  BeginNextSeek(Centre() + outwards * distance_mm);
}

StylusScript::Target ExploreScript::Next(const HandState& hand, const Vec3& felt_force_D_n,
                                         double dt_s) noexcept {
  felt_n_ += (felt_force_D_n - felt_n_) * (dt_s / (kForceFilterS + dt_s));
  switch (phase_) {
    case Phase::kSeek:
      Seek(hand, felt_force_D_n, dt_s);
      break;
    case Phase::kSlide:
      Slide(hand, felt_force_D_n, dt_s);
      break;
    case Phase::kRetreat:
      Retreat(hand, dt_s);
      break;
  }
  return {.p_DTarget_mm = target_mm_, .buttons = 0};
}

void ExploreScript::BeginSeek(const Vec3& from_mm, const Vec3& aim_mm) {
  const Vec3 way_mm = aim_mm.cwiseMax(workspace_min_mm_).cwiseMin(workspace_max_mm_) - from_mm;
  phase_ = Phase::kSeek;
  target_mm_ = from_mm;
  direction_ = UnitOr(way_mm, -normal_);
  left_mm_ = way_mm.norm() + kPastAimMm;
}

// To the last contact, or at first the middle, and farther off with every miss.
void ExploreScript::BeginNextSeek(const Vec3& from_mm) {
  const double reach = std::min(1.0, misses_ / kMissesToLookEverywhere);
  const Vec3 offset_mm = SpreadOut(seeks_).cwiseProduct(workspace_max_mm_ - workspace_min_mm_);
  BeginSeek(from_mm, contact_mm_ + reach * offset_mm);
  ++misses_;
  ++seeks_;
}

void ExploreScript::BeginSlide(const HandState& hand, const Vec3& felt_force_D_n) {
  phase_ = Phase::kSlide;
  felt_n_ = felt_force_D_n;
  normal_ = felt_force_D_n.normalized();
  contact_mm_ = hand.p_DHip_mm;
  left_s_ = Random(kShortestSlideS, kLongestSlideS);
  without_contact_s_ = 0.0;
  turn_rate_rad_s_ = 0.0;
  way_mark_mm_ = hand.p_DHip_mm;
  at_way_mark_s_ = 0.0;
  direction_ = SidewaysFrom(hand.p_DHip_mm);
}

void ExploreScript::BeginRetreat() {
  phase_ = Phase::kRetreat;
  left_s_ = kRetreatS;
}

void ExploreScript::Seek(const HandState& hand, const Vec3& felt_force_D_n, double dt_s) {
  if (felt_force_D_n.norm() > kContactN) {
    BeginSlide(hand, felt_force_D_n);
    Slide(hand, felt_force_D_n, dt_s);
    return;
  }
  const double step_mm =
      std::clamp(left_mm_ / kBrakingMm * kSeekMmPerS, kSlideMmPerS, kSeekMmPerS) * dt_s;
  target_mm_ += direction_ * step_mm;
  left_mm_ -= step_mm;
  if (left_mm_ <= 0.0) BeginNextSeek(target_mm_);
}

void ExploreScript::Slide(const HandState& hand, const Vec3& felt_force_D_n, double dt_s) {
  const double felt_n = felt_force_D_n.norm();
  if (felt_n > 0.0) {
    FollowNormal(dt_s);
    without_contact_s_ = 0.0;
  } else {
    without_contact_s_ += dt_s;
  }
  // A light touch may be a graze: a place to return to, but nothing found yet.
  if (felt_n > kFirmN) {
    contact_mm_ = hand.p_DHip_mm;
    misses_ = 0;
  }
  TurnHeading(dt_s);
  left_s_ -= dt_s;
  if (without_contact_s_ > kContactLostS) {
    BeginNextSeek(hand.p_DHip_mm);
  } else if (left_s_ <= 0.0 || IsStuck(hand.p_DHip_mm, dt_s) || RunsIntoBorder(hand.p_DHip_mm)) {
    BeginRetreat();
  } else {
    // Relative to the hand, so that the spring's force is constant: the hand
    // presses with it at any depth, and the contact cannot build up a swing.
    target_mm_ = hand.p_DHip_mm - normal_ * (kPressN / kHandSpringNPerMm) + direction_ * LeadMm();
  }
}

void ExploreScript::Retreat(const HandState& hand, double dt_s) {
  target_mm_ = hand.p_DHip_mm + normal_ * kFullLeadMm;
  left_s_ -= dt_s;
  if (left_s_ > 0.0) return;
  const Vec3& from_mm = hand.p_DHip_mm;
  BeginSeek(from_mm, from_mm + kHopMm * (SidewaysFrom(from_mm) - normal_));
}

// Waits where the surface has dropped away, so as not to shoot past its edge.
double ExploreScript::LeadMm() const {
  if (without_contact_s_ > 0.0) return 0.0;
  return kFullLeadMm / (1.0 + normal_rate_rad_s_ / kHalfSpeedRadPerS);
}

void ExploreScript::FollowNormal(double dt_s) {
  const Vec3 normal = UnitOr(felt_n_, normal_);
  if (dt_s > 0.0) {
    const double rate_rad_s = (normal - normal_).norm() / dt_s;
    normal_rate_rad_s_ += (rate_rad_s - normal_rate_rad_s_) * (dt_s / (kNormalFilterS + dt_s));
  }
  normal_ = normal;
}

// The turn rate wanders about 0 and forgets itself; the heading follows the surface.
void ExploreScript::TurnHeading(double dt_s) {
  const double kick = kTurnRateRadPerS * std::sqrt(6.0 * dt_s / kTurnMemoryS) * Random(-1.0, 1.0);
  turn_rate_rad_s_ += kick - turn_rate_rad_s_ * (dt_s / (kTurnMemoryS + dt_s));
  const Vec3 turned = direction_ + normal_.cross(direction_) * (turn_rate_rad_s_ * dt_s);
  direction_ = UnitAcross(turned, normal_);
}

// In a pit of the surface, say, the hand circles about a proxy that cannot move.
bool ExploreScript::IsStuck(const Vec3& p_mm, double dt_s) {
  if ((p_mm - way_mark_mm_).norm() > kStuckMm) {
    way_mark_mm_ = p_mm;
    at_way_mark_s_ = 0.0;
  }
  at_way_mark_s_ += dt_s;
  return at_way_mark_s_ > kStuckS;
}

// Whether `p` is at a side of the workspace, or beyond it, and the slide leads there.
bool ExploreScript::RunsIntoBorder(const Vec3& p_mm) const {
  for (int i = 0; i < 3; ++i) {
    const bool runs_up =
        p_mm[i] > workspace_max_mm_[i] - kBorderMm && direction_[i] > kBorderComponent;
    const bool runs_down =
        p_mm[i] < workspace_min_mm_[i] + kBorderMm && direction_[i] < -kBorderComponent;
    if (runs_up || runs_down) return true;
  }
  return false;
}

Vec3 ExploreScript::Centre() const { return 0.5 * (workspace_min_mm_ + workspace_max_mm_); }

// Some unit vector across the normal, rather to the middle of the workspace than
// to its border.
Vec3 ExploreScript::SidewaysFrom(const Vec3& p_mm) {
  const Vec3 inwards = UnitOr(Centre() - p_mm, Vec3::Zero());
  return UnitAcross(RandomDirection() + inwards, normal_);
}

Vec3 ExploreScript::RandomDirection() {
  const double z = Random(-1.0, 1.0);
  const double angle_rad = Random(0.0, 2.0 * std::numbers::pi);
  const double r = std::sqrt(1.0 - z * z);
  return {r * std::cos(angle_rad), r * std::sin(angle_rad), z};
}

// splitmix64 (Steele, Lea and Flood 2014): the standard distributions differ from
// library to library.
double ExploreScript::Random(double from, double to) {
  random_state_ += 0x9e3779b97f4a7c15u;
  std::uint64_t bits = random_state_;
  bits = (bits ^ (bits >> 30)) * 0xbf58476d1ce4e5b9u;
  bits = (bits ^ (bits >> 27)) * 0x94d049bb133111ebu;
  bits ^= bits >> 31;
  return from + (to - from) * (static_cast<double>(bits >> 11) * 0x1.0p-53);
}

}  // namespace palpate
