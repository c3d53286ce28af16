#include "server/simulated_hand/led_hand.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr double kUnitLengthTolerance = 1e-3;

}  // namespace

LedHand::Lead LedHand::Take(const std::string& who) {
  const std::lock_guard lock(mutex_);
  if (is_taken_) {
    throw Error(ErrorKind::kConflict,
                "the hand is led by " + who_ + ": wait until they give it back");
  }
  is_taken_ = true;
  who_ = who;
  return ++newest_;
}

void LedHand::MoveTo(Lead lead, const Vec3& p_DTarget_mm, std::uint32_t buttons,
                     const std::optional<Eigen::Quaterniond>& R_DS) {
  if (!p_DTarget_mm.allFinite()) {
    throw Error(ErrorKind::kInvalidArgument, "a target of the hand needs three finite numbers");
  }
  Eigen::Quaterniond turned = R_DS.value_or(Eigen::Quaterniond::Identity());
  if (!(std::abs(turned.norm() - 1.0) < kUnitLengthTolerance)) {
    throw Error(ErrorKind::kInvalidArgument, "an orientation of the hand is a unit quaternion");
  }
  turned.normalize();
  const std::lock_guard lock(mutex_);
  if (!is_taken_ || lead != newest_) return;
  target_.Write({.is_led = true,
                 .x_mm = p_DTarget_mm.x(),
                 .y_mm = p_DTarget_mm.y(),
                 .z_mm = p_DTarget_mm.z(),
                 .buttons = buttons,
                 .is_turned = R_DS.has_value(),
                 .wxyz = {turned.w(), turned.x(), turned.y(), turned.z()}});
}

void LedHand::GiveBack(Lead lead) {
  const std::lock_guard lock(mutex_);
  if (!is_taken_ || lead != newest_) return;
  is_taken_ = false;
  target_.Write({});
}

std::string LedHand::led_by() const {
  const std::lock_guard lock(mutex_);
  return is_taken_ ? who_ : "";
}

namespace {

constexpr double kLedFollowS = 0.008;
constexpr double kLedStepS = 0.001;

}  // namespace

void LedScript::Mean::Begin(const Vec3& p_mm) { last_mm_.fill(p_mm); }

Vec3 LedScript::Mean::Add(const Vec3& p_mm) {
  last_mm_[oldest_] = p_mm;
  oldest_ = (oldest_ + 1) % kSize;
  // Always in the same order, and anew: a running sum would collect rounding errors for hours.
  Vec3 sum_mm = Vec3::Zero();
  for (const Vec3& one_mm : last_mm_) sum_mm += one_mm;
  return sum_mm / static_cast<double>(kSize);
}

LedScript::LedScript(std::unique_ptr<StylusScript> unled, LedHand& led,
                     const Vec3& workspace_min_mm, const Vec3& workspace_max_mm)
    : unled_(std::move(unled)),
      led_(led),
      workspace_min_mm_(workspace_min_mm),
      workspace_max_mm_(workspace_max_mm) {
  if (unled_ == nullptr) {
    throw Error(ErrorKind::kInvalidArgument, "a led hand needs a script for when nobody leads it");
  }
}

StylusScript::Target LedScript::Next(const HandState& hand, const Wrench& felt_M,
                                     double dt_s) noexcept {
  const LedTarget& newest = led_.Newest();
  // Without time, the hand is asked where it begins: it is nowhere yet.
  if (!newest.is_led || !(dt_s > 0.0)) {
    is_led_ = is_turned_ = false;
    return unled_->Next(hand, felt_M, dt_s);
  }
  if (!is_led_) Begin(hand, felt_M.force_n);
  R_MHeld_ = hand.R_MS;
  is_led_ = true;
  unled_->ResumeAt(hand);
  p_MTarget_mm_ = Vec3(newest.x_mm, newest.y_mm, newest.z_mm)
                      .cwiseMax(workspace_min_mm_)
                      .cwiseMin(workspace_max_mm_);
  Follow(dt_s);
  Turn(newest, dt_s);
  return {.p_MTarget_mm = hand_.SpringEnd(Vec3::Zero()),
          .buttons = newest.buttons,
          .p_MLed_mm = p_MTarget_mm_,
          .is_turned = is_turned_,
          .R_MTarget = UnalignedQuaternion(R_MTarget_)};
}

// Where the spring and the force that the hand feels are in balance, so that the hand stays.
void LedScript::Begin(const HandState& hand, const Vec3& felt_force_M_n) {
  p_MWay_mm_ = hand.p_MHip_mm - felt_force_M_n / kHandSpringNPerMm;
  hand_ = {.p_mm = p_MWay_mm_, .v_mm_s = hand.v_MHip_mm_s};
  mean_.Begin(p_MWay_mm_);
}

// Begins at how the stylus is held.
void LedScript::Turn(const LedTarget& newest, double dt_s) {
  if (newest.is_turned && !is_turned_) R_MTarget_ = R_MHeld_;
  is_turned_ = newest.is_turned;
  if (!is_turned_) return;
  const auto& [w, x, y, z] = newest.wxyz;
  const Eigen::Quaterniond goal(w, x, y, z);
  const double angle_rad = R_MTarget_.angularDistance(goal);
  const double share = dt_s / (kLedFollowS + dt_s);
  const double most = angle_rad > 0.0 ? kLedRadPerS * dt_s / angle_rad : 1.0;
  R_MTarget_ = R_MTarget_.slerp(std::min(share, most), goal);
  R_MTarget_.normalize();
}

// Late ticks are made up for in steps: the same lag, however slow the machine is.
void LedScript::Follow(double dt_s) {
  const int steps = std::max(1, static_cast<int>(std::lround(dt_s / kLedStepS)));
  const double step_s = dt_s / steps;
  for (int n = 0; n < steps; ++n) {
    const Vec3 ahead_mm = mean_.Add(p_MTarget_mm_) - p_MWay_mm_;
    const double most_mm = kLedMmPerS * step_s;
    const double distance_mm = ahead_mm.norm();
    p_MWay_mm_ += distance_mm > most_mm ? Vec3(ahead_mm * (most_mm / distance_mm)) : ahead_mm;
    hand_.Follow(p_MWay_mm_, kLedFollowS, step_s);
  }
}

}  // namespace palpate
