#include "server/simulated_hand/guided_script.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

// At most so fast, half way between two strokes.
constexpr double kArcMmPerS = 130.0;
constexpr double kOutMmPerS = 300.0;  // on the way out
constexpr double kShortestArcS = 0.2;
constexpr double kSlideMmPerS2 = 400.0;
constexpr double kFollowS = 0.012;

// Felt forces that the hand holds against. It slows down from the first on, and stands still at
// the second: something is in its way.
constexpr double kSlowingN = 1.2;
constexpr double kHeldForceN = 2.0;
constexpr double kOutForceN = 3.5;  // on the way out: more than the device can give
// More than the stroke's depth explains, whatever the friction: the surface holds the proxy
// somewhere else.
constexpr double kMostFriction = 1.9;
constexpr double kUnexplainedN = 0.3;
constexpr double kSpareN = 0.05;
constexpr double kCaughtS = 0.3;
constexpr double kGoingBackS = 1.5;
constexpr int kTimesCaught = 2;  // then the hand explores for a while
constexpr double kUnguidedS = 1.0;

// A turn of the barrel.
constexpr double kTurnS = 0.1;
constexpr double kTurnRadPerS = 3.0;

constexpr double kReachedMm = 2.0;
constexpr double kNothingS = 0.5;
constexpr double kMostOutS = 3.0;  // if something holds the hand, or if no other volume comes

// A stroke of a new plan that passes so near goes on where the old one was.
constexpr double kSameStrokeMm = 3.0;
constexpr double kLeastLiftMm = 3.0;
constexpr double kMostLiftMm = 15.0;
constexpr double kLiftPerMm = 0.3;

// Rises from 0 to 1 with the least jerk; its steepest slope is 1.875.
double MinimumJerk(double t) { return t * t * t * (10.0 + t * (6.0 * t - 15.0)); }
constexpr double kSteepestJerkSlope = 1.875;

Vec3 Limited(const Vec3& v, double length) {
  const double norm = v.norm();
  return norm > length ? Vec3(v * (length / norm)) : v;
}

constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
constexpr std::size_t kEndsOnly = std::numeric_limits<std::size_t>::max();

}  // namespace

struct GuidedScript::Nearest {
  double distance_mm = std::numeric_limits<double>::max();
  std::size_t stroke = 0;
  std::size_t point = 0;
};

// Of the points of each stroke that are `step` apart, and the last one.
GuidedScript::Nearest GuidedScript::NearestPoint(const TouchPlan& plan, const Vec3& p_mm,
                                                 std::size_t step, std::size_t other_than) {
  Nearest nearest;
  for (std::size_t stroke = 0; stroke < plan.strokes.size(); ++stroke) {
    if (stroke == other_than) continue;
    const std::vector<TouchPoint>& points = plan.strokes[stroke].points;
    const std::size_t last = points.size() - 1;
    for (std::size_t point = 0;; point += std::min(step, last - point)) {
      const double distance_mm = (points[point].p_DHand_mm - p_mm).norm();
      if (distance_mm < nearest.distance_mm) nearest = {distance_mm, stroke, point};
      if (point == last) break;
    }
  }
  return nearest;
}

GuidedScript::GuidedScript(std::unique_ptr<StylusScript> unguided, TouchPlanInbox& plans)
    : unguided_(std::move(unguided)), plans_(plans) {
  if (unguided_ == nullptr) {
    throw Error(ErrorKind::kInvalidArgument,
                "a guided hand needs a script for where it has no plan");
  }
}

