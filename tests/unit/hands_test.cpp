// Hands with little damping of their own, on layers and on a grain: passivity control keeps both
// from giving them energy. And what the grain feels like.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <vector>

#include "server/haptics/renderer.h"
#include "tests/support/hand_loop.h"
#include "tests/support/layered.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

using testing::Hand;
using testing::HandLoop;
using testing::LayersOf;

using testing::kLoopTickS;

// Density 0 at z = 40 to 1 at z = 0, of 1 mm voxels: an isovalue τ is the plane z = 40 - 40 τ.
class Hands : public ::testing::Test {
 protected:
  HapticOutput Step(const HapticSurface& surface, const Vec3& p_mm, double dt_s = kLoopTickS) {
    return StepRenderer(surface, settings_, p_mm, dt_s, *state_);
  }

  // The greatest energy that a hand gets.
  double GivenTo(const Hand& hand, bool is_late) {
    state_ = std::make_unique<RendererState>();
    const auto render = [&](const Vec3& p_mm, double dt_s, const Vec3& written_n) {
      TellWrittenForce(written_n, *state_);
      const HapticOutput output = Step(surface_, p_mm, dt_s);
      pops_ += output.popped;
      slides_ += !output.proxy.normal_D.isZero();
      return output.force_D_n;
    };
    return HandLoop(hand, {.seconds = 4.0, .is_late = is_late})
        .Run(render, [](const Vec3&) { return 0.0; })
        .given_mj;
  }

  // As passivity_test.cpp has them, pressing and stroking.
  void ExpectNoneGains(double stiffness_n_per_mm, const Vec3& aim_mm) {
    for (const bool is_late : {false, true}) {
      for (const double mass_kg : {0.03, 0.2}) {
        for (const double share : {0.05, 0.9}) {
          for (const double push_n : {0.3, 2.0}) {
            for (const double tremor_n : {0.0, 0.3 * push_n}) {
              SCOPED_TRACE(::testing::Message()
                           << mass_kg << " kg, " << share << " of the damping, " << push_n
                           << " N, tremor " << tremor_n << " N, late " << is_late);
              const Hand hand{.mass_kg = mass_kg,
                              .damping_n_s_per_m = share * stiffness_n_per_mm * 0.5,
                              .push_n = push_n,
                              .tremor_n = tremor_n,
                              .start_mm = Vec3(8.0, 8.0, 31.0),
                              .aim_mm = aim_mm};
              worst_mj_ = std::max(worst_mj_, GivenTo(hand, is_late));
            }
          }
        }
      }
    }
    EXPECT_LE(worst_mj_, 0.15);
  }

  std::shared_ptr<const VolumeSnapshot> volume_ =
      testing::MakeVolume(Vec3i(100, 100, 41), [](int, int, int k) { return (40.0 - k) / 40.0; });
  HapticSurface surface_ =
      MakeHapticSurface(*volume_, AffineMap{}, 0.25, DecompositionMethod::kTpbcc, 1);
  HapticSettings settings_{.passivity_control = true};
  std::unique_ptr<RendererState> state_ = std::make_unique<RendererState>();
  long pops_ = 0, slides_ = 0;
  double worst_mj_ = -1e9;
};

TEST_F(Hands, LayersGiveThemNothing) {
  for (const double skin : {0.3, 1.0}) {
    for (const double bone : {0.5, 3.0}) {
      for (const double gap : {5e-4, 0.05}) {
        const HapticLayers layers = LayersOf(
            {{.id = 1,
              .isovalue = 0.25,
              .stiffness_n_per_mm = skin,
              .pop_in_n = 0.8,
              .pop_out_n = 0.3},
             {.id = 2,
              .isovalue = 0.25 + gap,
              .stiffness_n_per_mm = bone,
              .pop_in_n = 1.5,
              .pop_out_n = 0.3},
             {.id = 3, .isovalue = 0.6, .stiffness_n_per_mm = bone, .dynamic_friction = 0.3}});
        surface_.layers = &layers;
        ExpectNoneGains(std::max(skin, bone), Vec3(8.0, 8.0, -1e3));
      }
    }
  }
  std::printf("layers: at most %.3f mJ, %ld pops\n", worst_mj_, pops_);
  EXPECT_GT(pops_, 100);
}

TEST_F(Hands, AGrainGivesThemNothing) {
  for (const double stiffness : {0.5, 2.0, 3.0}) {
    for (const double wavelength_mm : {0.3, 1.0, 5.0}) {
      settings_.stiffness_n_per_mm = stiffness;
      settings_.texture_force_n = 0.5;
      settings_.texture_wavelength_mm = wavelength_mm;
      ExpectNoneGains(stiffness, Vec3(8.0, 8.0, -1e3));
      ExpectNoneGains(stiffness, Vec3(1e3, 8.0, -1e3));
    }
  }
  std::printf("grain: at most %.3f mJ, %ld ticks in contact\n", worst_mj_, slides_);
  EXPECT_GT(slides_, 100'000);
}

// The frequency of the greatest part of a force that swings, from 2 Hz on.
double PeakHz(const std::vector<double>& force_n) {
  double mean_n = 0.0, peak = 0.0, peak_hz = 0.0;
  for (const double f : force_n) mean_n += f / static_cast<double>(force_n.size());
  for (double hz = 2.0; hz < 400.0; hz += 0.1) {
    std::complex<double> sum = 0.0;
    for (std::size_t n = 0; n < force_n.size(); ++n) {
      const double phase = 2.0 * std::numbers::pi * hz * kLoopTickS * static_cast<double>(n);
      sum += (force_n[n] - mean_n) * std::polar(1.0, phase);
    }
    if (std::abs(sum) > peak) peak = std::abs(sum), peak_hz = hz;
  }
  return peak_hz;
}

// Along x, obliquely, and in circles.
Vec3 Stroke(int way, double s_mm) {
  if (way == 0) return {8.0 + s_mm, 8.0, 29.0};
  if (way == 1) return {8.0 + 0.6 * s_mm, 8.0 + 0.8 * s_mm, 29.0};
  constexpr double kRadiusMm = 30.0;
  const double turn = s_mm / kRadiusMm;
  return {50.0 + kRadiusMm * std::cos(turn), 50.0 + kRadiusMm * std::sin(turn), 29.0};
}

TEST_F(Hands, AGrainSwingsAtSpeedByWavelengthWhicheverWayTheyStroke) {
  settings_ = {.stiffness_n_per_mm = 1.0};
  settings_.texture_force_n = 0.3;
  for (const double wavelength_mm : {0.5, 1.0, 3.0}) {
    for (const double speed_mm_per_s : {15.0, 40.0}) {
      for (const int way : {0, 1, 2}) {
        settings_.texture_wavelength_mm = wavelength_mm;
        state_ = std::make_unique<RendererState>();
        Step(surface_, Stroke(way, 0.0) + Vec3(0, 0, 5));
        std::vector<double> force_n;
        for (int n = 0; n < 2500; ++n) {
          const HapticOutput output = Step(surface_, Stroke(way, speed_mm_per_s * kLoopTickS * n));
          if (n >= 500) force_n.push_back(output.force_D_n.head<2>().norm());
        }
        const double expected_hz = speed_mm_per_s / wavelength_mm;
        EXPECT_NEAR(PeakHz(force_n), expected_hz, 0.02 * expected_hz) << way;
        EXPECT_NEAR(*std::ranges::max_element(force_n), 0.3, 0.01);
        EXPECT_LT(*std::ranges::min_element(force_n), 0.03);
      }
    }
  }
}

}  // namespace
}  // namespace palpate
