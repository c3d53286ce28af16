#include "server/device/explore_script.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace palpate {
namespace {

constexpr double kSpeedMmPerS = 60.0;
constexpr double kPressN = 0.6;
constexpr double kContactN = 0.05;
constexpr double kForceFilterS = 0.015;
constexpr double kShortestSlideS = 3.0;
constexpr double kLongestSlideS = 6.0;
constexpr double kContactLostS = 0.3;
constexpr double kRetreatMm = 10.0;
constexpr double kBorderMm = 3.0;
// A slide along the border may go on; one with more than this share of its
// heading towards the border ends there.
constexpr double kBorderComponent = 0.2;
constexpr double kTurnRateRadPerS = 1.0;  // about the largest
constexpr double kTurnMemoryS = 1.5;

// The lead of the target at which the spring balances the damper at full speed.
constexpr double kLeadMm = kHandDamperNsPerMm * kSpeedMmPerS / kHandSpringNPerMm;

// `v` made a unit vector, or `fallback` where it has no direction.
Vec3 UnitOr(const Vec3& v, const Vec3& fallback) {
  const double length = v.norm();
  return length > 1e-9 ? Vec3(v / length) : fallback;
}

// The part of `v` across `normal`, as a unit vector; some such vector if it has none.
Vec3 UnitAcross(const Vec3& v, const Vec3& normal) {
  return UnitOr(v - normal * v.dot(normal), normal.unitOrthogonal());
}

}  // namespace

ExploreScript::ExploreScript(const Vec3& workspace_min_mm, const Vec3& workspace_max_mm,
                             std::uint64_t seed)
    : workspace_min_mm_(workspace_min_mm),
      workspace_max_mm_(workspace_max_mm),
      random_state_(seed) {
  // The first aim is the middle, where the data most likely are. The start is where
  // a line from there leaves the workspace.
  const Vec3 aim_mm = Centre();
  const Vec3 outwards = RandomDirection();
  double distance_mm = std::numeric_limits<double>::max();
  for (int i = 0; i < 3; ++i) {
    const double edge_mm = outwards[i] > 0.0 ? workspace_max_mm_[i] : workspace_min_mm_[i];
    if (outwards[i] != 0.0) {
      distance_mm = std::min(distance_mm, (edge_mm - aim_mm[i]) / outwards[i]);
    }
  }
  BeginSeek(aim_mm + outwards * distance_mm, -outwards);
}

StylusScript::Target ExploreScript::Next(const HandState& hand, const Vec3& felt_force_D_n,
                                         double dt_s) noexcept {
  felt_n_ += (felt_force_D_n - felt_n_) * (dt_s / (kForceFilterS + dt_s));
  switch (phase_) {
    case Phase::kSeek:
      Seek(hand, dt_s);
      break;
    case Phase::kSlide:
      Slide(hand, dt_s);
      break;
    case Phase::kRetreat:
      Retreat(dt_s);
      break;
  }
  return {.p_DTarget_mm = target_mm_, .buttons = 0};
}

void ExploreScript::BeginSeek(const Vec3& from_mm, const Vec3& direction) {
  phase_ = Phase::kSeek;
  target_mm_ = from_mm;
  direction_ = direction;
}

void ExploreScript::BeginSeekElsewhere() {
  const Vec3 from_mm = target_mm_.cwiseMax(workspace_min_mm_).cwiseMin(workspace_max_mm_);
  Vec3 aim_mm = RandomAim();
  if (remembers_contact_) {
    // Once: where this fails, the surface has changed.
    remembers_contact_ = false;
    aim_mm = contact_mm_ + kRetreatMm * (SidewaysFrom(contact_mm_) - normal_);
  } else if (Random(0.0, 1.0) < 0.5) {
    // Aims in the middle alone seldom lead across a flat workspace.
    const Vec3 inwards = UnitOr(aim_mm - from_mm, Vec3::UnitX());
    aim_mm = from_mm + inwards + RandomDirection();
  }
  BeginSeek(from_mm, UnitOr(aim_mm - from_mm, -normal_));
}