StylusScript::Target GuidedScript::Next(const HandState& hand, const Wrench& felt_M,
                                        double dt_s) noexcept {
  // Without time, the hand is asked where it begins: it is nowhere yet.
  if (dt_s > 0.0) TakePlan(plans_.Acquire(), hand, dt_s);
  if (phase_ == Phase::kUnguided) {
    unguided_left_s_ -= dt_s;
    is_turned_ = false;
    return unguided_->Next(hand, felt_M, dt_s);
  }
  if (IsLost(felt_M.force_n, dt_s)) GoOut(hand);
  if (phase_ != Phase::kOut && IsCaught(felt_M.force_n, dt_s)) GoBack(hand);
  if (phase_ == Phase::kUnguided) return unguided_->Next(hand, felt_M, dt_s);
  const double pace =
      goes_back_ || phase_ == Phase::kOut
          ? 1.0
          : std::clamp((kHeldForceN - felt_M.force_n.norm()) / (kHeldForceN - kSlowingN), 0.0, 1.0);
  hand_.Follow(Goal(pace * dt_s), kFollowS, dt_s);
  const Vec3 held_n = Limited(felt_M.force_n, phase_ == Phase::kOut ? kOutForceN : kHeldForceN);
  Target target{.p_MTarget_mm = hand_.SpringEnd(held_n)};
  Turn(hand, dt_s, target);
  return target;
}

void GuidedScript::Turn(const HandState& hand, double dt_s, Target& target) {
  if (plan_ == nullptr || !plan_->turns_stylus) {
    is_turned_ = false;
    return;
  }
  if (!is_turned_) R_MTurned_ = hand.R_MS;
  target.is_turned = is_turned_ = true;
  const Eigen::Quaterniond held(R_MTurned_);
  const Vec3 normal_D = phase_ == Phase::kArc ? EndOf(stroke_, EntersAtLast()).normal_D : normal_D_;
  if (!normal_D.isZero(0.0)) {
    const auto whole = Eigen::Quaterniond::FromTwoVectors(held * Vec3::UnitZ(), normal_D);
    const double angle_rad = whole.angularDistance(Eigen::Quaterniond::Identity());
    const double most = angle_rad > 0.0 ? kTurnRadPerS * dt_s / angle_rad : 1.0;
    const double share = std::min(dt_s / (kTurnS + dt_s), most);
    R_MTurned_ = (Eigen::Quaterniond::Identity().slerp(share, whole) * held).normalized();
  }
  target.R_MTarget = R_MTurned_;
}

// Acquires, so that the plans of this time are freed. The newest one counts as new afterwards.
void GuidedScript::ResumeAt(const HandState& hand) noexcept {
  const TouchPlan* const plan = plans_.Acquire();
  if (plan != nullptr && plan->makes_room) plans_.is_out.store(true, std::memory_order_relaxed);
  plan_ = nullptr;
  times_caught_ = 0;
  goes_back_ = false;
  unguided_left_s_ = 0.0;
  normal_D_ = Vec3::Zero();
  phase_ = Phase::kUnguided;
  unguided_->ResumeAt(hand);
}

void GuidedScript::TakePlan(const TouchPlan* plan, const HandState& hand, double dt_s) {
  // The handoff keeps a plan until this script has acquired the next one. So a new plan has a new
  // address.
  const bool is_new = plan != plan_;
  if (is_new) avoided_ = kNone;
  plan_ = plan;
  if (is_new && plan != nullptr && plan->makes_room) GoOut(hand);
  if (phase_ == Phase::kOut && !IsOut(hand, dt_s)) return;
  const bool has_strokes = plan != nullptr && !plan->strokes.empty();
  if (!has_strokes) {
    if (phase_ != Phase::kUnguided) GiveUp(hand);
  } else if (is_new || phase_ == Phase::kOut ||
             (phase_ == Phase::kUnguided && unguided_left_s_ <= 0.0)) {
    BeginPlan(hand);
  }
}

void GuidedScript::GoOut(const HandState& hand) {
  if (phase_ == Phase::kUnguided) hand_ = {.p_mm = hand.p_MHip_mm, .v_mm_s = hand.v_MHip_mm_s};
  const auto nearer = [&](const Vec3& a, const Vec3& b) {
    return (a - hand_.p_mm).squaredNorm() < (b - hand_.p_mm).squaredNorm();
  };
  const std::vector<Vec3>& places_mm = plan_->p_DFree_mm;
  const Vec3& to_mm = *std::min_element(places_mm.begin(), places_mm.end(), nearer);
  BeginArc(TouchArc(hand_.p_mm, normal_D_, to_mm, Vec3::Zero(), kLeastLiftMm));
  arc_whole_s_ *= kArcMmPerS / kOutMmPerS;
  normal_D_ = Vec3::Zero();
  out_s_ = nothing_s_ = 0.0;
  phase_ = Phase::kOut;
}

