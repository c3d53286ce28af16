// A script whose hand follows a plan of touches, and explores by touch alone while
// it has none.
//
//   stroke  the hand slides along the points of a stroke, to and fro, for its time
//   arc     the hand lifts off, goes through free space to the next stroke, and
//           comes down on it; after a new plan, to the nearest stroke
//   back    where the force says that the surface holds the proxy elsewhere, in a pit: the hand
//           goes back the way on which it came, and leaves the stroke there
//   out     the hand goes to a free place, whatever it feels on the way: before another volume
//           comes, whose plan it waits for there; and if it feels nothing on a stroke, because the
//           surface was moved over it
//   other   without a plan, or where going back does not help: the other script's
//
// The hand goes where the plan has it: it knows its own mass, spring and damper, and
// holds against the force it feels, up to kHeldForceN. A plan for a rigid tool also has it turn the
// stylus: the barrel goes along the normal of the surface that it touches, or will touch next.
//
// Frame M, mm, N, s; plans are in D, which is M. Threads and real-time: as StylusScript; plans come
// by a wait-free handoff. A new plan costs a tick one look at each stroke's points. The same inputs
// and plans at the same ticks give the same bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "server/simulated_hand/stylus_script.h"
#include "server/simulated_hand/touch_planner.h"

namespace palpate {

class GuidedScript final : public StylusScript {
 public:
  // Borrows the inbox, of which it is the reader. Throws Error without a script.
  GuidedScript(std::unique_ptr<StylusScript> unguided, TouchPlanInbox& plans);

  Target Next(const HandState& hand, const Wrench& felt_M, double dt_s) noexcept override;
  // Whoever leads the hand also makes room for another volume: nobody waits for the hand.
  void ResumeAt(const HandState& hand) noexcept override;

 private:
  enum class Phase : std::uint8_t { kUnguided, kArc, kStroke, kOut };
  struct Nearest;

  void TakePlan(const TouchPlan* plan, const HandState& hand, double dt_s);
  void BeginPlan(const HandState& hand);
  void BeginArc(const TouchArc& arc);
  void GoOut(const HandState& hand);
  bool IsOut(const HandState& hand, double dt_s);
  void BeginStroke();
  bool IsAtTourEnd() const;
  void LeaveStroke();
  void GoBack(const HandState& hand);
  void BeginArcToStroke(double lift_mm);
  void GiveUp(const HandState& hand);
  bool IsUnexplained(const Vec3& felt_force_M_n) const;
  bool IsLost(const Vec3& felt_force_M_n, double dt_s);
  bool IsCaught(const Vec3& felt_force_M_n, double dt_s);
  static Nearest NearestPoint(const TouchPlan& plan, const Vec3& p_mm, std::size_t step,
                              std::size_t other_than);
  Vec3 Goal(double dt_s);
  void Turn(const HandState& hand, double dt_s, Target& target);
  Vec3 GoalOnArc(double dt_s);
  Vec3 GoalOnStroke(double dt_s);
  const TouchStroke& stroke() const { return plan_->strokes[stroke_]; }
  const TouchPoint& EndOf(std::size_t stroke, bool last) const;
  bool EntersAtLast() const { return tour_step_ < 0; }

  std::unique_ptr<StylusScript> unguided_;
  TouchPlanInbox& plans_;
  const TouchPlan* plan_ = nullptr;  // valid until the next Acquire

  Phase phase_ = Phase::kUnguided;
  std::size_t stroke_ = 0;
  int tour_step_ = 1;  // -1: on the way back
  TouchArc arc_;
  double arc_s_ = 0.0;  // time on it
  double arc_whole_s_ = 0.0;
  double place_ = 0.0;       // on the stroke, in points
  int slide_step_ = 1;       // along its points
  double slide_mm_s_ = 0.0;  // speed
  double stroke_s_ = 0.0;    // time on it
  double caught_s_ = 0.0;
  bool goes_back_ = false;                              // until the force is as it should be
  bool was_caught_ = false;                             // on this stroke
  int times_caught_ = 0;                                // since a stroke was done without
  std::size_t avoided_ = static_cast<std::size_t>(-1);  // stroke where it gave up; -1: none
  double unguided_left_s_ = 0.0;
  double out_s_ = 0.0;            // since the way out began
  double nothing_s_ = 0.0;        // that the hand has felt nothing on a stroke
  Vec3 normal_D_ = Vec3::Zero();  // of the surface that was touched last; zero: none
  HandFollower hand_;
  bool is_turned_ = false;
  UnalignedQuaternion R_MTurned_ = UnalignedQuaternion::Identity();  // of the stylus
};

}  // namespace palpate