void ExploreScript::BeginSlide(const HandState& hand) {
  phase_ = Phase::kSlide;
  normal_ = felt_n_.normalized();
  left_s_ = Random(kShortestSlideS, kLongestSlideS);
  without_contact_s_ = 0.0;
  turn_rate_rad_s_ = 0.0;
  direction_ = SidewaysFrom(hand.p_DHip_mm);
}

void ExploreScript::BeginRetreat(const HandState& hand) {
  phase_ = Phase::kRetreat;
  target_mm_ = hand.p_DHip_mm;
  retreated_mm_ = 0.0;
}

void ExploreScript::Seek(const HandState& hand, double dt_s) {
  if (InContact()) {
    BeginSlide(hand);
    Slide(hand, dt_s);
    return;
  }
  target_mm_ += direction_ * (kSpeedMmPerS * dt_s);
  // Through to the other side without contact.
  if (RunsIntoBorder(target_mm_, direction_, 0.0, 0.0)) BeginSeekElsewhere();
}

void ExploreScript::Slide(const HandState& hand, double dt_s) {
  if (InContact()) {
    normal_ = felt_n_.normalized();
    contact_mm_ = hand.p_DHip_mm;
    remembers_contact_ = true;
    without_contact_s_ = 0.0;
  } else {
    without_contact_s_ += dt_s;
    if (without_contact_s_ > kContactLostS) {
      BeginSeek(hand.p_DHip_mm, -normal_);
      return;
    }
  }
  TurnHeading(dt_s);
  left_s_ -= dt_s;
  if (left_s_ <= 0.0 || RunsIntoBorder(hand.p_DHip_mm, direction_, kBorderMm, kBorderComponent)) {
    BeginRetreat(hand);
    return;
  }
  // Relative to the hand, so that the spring's force is constant: the hand
  // presses with it at any depth, and the contact cannot build up a swing.
  target_mm_ = hand.p_DHip_mm - normal_ * (kPressN / kHandSpringNPerMm) + direction_ * kLeadMm;
}

void ExploreScript::Retreat(double dt_s) {
  const double step_mm = kSpeedMmPerS * dt_s;
  target_mm_ += normal_ * step_mm;
  retreated_mm_ += step_mm;
  if (retreated_mm_ >= kRetreatMm) BeginSeekElsewhere();
}

bool ExploreScript::InContact() const { return felt_n_.norm() > kContactN; }

// The turn rate wanders about 0 and forgets itself; the heading follows the surface.
void ExploreScript::TurnHeading(double dt_s) {
  const double kick = kTurnRateRadPerS * std::sqrt(6.0 * dt_s / kTurnMemoryS) * Random(-1.0, 1.0);
  turn_rate_rad_s_ += kick - turn_rate_rad_s_ * (dt_s / (kTurnMemoryS + dt_s));
  const Vec3 turned = direction_ + normal_.cross(direction_) * (turn_rate_rad_s_ * dt_s);
  direction_ = UnitAcross(turned, normal_);
}

// Whether `p` is within the margin of a side of the workspace, or beyond it, and
// more than the given component of the unit vector `direction` leads there.
bool ExploreScript::RunsIntoBorder(const Vec3& p_mm, const Vec3& direction, double margin_mm,
                                   double least_component) const {
  for (int i = 0; i < 3; ++i) {
    const bool runs_up =
        p_mm[i] > workspace_max_mm_[i] - margin_mm && direction[i] > least_component;
    const bool runs_down =
        p_mm[i] < workspace_min_mm_[i] + margin_mm && direction[i] < -least_component;
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

// A point in the middle half of the workspace.
Vec3 ExploreScript::RandomAim() {
  Vec3 aim_mm;
  for (int i = 0; i < 3; ++i) {
    aim_mm[i] =
        workspace_min_mm_[i] + Random(0.25, 0.75) * (workspace_max_mm_[i] - workspace_min_mm_[i]);
  }
  return aim_mm;
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
