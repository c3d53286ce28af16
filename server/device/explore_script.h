// A script that finds the surface and slides over it by touch alone, as a blind
// explorer would: it knows its hand, the force it feels and the edges of its
// workspace, and nothing of the volume.
//
//   seek     the target moves from the edge of the workspace to an aim and on, until
//            the hand feels contact; the first aim is the middle, later ones are
//            beside the last contact or, where nothing is there any more, random
//   slide    the hand presses against the felt normal and moves across it, with
//            a heading that turns slowly
//   retreat  the target moves off the surface, then seeks again
//
// Frame D, mm, N, s. Threads and real-time: as StylusScript. The same seed and the
// same inputs give the same bits.
#pragma once

#include <cstdint>

#include "server/device/stylus_script.h"

namespace palpate {

class ExploreScript final : public StylusScript {
 public:
  ExploreScript(const Vec3& workspace_min_mm, const Vec3& workspace_max_mm, std::uint64_t seed);

  Target Next(const HandState& hand, const Vec3& felt_force_D_n, double dt_s) noexcept override;

 private:
  enum class Phase : std::uint8_t { kSeek, kSlide, kRetreat };

  void BeginSeek(const Vec3& from_mm, const Vec3& direction);
  void BeginSeekElsewhere();
  void BeginSlide(const HandState& hand);
  void BeginRetreat(const HandState& hand);
  void Seek(const HandState& hand, double dt_s);
  void Slide(const HandState& hand, double dt_s);
  void Retreat(double dt_s);

  bool InContact() const;
  void TurnHeading(double dt_s);
  bool RunsIntoBorder(const Vec3& p_mm, const Vec3& direction, double margin_mm,
                      double least_component) const;
  Vec3 Centre() const;
  Vec3 SidewaysFrom(const Vec3& p_mm);
  Vec3 RandomAim();
  Vec3 RandomDirection();
  double Random(double from, double to);

  Vec3 workspace_min_mm_;
  Vec3 workspace_max_mm_;
  std::uint64_t random_state_;

  Phase phase_ = Phase::kSeek;
  Vec3 target_mm_ = Vec3::Zero();
  Vec3 felt_n_ = Vec3::Zero();      // low-passed
  Vec3 direction_ = Vec3::Zero();   // unit: of the seek; of the slide, tangential
  Vec3 normal_ = Vec3::UnitZ();     // unit, out of the surface; the last one felt
  Vec3 contact_mm_ = Vec3::Zero();  // the last one felt
  bool remembers_contact_ = false;
  double turn_rate_rad_s_ = 0.0;    // of the heading about the normal
  double left_s_ = 0.0;             // of the slide
  double without_contact_s_ = 0.0;  // in the slide
  double retreated_mm_ = 0.0;
};

}  // namespace palpate
