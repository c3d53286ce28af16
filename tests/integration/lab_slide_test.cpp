// A minute of sliding below the surface, at two speeds and two scales and on real
// volumes: no fall-through, no stick, no force that the surface does not explain.
#include <gtest/gtest.h>

#include <string>

#include "server/lab/bench.h"
#include "server/lab/trajectory.h"
#include "tests/support/data_folder.h"
#include "tests/support/places.h"

namespace palpate::lab {
namespace {

void ExpectSound(const ReplaySummary& s) {
  const Verdict& v = s.verdict;
  EXPECT_EQ(s.ticks, 60'000);
  EXPECT_EQ(v.fall_throughs, 0);
  EXPECT_EQ(v.sticks, 0);
  EXPECT_EQ(v.unchecked_ticks, 0);
  EXPECT_EQ(v.ejecting_ticks, 0);
  EXPECT_EQ(v.iteration_cap_hits, 0);
  // Where a force is above the expected one, the surface is why.
  EXPECT_EQ(v.excess_off_minimum_ticks, 0);
  EXPECT_EQ(v.scp_v_off_ticks, 0);
}

// By its number in kFixedSlides.
class FixedSlideTest : public ::testing::TestWithParam<std::size_t> {};

TEST_P(FixedSlideTest, IsFeltWithoutFault) {
  const FixedSlide& slide = kFixedSlides[GetParam()];
  const ReplaySummary s = RunFixedSlide(slide, 1);
  ExpectSound(s);
  EXPECT_EQ(s.verdict.excess_force_ticks, 0);
  EXPECT_GE(s.contact_share(), 0.99);
  EXPECT_GE(s.scp_v_share(), 0.999);
}

INSTANTIATE_TEST_SUITE_P(Volumes, FixedSlideTest,
                         ::testing::Range(std::size_t{0}, kFixedSlides.size()),
                         [](const auto& slide) {
                           return std::string(kFixedSlides[slide.param].name);
                         });

// Judged apart from the others, with nothing beside it: with room for other work on the machine.
TEST(SlideTime, AnUpdateTakesMicroseconds) {
  for (const FixedSlide& slide : kFixedSlides) {
    EXPECT_LT(RunFixedSlide(slide, 3).p50_ns, 8'000) << slide.name;
  }
}

// Noise, folds and thin walls: a proxy may be left behind by the HIP, which goes
// round a rim inside the material, and rest far from it.
class RealSlideTest : public ::testing::TestWithParam<testing::KnownSurface> {};

TEST_P(RealSlideTest, IsFeltWithoutFault) {
  const testing::KnownSurface& slide = GetParam();
  const std::string place = testing::PlaceOf(slide.source);
  if (place.empty()) GTEST_SKIP() << slide.source << testing::kMissing;
  const LoadedSurface loaded = LoadSurface({.volume = place,
                                            .isovalue = slide.isovalue,
                                            .normalized = true,
                                            .import_program = test::kPalpateImport});
  for (const double speed_cm_per_s : {10.0, 50.0}) {
    const auto hips_mm = MakeTrajectory(
        *loaded.volume, {.isovalue = loaded.isovalue, .speed_cm_per_s = speed_cm_per_s});
    const ReplaySummary s =
        ReplayAndJudge(loaded, DecompositionMethod::kTpbcc, HapticSettings{}, hips_mm, 1).summary;
    ExpectSound(s);
    EXPECT_GE(s.contact_share(), 0.5);
  }
}

using testing::KnownSurface;
INSTANTIATE_TEST_SUITE_P(Volumes, RealSlideTest,
                         ::testing::Values(KnownSurface{"daisy", testing::kDaisy, 0.02},
                                           KnownSurface{"orange", testing::kOrange, 0.22},
                                           KnownSurface{"lobster", testing::kLobster, 0.16},
                                           KnownSurface{"head", testing::kHead, 0.33}),
                         testing::kNameOf);

}  // namespace
}  // namespace palpate::lab
