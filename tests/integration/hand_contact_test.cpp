// The daemon's simulated hand goes over whole volumes for 20 000 ticks, as fast as it goes. With
// the plan that the daemon makes it finds whatever there is to feel. Without a plan it explores by
// touch alone. Whoever feels the volume never falls through it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "server/pump/pose_of.h"
#include "server/servo/servo_tick.h"
#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/guided_script.h"
#include "server/simulated_hand/simulated_device.h"
#include "server/simulated_hand/touch_planner.h"
#include "tests/support/data_folder.h"
#include "tests/support/editable_session.h"
#include "tests/support/places.h"
#include "tests/support/tick_rig.h"

namespace palpate {
namespace {

constexpr int kHandTicks = 20'000;
constexpr double kLeastContactPercent = 60.0;

// What a run on one surface was like.
struct Touch {
  double contact_percent = 0.0;
  double fastest_mm_s = 0.0;   // over 10 ms
  double scp_v_percent = 0.0;  // of the ticks in contact
  double greatest_n = 0.0, greatest_step_n = 0.0;
  int inside_ticks = 0;     // of the proxy, while nothing moves but the hand
  int unsettled_ticks = 0;  // ejecting or faulty
  bool is_capped = false, is_finite = true;
};

class HandRig : public testing::EditableSession {
 public:
  HandRig() : EditableSession({.import_program = test::kPalpateImport}) {
    inbox().ReaderRestarts();
  }

  // The hand follows the plan that the daemon makes.
  Touch Guided() {
    const Scene& scene = *inbox().Acquire();
    TouchPlanInbox plans;
    plans.Publish(std::make_unique<TouchPlan>(
        PlanTouches(scene.surface, device(), scene.settings.stiffness_n_per_mm)));
    return Follow(scene, std::make_unique<GuidedScript>(Explorer(), plans));
  }
  Touch Unguided() { return Follow(*inbox().Acquire(), Explorer()); }

 private:
  std::unique_ptr<ExploreScript> Explorer() const {
    constexpr std::uint64_t kSeed = 1;  // the daemon's
    return std::make_unique<ExploreScript>(device().workspace_min_mm, device().workspace_max_mm,
                                           kSeed);
  }

