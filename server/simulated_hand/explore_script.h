// A script that finds the surface and slides over it by touch alone. It knows the hand, the force
// on the hand and the edges of the workspace. It knows nothing of the volume.
//
//   seek     The target moves straight to an aim, slower near the aim, until the hand feels
//            contact. The aim is the last contact, or at first the middle. With every miss, the
//            aims spread farther about it.
//   slide    The hand presses against the felt normal and moves across it. The heading turns
//            slowly. The hand is slower where the normal turns fast. If the hand slips off, it
//            seeks the last contact.
//   retreat  From time to time, and where it is stuck, the hand leaves the surface and seeks it
//            again a hop farther on.
//
// Frame M, mm, N, s. Threads and real-time: as StylusScript. The same seed and the
// same inputs give the same bits.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "server/simulated_hand/stylus_script.h"

namespace palpate {

class ExploreScript final : public StylusScript {
 public:
  ExploreScript(const Vec3& workspace_min_mm, const Vec3& workspace_max_mm, std::uint64_t seed);

  Target Next(const HandState& hand, const Wrench& felt_M, double dt_s) noexcept override;
  // Seeks the surface from there.
  void ResumeAt(const HandState& hand) noexcept override;

 private:
  enum class Phase : std::uint8_t { kSeek, kSlide, kRetreat };

  void BeginSeek(const Vec3& from_mm, const Vec3& aim_mm);
  void BeginNextSeek(const Vec3& from_mm);
  void BeginSlide(const HandState& hand, const Vec3& felt_force_M_n);
  void BeginRetreat();
  void Seek(const HandState& hand, const Vec3& felt_force_M_n, double dt_s);
  void Slide(const HandState& hand, const Vec3& felt_force_M_n, double dt_s);
  void Retreat(const HandState& hand, double dt_s);

  void FollowNormal(double dt_s);
  void TurnHeading(double dt_s);
  double LeadMm() const;
  bool IsStuck(const Vec3& p_mm, double dt_s);
  bool RunsIntoBorder(const Vec3& p_mm) const;
  Vec3 Centre() const;
  Vec3 SidewaysFrom(const Vec3& p_mm);
  Vec3 RandomDirection();
  double Random(double from, double to);

  Vec3 workspace_min_mm_;
  Vec3 workspace_max_mm_;
  std::uint64_t random_state_;
  Vec3 contact_mm_;  // the last one; at first the middle, where the data most likely are
  int misses_ = 0;   // seeks since the last firm contact
  std::uint32_t seeks_ = 0;

  Phase phase_ = Phase::kSeek;
  Vec3 target_mm_ = Vec3::Zero();
  Vec3 felt_n_ = Vec3::Zero();       // low-passed
  Vec3 direction_ = Vec3::Zero();    // unit: of the seek; of the slide, tangential
  double left_mm_ = 0.0;             // of the seek
  double left_s_ = 0.0;              // of the slide or the retreat
  double without_contact_s_ = 0.0;   // in the slide
  Vec3 normal_ = Vec3::UnitZ();      // unit, out of the surface; the last one felt
  double normal_rate_rad_s_ = 0.0;   // at which the normal turns, low-passed
  double turn_rate_rad_s_ = 0.0;     // of the heading about the normal
  Vec3 way_mark_mm_ = Vec3::Zero();  // where the slide last made progress
  double at_way_mark_s_ = 0.0;
};

}  // namespace palpate