// Whether the hand is out, and has another plan or has waited long enough for one.
bool GuidedScript::IsOut(const HandState& hand, double dt_s) {
  out_s_ += dt_s;
  const bool has_reached = (hand.p_MHip_mm - arc_.p_DTo_mm).norm() < kReachedMm;
  const bool makes_room = plan_ != nullptr && plan_->makes_room;
  if (has_reached && makes_room) plans_.is_out.store(true, std::memory_order_relaxed);
  return out_s_ > kMostOutS || (has_reached && !makes_room);
}

void GuidedScript::BeginPlan(const HandState& hand) {
  if (phase_ == Phase::kUnguided) hand_ = {.p_mm = hand.p_MHip_mm, .v_mm_s = hand.v_MHip_mm_s};
  constexpr std::size_t kLookStep = 4;
  if (phase_ == Phase::kStroke) {
    const Nearest point = NearestPoint(*plan_, hand_.p_mm, kLookStep, kNone);
    if (point.distance_mm < kSameStrokeMm) {
      stroke_ = point.stroke;
      place_ = static_cast<double>(point.point);
      return;
    }
  }
  const bool has_others = plan_->strokes.size() > 1;
  const Nearest end = NearestPoint(*plan_, hand_.p_mm, kEndsOnly, has_others ? avoided_ : kNone);
  avoided_ = kNone;
  stroke_ = end.stroke;
  tour_step_ = end.point == 0 ? 1 : -1;
  BeginArcToStroke(std::clamp(kLiftPerMm * end.distance_mm, kLeastLiftMm, kMostLiftMm));
}

void GuidedScript::BeginArc(const TouchArc& arc) {
  arc_ = arc;
  arc_s_ = 0.0;
  arc_whole_s_ = std::max(kShortestArcS, kSteepestJerkSlope * arc.FastestMm() / kArcMmPerS);
  caught_s_ = 0.0;
  phase_ = Phase::kArc;
}

void GuidedScript::BeginStroke() {
  phase_ = Phase::kStroke;
  slide_step_ = EntersAtLast() ? -1 : 1;
  place_ = EntersAtLast() ? static_cast<double>(stroke().points.size() - 1) : 0.0;
  slide_mm_s_ = 0.0;
  stroke_s_ = 0.0;
  caught_s_ = 0.0;
  was_caught_ = false;
}

const TouchPoint& GuidedScript::EndOf(std::size_t stroke, bool last) const {
  const std::vector<TouchPoint>& points = plan_->strokes[stroke].points;
  return last ? points.back() : points.front();
}

bool GuidedScript::IsAtTourEnd() const {
  return tour_step_ > 0 ? stroke_ + 1 == plan_->strokes.size() : stroke_ == 0;
}

// To the next stroke of the tour; at its end, back along the same one.
void GuidedScript::LeaveStroke() {
  if (IsAtTourEnd()) {
    tour_step_ = -tour_step_;
    BeginStroke();
    return;
  }
  const std::size_t left = stroke_;
  stroke_ += static_cast<std::size_t>(tour_step_);
  BeginArcToStroke(plan_->strokes[std::min(left, stroke_)].lift_to_next_mm);
}

void GuidedScript::BeginArcToStroke(double lift_mm) {
  const TouchPoint& to = EndOf(stroke_, EntersAtLast());
  BeginArc(TouchArc(hand_.p_mm, normal_D_, to.p_DHand_mm, to.normal_D, lift_mm));
}

// The proxy leaves a pit as it went in: so back along the stroke, and from its end on the way
// that led there.
void GuidedScript::GoBack(const HandState& hand) {
  caught_s_ = 0.0;
  if (goes_back_ || phase_ != Phase::kStroke || ++times_caught_ >= kTimesCaught) {
    GiveUp(hand);
    return;
  }
  goes_back_ = was_caught_ = true;
  slide_step_ = -slide_step_;
  slide_mm_s_ = 0.0;
  stroke_s_ = std::max(stroke_s_, stroke().least_s);
  tour_step_ = slide_step_;
}