  static Touch Follow(const Scene& scene, std::unique_ptr<StylusScript> script) {
    SimulatedDevice device(std::move(script));
    device.Start();
    ServoTick tick(device);
    const auto cells = std::make_unique<CellCache>();
    Touch touch;
    std::vector<Vec3> hips_mm;
    Vec3 last_n = Vec3::Zero();
    double contacts = 0.0, with_scp_v = 0.0;
    for (int i = 0; i < kHandTicks; ++i) {
      const std::int64_t now_ns = std::int64_t{1'000'000} * i;
      TickSample sample = tick.Run(scene, TickTime{.scheduled_ns = now_ns, .started_ns = now_ns});
      AddScpV(scene, *cells, sample);
      contacts += sample.contact;
      with_scp_v += sample.contact && sample.has_scp_v;
      const Vec3 force_n(sample.force_n.data());
      touch.greatest_n = std::max(touch.greatest_n, force_n.norm());
      touch.greatest_step_n = std::max(touch.greatest_step_n, (force_n - last_n).norm());
      last_n = force_n;
      const bool is_settled =
          sample.mode == ProxyMode::kFree || sample.mode == ProxyMode::kConstrained;
      const bool is_above = scene.settings.free_side == FreeSide::kBelow
                                ? sample.density > sample.isovalue
                                : sample.density < sample.isovalue;
      touch.inside_ticks += is_settled && is_above;
      touch.unsettled_ticks += !is_settled;
      touch.is_capped = sample.capped_ticks > 0;
      touch.is_finite = touch.is_finite && IsFinite(sample);
      hips_mm.emplace_back(sample.hip_mm.data());
      constexpr std::size_t kTicksBetween = 10;
      if (hips_mm.size() > kTicksBetween) {
        const Vec3 way = hips_mm.back() - hips_mm[hips_mm.size() - 1 - kTicksBetween];
        touch.fastest_mm_s =
            std::max(touch.fastest_mm_s, way.norm() / (kTicksBetween * kTickPeriodS));
      }
    }
    touch.contact_percent = 100.0 * contacts / kHandTicks;
    touch.scp_v_percent = 100.0 * with_scp_v / std::max(contacts, 1.0);
    return touch;
  }
  static bool IsFinite(const TickSample& sample) {
    for (const auto& values : {sample.hip_mm, sample.scp_h_mm, sample.scp_h_normal, sample.scp_v_mm,
                               sample.scp_v_normal, sample.force_n}) {
      if (!Vec3(values.data()).allFinite()) return false;
    }
    return std::isfinite(sample.density);
  }
};

void Judge(const Touch& touch) {
  EXPECT_GE(touch.contact_percent, kLeastContactPercent);
  EXPECT_LE(touch.fastest_mm_s, 180.0);  // 150 but where it slips off something
  EXPECT_EQ(touch.inside_ticks, 0);
}

// --- Thin things

struct Thin {
  const char* name;
  Vec3i size;
  std::function<double(int, int, int)> value;
  FreeSide free_side = FreeSide::kBelow;
};

void PrintTo(const Thin& thin, std::ostream* out) { *out << thin.name; }

double Across(double dx, double dy, double dz = 0.0) {
  return std::sqrt(dx * dx + dy * dy + dz * dz);
}

// A tube of two voxels that winds through the volume.
double Vessel(int i, int j, int k) {
  const double x = 64.0 + 40.0 * std::sin(0.07 * k), y = 64.0 + 40.0 * std::cos(0.045 * k);
  return std::clamp(1.5 - 0.6 * Across(i - x, j - y), 0.0, 1.0);
}

double Tube(int i, int j, int) { return i / 2 == 16 && j / 2 == 16 ? 1.0 : 0.0; }

double Shell(int i, int j, int k) {
  return std::abs(Across(i - 48, j - 48, k - 48) - 40.0) < 1.0 ? 1.0 : 0.0;
}

// Single voxels at one in 4096 places, without order.
double Dust(int i, int j, int k) {
  const unsigned hash = static_cast<unsigned>(i) * 73856093u ^
                        static_cast<unsigned>(j) * 19349663u ^ static_cast<unsigned>(k) * 83492791u;
  return (hash * 2654435761u >> 8) % 4096 == 0 ? 1.0 : 0.0;
}

class ThinTest : public ::testing::TestWithParam<Thin> {};

TEST_P(ThinTest, IsTouchedMostOfTheTime) {
  const Thin& thin = GetParam();
  HandRig rig;
  const auto volume = testing::MakeVolume(thin.size, thin.value);
  rig.session().PublishVolume({.source = "made", .isovalue = 0.5, .free_side = thin.free_side},
                              volume->metadata(), volume->bricks());
  Judge(rig.Guided());
}

INSTANTIATE_TEST_SUITE_P(
    Things, ThinTest,
    ::testing::Values(Thin{"tube", {64, 64, 64}, Tube}, Thin{"vessel", {128, 128, 128}, Vessel},
                      Thin{"shell", {97, 97, 97}, Shell},
                      Thin{"shell_within", {97, 97, 97}, Shell, FreeSide::kAbove},
                      Thin{"dust", {96, 96, 96}, Dust}),
    testing::kNameOf);

// --- Whole volumes

class WholeTest : public ::testing::TestWithParam<testing::KnownSurface> {
 protected:
  // Loads the volume as the daemon does.
  void SetUp() override {
    const testing::KnownSurface& whole = GetParam();
    LoadRequest request{.source = testing::PlaceOf(whole.source)};
    if (request.source.empty()) GTEST_SKIP() << whole.source << testing::kMissing;
    (whole.is_absolute ? request.isovalue : request.normalized_isovalue) = whole.isovalue;
    rig_.session().Load(request, testing::kQuiet, testing::kNever);
  }

