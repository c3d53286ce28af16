#include "server/simulated_hand/explore_script.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate {
namespace {

constexpr double kSlideMmPerS = 60.0;
constexpr double kSeekMmPerS = 150.0;
constexpr double kBrakingMm = 15.0;  // before a seek's aim: the way from the seek's to the slide's
                                     // speed
constexpr double kPastAimMm = 4.0;
// After this number of seeks without contact, a search covers the whole workspace.
constexpr double kMissesToLookEverywhere = 12.0;

constexpr double kPressN = 0.6;
constexpr double kContactN = 0.05;
constexpr double kFirmN = 0.3;
constexpr double kForceFilterS = 0.015;
constexpr double kContactLostS = 0.03;
constexpr double kShortestSlideS = 3.0;
constexpr double kLongestSlideS = 6.0;
constexpr double kTurnRateRadPerS = 1.0;  // about the greatest rate
constexpr double kTurnMemoryS = 1.5;
// At this rate of the surface's normal, the slide has half its speed.
constexpr double kHalfSpeedRadPerS = 20.0;
constexpr double kNormalFilterS = 0.1;

constexpr double kStuckMm = 4.0;
constexpr double kStuckS = 0.3;
constexpr double kBorderMm = 3.0;
// A slide along the border may continue. A slide ends at the border if more than this share of its
// heading points outwards.
constexpr double kBorderComponent = 0.2;
constexpr double kRetreatS = 0.1;
constexpr double kHopMm = 12.0;

// At this lead of the target, the spring balances the damper at full speed.
constexpr double kFullLeadMm = kHandDamperNsPerMm * kSlideMmPerS / kHandSpringNPerMm;

// Returns `v` as a unit vector, or `fallback` if `v` is too short to have a direction.
Vec3 UnitOr(const Vec3& v, const Vec3& fallback) {
  const double length = v.norm();
  return length > 1e-9 ? Vec3(v / length) : fallback;
}

// Returns the part of `v` across `normal` as a unit vector. Returns any vector across `normal` if
// there is no such part.
Vec3 UnitAcross(const Vec3& v, const Vec3& normal) {
  return UnitOr(v - normal * v.dot(normal), normal.unitOrthogonal());
}

// Point n of a sequence that evenly fills the cube of edge 1 about the origin (Roberts's R3: powers
// of the root of x⁴ = x + 1).
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
  // The start is where a random line from the middle leaves the workspace.
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

StylusScript::Target ExploreScript::Next(const HandState& hand, const Wrench& felt_M,
                                         double dt_s) noexcept {
  const Vec3& felt_force_M_n = felt_M.force_n;
  felt_n_ += (felt_force_M_n - felt_n_) * (dt_s / (kForceFilterS + dt_s));
  switch (phase_) {
    case Phase::kSeek:
      Seek(hand, felt_force_M_n, dt_s);
      break;
    case Phase::kSlide:
      Slide(hand, felt_force_M_n, dt_s);
      break;
    case Phase::kRetreat:
      Retreat(hand, dt_s);
      break;
  }
  return {.p_MTarget_mm = target_mm_, .buttons = 0};
}

void ExploreScript::ResumeAt(const HandState& hand) noexcept {
  felt_n_ = Vec3::Zero();
  contact_mm_ = hand.p_MHip_mm;
  misses_ = 0;
  BeginNextSeek(hand.p_MHip_mm);
}

void ExploreScript::BeginSeek(const Vec3& from_mm, const Vec3& aim_mm) {
  const Vec3 way_mm = aim_mm.cwiseMax(workspace_min_mm_).cwiseMin(workspace_max_mm_) - from_mm;
  phase_ = Phase::kSeek;
  target_mm_ = from_mm;
  direction_ = UnitOr(way_mm, -normal_);
  left_mm_ = way_mm.norm() + kPastAimMm;
}

// Seeks the last contact, or at first the middle. With every miss, the aim moves farther away.
void ExploreScript::BeginNextSeek(const Vec3& from_mm) {
  const double reach = std::min(1.0, misses_ / kMissesToLookEverywhere);
  const Vec3 offset_mm = SpreadOut(seeks_).cwiseProduct(workspace_max_mm_ - workspace_min_mm_);
  BeginSeek(from_mm, contact_mm_ + reach * offset_mm);
  ++misses_;
  ++seeks_;
}

void ExploreScript::BeginSlide(const HandState& hand, const Vec3& felt_force_M_n) {
  phase_ = Phase::kSlide;
  felt_n_ = felt_force_M_n;
  normal_ = felt_force_M_n.normalized();
  contact_mm_ = hand.p_MHip_mm;
  left_s_ = Random(kShortestSlideS, kLongestSlideS);
  without_contact_s_ = 0.0;
  turn_rate_rad_s_ = 0.0;
  way_mark_mm_ = hand.p_MHip_mm;
  at_way_mark_s_ = 0.0;
  direction_ = SidewaysFrom(hand.p_MHip_mm);
}

void ExploreScript::BeginRetreat() {
  phase_ = Phase::kRetreat;
  left_s_ = kRetreatS;
}

void ExploreScript::Seek(const HandState& hand, const Vec3& felt_force_M_n, double dt_s) {
  if (felt_force_M_n.norm() > kContactN) {
    BeginSlide(hand, felt_force_M_n);
    Slide(hand, felt_force_M_n, dt_s);
    return;
  }
  const double step_mm =
      std::clamp(left_mm_ / kBrakingMm * kSeekMmPerS, kSlideMmPerS, kSeekMmPerS) * dt_s;
  target_mm_ += direction_ * step_mm;
  left_mm_ -= step_mm;
  if (left_mm_ <= 0.0) BeginNextSeek(target_mm_);
}

void ExploreScript::Slide(const HandState& hand, const Vec3& felt_force_M_n, double dt_s) {
  const double felt_n = felt_force_M_n.norm();
  if (felt_n > 0.0) {
    FollowNormal(dt_s);
    without_contact_s_ = 0.0;
  } else {
    without_contact_s_ += dt_s;
  }
  // A light touch may be a graze: the hand returns to this place, but the search continues.
  if (felt_n > kFirmN) {
    contact_mm_ = hand.p_MHip_mm;
    misses_ = 0;
  }
  TurnHeading(dt_s);
  left_s_ -= dt_s;
  if (without_contact_s_ > kContactLostS) {
    BeginNextSeek(hand.p_MHip_mm);
  } else if (left_s_ <= 0.0 || IsStuck(hand.p_MHip_mm, dt_s) || RunsIntoBorder(hand.p_MHip_mm)) {
    BeginRetreat();
  } else {
    // The target is relative to the hand, so the spring's force is constant. The hand presses with
    // this force at any depth, and the contact cannot build up a swing.
    target_mm_ = hand.p_MHip_mm - normal_ * (kPressN / kHandSpringNPerMm) + direction_ * LeadMm();
  }
}

void ExploreScript::Retreat(const HandState& hand, double dt_s) {
  target_mm_ = hand.p_MHip_mm + normal_ * kFullLeadMm;
  left_s_ -= dt_s;
  if (left_s_ > 0.0) return;
  const Vec3& from_mm = hand.p_MHip_mm;
  BeginSeek(from_mm, from_mm + kHopMm * (SidewaysFrom(from_mm) - normal_));
}

// There is no lead while contact is lost, so that the hand does not shoot past an edge.
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

// The turn rate is random around 0 with a short memory. The heading follows the surface.
void ExploreScript::TurnHeading(double dt_s) {
  const double kick = kTurnRateRadPerS * std::sqrt(6.0 * dt_s / kTurnMemoryS) * Random(-1.0, 1.0);
  turn_rate_rad_s_ += kick - turn_rate_rad_s_ * (dt_s / (kTurnMemoryS + dt_s));
  const Vec3 turned = direction_ + normal_.cross(direction_) * (turn_rate_rad_s_ * dt_s);
  direction_ = UnitAcross(turned, normal_);
}

// For example in a pit of the surface, where the hand circles about a proxy that cannot move.
bool ExploreScript::IsStuck(const Vec3& p_mm, double dt_s) {
  if ((p_mm - way_mark_mm_).norm() > kStuckMm) {
    way_mark_mm_ = p_mm;
    at_way_mark_s_ = 0.0;
  }
  at_way_mark_s_ += dt_s;
  return at_way_mark_s_ > kStuckS;
}

// True if `p` is at a side of the workspace or beyond it, and the slide leads outwards there.
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

// A random unit vector across the normal, biased towards the middle of the workspace.
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

// splitmix64 (Steele, Lea and Flood 2014). The standard distributions differ between libraries.
double ExploreScript::Random(double from, double to) {
  random_state_ += 0x9e3779b97f4a7c15u;
  std::uint64_t bits = random_state_;
  bits = (bits ^ (bits >> 30)) * 0xbf58476d1ce4e5b9u;
  bits = (bits ^ (bits >> 27)) * 0x94d049bb133111ebu;
  bits ^= bits >> 31;
  return from + (to - from) * (static_cast<double>(bits >> 11) * 0x1.0p-53);
}

}  // namespace palpate
