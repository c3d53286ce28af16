// A hand that explores by touch alone, without a plan, goes over whole volumes for 20 s each,
// as fast as it goes: what is felt, and what never happens to one who feels it.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "server/device/explore_script.h"
#include "server/device/simulated_device.h"
#include "server/servo/servo_tick.h"
#include "server/session/session.h"
#include "tests/support/data_folder.h"
#include "tests/support/places.h"

namespace palpate {
namespace {

constexpr int kTicks = 20'000;
constexpr std::uint64_t kSeed = 1;  // the daemon's

struct Slide {
  const char* name;
  const char* source;  // in the data folder, or builtin
  double isovalue;     // normalised; of a builtin in its own units
  double least_contact_percent = 40.0;

  bool IsBuiltin() const { return std::string_view(source).starts_with("builtin:"); }
};

void PrintTo(const Slide& slide, std::ostream* out) { *out << slide.name; }

std::string SourceOf(const Slide& slide) {
  if (slide.IsBuiltin()) return slide.source;
  const std::filesystem::path path = testing::DataFolder() / slide.source;
  return std::filesystem::weakly_canonical(path).string();
}

// Publishes the volume to the inbox as the daemon does.
void Load(const Slide& slide, const DeviceSpec& device, SceneInbox& inbox) {
  const auto outbox = std::make_unique<TickOutbox>();
  Pump pump(*outbox);
  Session session(device, inbox, pump, VolumeLoader{.import_program = test::kPalpateImport});
  LoadRequest request;
  request.source = SourceOf(slide);
  (slide.IsBuiltin() ? request.isovalue : request.normalized_isovalue) = slide.isovalue;
  session.Load(
      request, [](std::string_view, double) {}, [] { return false; });
}

std::vector<TickSample> Explore(const Scene& scene) {
  const DeviceSpec spec = SimulatedDeviceSpec();
  SimulatedDevice device(
      std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, kSeed));
  device.Start();
  ServoTick tick(device);
  std::vector<TickSample> log;
  log.reserve(kTicks);
  for (int i = 0; i < kTicks; ++i) {
    const std::int64_t now_ns = std::int64_t{1'000'000} * i;
    log.push_back(tick.Run(scene, TickTime{.scheduled_ns = now_ns, .started_ns = now_ns}));
  }
  return log;
}

struct Summary {
  double contact_percent = 0.0;
  double first_contact_s = 0.0;  // the whole run where there is none
  double median_force_n = 0.0;   // of the ticks in contact
  double mean_update_us = 0.0;
  double p99_update_us = 0.0;
  std::uint32_t max_iterations = 0;
  std::uint64_t capped_ticks = 0;
  double scp_v_percent = 100.0;  // of the ticks in contact
  int inside_ticks = 0;          // density above the isovalue
  int ejecting_ticks = 0;
  int force_steps = 0;  // by more than the safety stage allows
  double max_force_n = 0.0;
  bool finite = true;
};

Vec3 ToVec3(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }

bool IsFinite(const TickSample& sample) {
  return ToVec3(sample.hip_mm).allFinite() && ToVec3(sample.scp_h_mm).allFinite() &&
         ToVec3(sample.scp_h_normal).allFinite() && ToVec3(sample.scp_v_mm).allFinite() &&
         ToVec3(sample.scp_v_normal).allFinite() && ToVec3(sample.force_n).allFinite() &&
         std::isfinite(sample.density);
}

double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

Summary Summarise(const std::vector<TickSample>& log) {
  constexpr double kMaxForceStepN = 0.2 + 1e-9;
  Summary s;
  std::vector<double> forces_n, updates_us;
  int with_scp_v = 0;
  Vec3 last_n = Vec3::Zero();
  for (const TickSample& sample : log) {
    const Vec3 force_n = ToVec3(sample.force_n);
    if (sample.contact) {
      if (forces_n.empty()) s.first_contact_s = static_cast<double>(sample.time_ns) * 1e-9;
      forces_n.push_back(force_n.norm());
      with_scp_v += sample.has_scp_v;
    }
    updates_us.push_back(static_cast<double>(sample.update_ns) * 1e-3);
    s.mean_update_us += updates_us.back() / kTicks;
    s.max_iterations = std::max(s.max_iterations, sample.iterations);
    const bool ejecting = sample.mode == TickMode::kEjecting;
    s.inside_ticks += !ejecting && sample.density > sample.isovalue;
    s.ejecting_ticks += ejecting;
    s.force_steps += (force_n - last_n).norm() > kMaxForceStepN;
    s.max_force_n = std::max(s.max_force_n, force_n.norm());
    s.finite = s.finite && IsFinite(sample);
    last_n = force_n;
  }
  const double contact_ticks = static_cast<double>(forces_n.size());
  s.contact_percent = 100.0 * contact_ticks / kTicks;
  if (forces_n.empty()) s.first_contact_s = kTicks * kTickPeriodS;
  s.median_force_n = Quantile(forces_n, 0.5);
  s.p99_update_us = Quantile(updates_us, 0.99);
  s.capped_ticks = log.back().capped_ticks;
  if (!forces_n.empty()) s.scp_v_percent = 100.0 * with_scp_v / contact_ticks;
  return s;
}

void Print(const Slide& slide, const Summary& s) {
  std::printf(
      "%-14s contact %5.1f %%, first at %5.2f s, %.2f N, update %.1f us (p99 %.1f), at most %3u "
      "iterations, capped %d, SCP_V %6.2f %%, inside %d, force steps %d\n",
      slide.name, s.contact_percent, s.first_contact_s, s.median_force_n, s.mean_update_us,
      s.p99_update_us, s.max_iterations, static_cast<int>(s.capped_ticks), s.scp_v_percent,
      s.inside_ticks, s.force_steps);
}

class SlideTest : public ::testing::TestWithParam<Slide> {};

TEST_P(SlideTest, IsFeltAndNeverFallenThrough) {
  const Slide& slide = GetParam();
  if (!slide.IsBuiltin() && !std::filesystem::exists(SourceOf(slide))) {
    GTEST_SKIP() << SourceOf(slide) << " is missing: see PALPATE_DATA_DIR";
  }
  SceneInbox inbox;
  Load(slide, SimulatedDeviceSpec(), inbox);
  const Summary s = Summarise(Explore(*inbox.Acquire()));
  Print(slide, s);

  EXPECT_TRUE(s.finite);
  EXPECT_EQ(s.inside_ticks, 0);
  // Neither the isovalue nor the data change.
  EXPECT_EQ(s.ejecting_ticks, 0);
  EXPECT_EQ(s.capped_ticks, 0u);
  EXPECT_EQ(s.force_steps, 0);
  EXPECT_LE(s.max_force_n, SimulatedDeviceSpec().max_force_n + 1e-9);
  EXPECT_GE(s.contact_percent, slide.least_contact_percent);
  if (slide.IsBuiltin()) {
    EXPECT_GE(s.scp_v_percent, 99.0);
  }
#if defined(NDEBUG) && !defined(PALPATE_SANITIZED)
  EXPECT_LT(s.mean_update_us, 20.0);
#endif
}

INSTANTIATE_TEST_SUITE_P(
    Volumes, SlideTest,
    ::testing::Values(Slide{"sphere", "builtin:sphere", 0.53, 60.0},
                      Slide{"bumps", "builtin:bumps", 0.53, 60.0},
                      Slide{"gyroid", "builtin:gyroid", 0.53, 60.0},
                      Slide{"cylinder", "builtin:cylinder", 0.53, 60.0},
                      Slide{"lobster_16", "paper/lobster_301x324x56_uint8.nhdr", 0.16},
                      Slide{"daisy_02", "paper/daisy_192x180x168_uint8.nhdr", 0.02},
                      Slide{"daisy_24", "paper/daisy_192x180x168_uint8.nhdr", 0.24},
                      Slide{"orange_22", "paper/orange_256x256x64_uint8.nhdr", 0.22},
                      Slide{"head_17", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.17},
                      Slide{"head_33", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.33},
                      Slide{"mr_brain_22", "medical/dicom_mr_brain_20", 0.22},
                      Slide{"lidc2_25", "medical/LIDC2.mha", 0.25}),
    [](const auto& slide) { return std::string(slide.param.name); });

}  // namespace
}  // namespace palpate