void GuidedScript::GiveUp(const HandState& hand) {
  times_caught_ = 0;
  goes_back_ = false;
  unguided_left_s_ = kUnguidedS;
  normal_D_ = Vec3::Zero();
  avoided_ = stroke_;
  phase_ = Phase::kUnguided;
  unguided_->ResumeAt(hand);
}

bool GuidedScript::IsUnexplained(const Vec3& felt_force_M_n) const {
  double expected_n = kHeldForceN - kUnexplainedN - kSpareN;
  if (phase_ == Phase::kStroke) {
    const auto here = static_cast<std::size_t>(place_);
    const TouchPoint& point = stroke().points[std::min(here, stroke().points.size() - 1)];
    const double depth_mm = (point.p_DHand_mm - point.p_D_mm).norm();
    expected_n = std::min(expected_n, kMostFriction * plan_->stiffness_n_per_mm * depth_mm);
  }
  return felt_force_M_n.norm() > expected_n + kUnexplainedN;
}

bool GuidedScript::IsCaught(const Vec3& felt_force_M_n, double dt_s) {
  if (IsUnexplained(felt_force_M_n)) {
    caught_s_ += dt_s;
  } else {
    caught_s_ = 0.0;
    goes_back_ = false;
  }
  return caught_s_ > (goes_back_ ? kGoingBackS : kCaughtS);
}

// On a stroke the hand is below the surface. Without a force it may be far below another one; or
// forces are off, and then the hand leaves in vain.
bool GuidedScript::IsLost(const Vec3& felt_force_M_n, double dt_s) {
  const bool feels_nothing = phase_ == Phase::kStroke && felt_force_M_n.isZero(0.0);
  nothing_s_ = feels_nothing ? nothing_s_ + dt_s : 0.0;
  return nothing_s_ > kNothingS && !plan_->p_DFree_mm.empty();
}

Vec3 GuidedScript::Goal(double dt_s) {
  return phase_ == Phase::kStroke ? GoalOnStroke(dt_s) : GoalOnArc(dt_s);
}

Vec3 GuidedScript::GoalOnArc(double dt_s) {
  arc_s_ += dt_s;
  if (arc_s_ >= arc_whole_s_) {
    if (phase_ == Phase::kArc) BeginStroke();
    return arc_.p_DTo_mm;
  }
  return arc_.At(MinimumJerk(arc_s_ / arc_whole_s_));
}

Vec3 GuidedScript::GoalOnStroke(double dt_s) {
  const std::vector<TouchPoint>& points = stroke().points;
  stroke_s_ += dt_s;
  const auto last = static_cast<double>(points.size() - 1);
  const double left = slide_step_ > 0 ? last - place_ : place_;
  if (left <= 0.0) {
    const bool is_exit = points.size() == 1 || (slide_step_ < 0) == EntersAtLast();
    slide_mm_s_ = 0.0;
    normal_D_ = EndOf(stroke_, slide_step_ > 0).normal_D;
    const Vec3 here_mm = EndOf(stroke_, slide_step_ > 0).p_DHand_mm;
    if (is_exit && stroke_s_ >= stroke().least_s) {
      if (!was_caught_) times_caught_ = 0;
      LeaveStroke();
    } else if (points.size() > 1) {
      slide_step_ = -slide_step_;
    }
    return here_mm;
  }
  const auto low = static_cast<std::size_t>(std::min(place_, last - 1e-9));
  const TouchPoint& a = points[low];
  const TouchPoint& b = points[low + 1];
  const Vec3 way_mm = b.p_DHand_mm - a.p_DHand_mm;
  const double length_mm = std::max(way_mm.norm(), 1e-3);
  const double braking_mm_s = std::sqrt(2.0 * kSlideMmPerS2 * left * length_mm);
  slide_mm_s_ = std::min({slide_mm_s_ + kSlideMmPerS2 * dt_s, a.speed_mm_s, braking_mm_s + 1.0});
  place_ = std::clamp(place_ + slide_step_ * slide_mm_s_ * dt_s / length_mm, 0.0, last);
  normal_D_ = a.normal_D;
  const double share = place_ - static_cast<double>(low);
  return a.p_DHand_mm + std::clamp(share, 0.0, 1.0) * way_mm;
}

}  // namespace palpate