  HandRig rig_;
};

TEST_P(WholeTest, IsTouchedMostOfTheTime) { Judge(rig_.Guided()); }

class UnguidedTest : public WholeTest {};

TEST_P(UnguidedTest, IsFeltAndNeverFallenThrough) {
  const Touch touch = rig_.Unguided();
  EXPECT_TRUE(touch.is_finite);
  EXPECT_EQ(touch.inside_ticks, 0);
  EXPECT_EQ(touch.unsettled_ticks, 0);  // neither the isovalue nor the data change
  EXPECT_FALSE(touch.is_capped);
  EXPECT_LE(touch.greatest_step_n, testing::kMaxStepN);
  EXPECT_LE(touch.greatest_n, SimulatedDeviceSpec().max_force_n + 1e-9);
  const bool is_builtin = std::string_view(GetParam().source).starts_with("builtin:");
  EXPECT_GE(touch.contact_percent, is_builtin ? 60.0 : 40.0);
  if (is_builtin) {
    EXPECT_GE(touch.scp_v_percent, 99.0);
  }
}

using Whole = testing::KnownSurface;
using testing::kNameOf;

INSTANTIATE_TEST_SUITE_P(Builtin, WholeTest,
                         ::testing::Values(Whole{"sphere", "builtin:sphere", 0.5},
                                           Whole{"bumps", "builtin:bumps", 0.5},
                                           Whole{"gyroid", "builtin:gyroid", 0.5},
                                           Whole{"cylinder", "builtin:cylinder", 0.5}),
                         kNameOf);

constexpr const char* kTooth = "classic/tooth_103x94x161_uint8.nhdr";

// Felt by touch alone too.
constexpr Whole kMedical[] = {{"mr_brain_22", "medical/dicom_mr_brain_20", 0.22},
                              {"LIDC2_25", "medical/LIDC2.mha", 0.25}};
INSTANTIATE_TEST_SUITE_P(Paper, WholeTest, ::testing::ValuesIn(testing::kPaperSurfaces), kNameOf);
INSTANTIATE_TEST_SUITE_P(Paper, UnguidedTest, ::testing::ValuesIn(testing::kPaperSurfaces),
                         kNameOf);
INSTANTIATE_TEST_SUITE_P(Medical, WholeTest, ::testing::ValuesIn(kMedical), kNameOf);
INSTANTIATE_TEST_SUITE_P(Medical, UnguidedTest, ::testing::ValuesIn(kMedical), kNameOf);

// The volumes of the data folder at the isovalues of its README; 0.5 where it gives none.
INSTANTIATE_TEST_SUITE_P(
    Files, WholeTest,
    ::testing::Values(
        Whole{"orange_15", testing::kOrange, 0.15}, Whole{"orange_30", testing::kOrange, 0.30},
        Whole{"neuron_janelia_20", "paper/SUBST_neuron_janelia_511x512x47_uint8.nrrd", 0.20},
        Whole{"neuron_rivulet_25", "paper/SUBST_neuron_rivulet_409x415x119_uint8.nrrd", 0.25},
        Whole{"aneurism_25", "classic/aneurism_256x256x256_uint8.nrrd", 0.25},
        Whole{"teapot_16", "classic/boston_teapot_256x256x178_uint8.nrrd", 0.16},
        Whole{"hydrogen_atom_06", "classic/hydrogen_atom_128x128x128_uint8.nhdr", 0.06},
        Whole{"hydrogen_06", "classic/hydrogen_64x64x64_float32.nrrd", 0.06},
        Whole{"neghip_35", "classic/neghip_64x64x64_uint8.nhdr", 0.35},
        Whole{"fuel_20", "classic/fuel_64x64x64_uint8.nhdr", 0.20},
        Whole{"nucleon_50", "classic/nucleon_41x41x41_uint8.nhdr", 0.50},
        Whole{"bucky_50", "classic/bucky_32x32x32_uint8.nhdr", 0.50},
        Whole{"tooth_42", kTooth, 0.42}, Whole{"tooth_75", kTooth, 0.75},
        Whole{"vase_40", "classic/vase_115x101x75_uint8.nrrd", 0.40},
        Whole{"walnut_18", "classic/walnut_128x96x114_uint16.nrrd", 0.18},
        Whole{"avg152T1_38", "medical/avg152T1_RL_nifti.nii.gz", 0.38},
        Whole{"CT_pitch_30", "medical/CT_pitch.nii.gz", 0.30},
        Whole{"inia19_12", "medical/inia19-t1-brain.nii.gz", 0.12},
        Whole{"anatomical_50", "medical/nibabel_anatomical_bigendian.nii", 0.5},
        Whole{"example_nifti2_50", "medical/nibabel_example_nifti2.nii.gz", 0.5},
        Whole{"HeadMRVolume_16", "medical/HeadMRVolume.mhd", 0.16},
        Whole{"viscous_t010", "timeseries/viscous_64x64x64_float32_t010.nrrd", 35.0, true},
        Whole{"viscous_t050", "timeseries/viscous_64x64x64_float32_t050.nrrd", 35.0, true},
        Whole{"viscous_t090", "timeseries/viscous_64x64x64_float32_t090.nrrd", 35.0, true},
        Whole{"isabel_t30", "timeseries/isabel_125x125x25_float64_t30.nrrd", 20.0, true},
        Whole{"functional_50", "timeseries/nibabel_functional.nii", 0.5}),
    kNameOf);

// Whoever names no isovalue feels something.
class ChosenTest : public ::testing::TestWithParam<const char*> {};

TEST_P(ChosenTest, IsTouchedMostOfTheTime) {
  const std::string source = testing::PlaceOf(GetParam());
  if (source.empty()) GTEST_SKIP() << GetParam() << testing::kMissing;
  HandRig rig;
  const VolumeState state =
      rig.session().Load({.source = source}, testing::kQuiet, testing::kNever);
  const Touch touch = rig.Guided();
  std::printf("| %s | %s %g | %.0f %% |\n", GetParam(),
              state.values->suggested.front().name.c_str(), state.isovalue, touch.contact_percent);
  Judge(touch);
}

std::string NameOfFile(const ::testing::TestParamInfo<const char*>& info) {
  std::string name = info.param;
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return !std::isalnum(c); }, '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(
    Files, ChosenTest,
    ::testing::Values(
        "classic/aneurism_256x256x256_uint8.nrrd", "classic/boston_teapot_256x256x178_uint8.nrrd",
        "classic/bucky_32x32x32_uint8.nhdr", "classic/fuel_64x64x64_uint8.nhdr",
        "classic/hydrogen_64x64x64_float32.nrrd", "classic/hydrogen_atom_128x128x128_uint8.nhdr",
        "classic/neghip_64x64x64_uint8.nhdr", "classic/nucleon_41x41x41_uint8.nhdr", kTooth,
        "classic/vase_115x101x75_uint8.nrrd", "classic/walnut_128x96x114_uint16.nrrd",
        "medical/CT_pitch.nii.gz", "medical/HeadMRVolume.mhd", "medical/LIDC2.mha",
        "medical/avg152T1_RL_nifti.nii.gz", "medical/dicom_mr_brain_20",
        "medical/inia19-t1-brain.nii.gz", "medical/nibabel_anatomical_bigendian.nii",
        "medical/nibabel_example_nifti2.nii.gz",
        "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd",
        "paper/SUBST_neuron_janelia_511x512x47_uint8.nrrd",
        "paper/SUBST_neuron_rivulet_409x415x119_uint8.nrrd", "paper/daisy_192x180x168_uint8.nhdr",
        "paper/lobster_301x324x56_uint8.nhdr", testing::kOrange,
        "timeseries/isabel_125x125x25_float64_t30.nrrd", "timeseries/nibabel_functional.nii",
        "timeseries/viscous_64x64x64_float32_t010.nrrd",
        "timeseries/viscous_64x64x64_float32_t050.nrrd",
        "timeseries/viscous_64x64x64_float32_t090.nrrd"),
    NameOfFile);

INSTANTIATE_TEST_SUITE_P(Builtin, UnguidedTest,
                         ::testing::Values(Whole{"sphere", "builtin:sphere", 0.53, true},
                                           Whole{"bumps", "builtin:bumps", 0.53, true},
                                           Whole{"gyroid", "builtin:gyroid", 0.53, true},
                                           Whole{"cylinder", "builtin:cylinder", 0.53, true}),
                         kNameOf);

}  // namespace
}  // namespace palpate
