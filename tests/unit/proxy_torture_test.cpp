// The proxy under random attack, also in layers. Every tick is judged from positions alone: where
// the proxy is, whether it can have come there, and whether it may rest there.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <random>

#include "server/haptics/proxy.h"
#include "server/haptics/renderer.h"
#include "server/lab/fresh_cells.h"
#include "server/volume/snapshot/ball_field.h"
#include "tests/support/layered.h"
#include "tests/support/made_volume.h"
#include "tests/support/path_judge.h"
#include "tests/support/scaled.h"
#include "tests/support/torture.h"

namespace palpate {

namespace {

using testing::ApproachLeft;
using testing::HasRange;
using testing::kDensityTolerance;
using testing::MakeVolume;
using testing::MoveHip;
using testing::PathJudge;
using testing::RandomSurface;
using testing::RandomVolume;

constexpr double kFarMm = 1e9;  // an eject limit that never bites

struct Torture {
  long moves = 0, steps = 0, fall_throughs = 0, unrested = 0, capped = 0, contacts = 0,
       misplaced = 0, jumps = 0;

  void ExpectSound() const {
    EXPECT_GT(contacts, steps / 20);
    for (const long fault : {fall_throughs, misplaced, jumps, unrested, capped})
      EXPECT_EQ(fault, 0);
  }
  void Print(int levels) const {
    std::printf(
        "levels %3d: %ld steps, %ld moves, %ld in contact, fall-throughs %ld, misplaced %ld, "
        "jumps %ld, not at rest %ld, capped %ld\n",
        levels, steps, moves, contacts, fall_throughs, misplaced, jumps, unrested, capped);
  }
};

// `origin_I`: around which the HIP moves.
void TortureGrid(std::mt19937_64& random, const VolumeSnapshot& volume, int refinement, int steps,
                 Torture& result, const Vec3i& origin_I = Vec3i::Zero()) {
  if (!HasRange(volume)) return;
  const HapticSurface surface = RandomSurface(random, volume, refinement, origin_I + Vec3i::Ones());
  const auto at = [&](const Vec3& p_I) {
    return surface.X_DI.Apply(p_I + origin_I.cast<double>());
  };
  static CellCache cache;
  cache = CellCache();
  PathJudge judge(surface);
  Proxy proxy;
  Vec3 hip_I = Vec3::Constant(-3.0);
  Vec3 last_mm = StepProxy(surface, at(hip_I), kFarMm, proxy, cache).p_DH_mm;
  bool has_last = !proxy.buried;
  for (int n = 0; n < steps; ++n) {
    MoveHip(random, hip_I);
    const Vec3 hip_mm = at(hip_I);
    const ProxyStep step = StepProxy(surface, hip_mm, kFarMm, proxy, cache);
    ++result.steps;
    result.moves += step.moves;
    result.capped += step.capped;
    result.contacts += step.mode == ProxyMode::kConstrained;
    // From above τ, the stylus is out of reach of the surface where it starts.
    if (proxy.buried) {
      has_last = false;
      continue;
    }
    const bool outside = proxy.place.kind == Place::Kind::kOutside;
    result.fall_throughs += !outside && surface.sign() * step.density > surface.isovalue;
    const double density = judge.HoldersAt(step.p_DH_mm).Density();
    // Also where it is no number, in a gap between cells.
    result.misplaced += !(judge.cells().Inside(density) <= kDensityTolerance);
    // One that was buried is put at the HIP.
    result.misplaced += has_last && step.p_DH_mm != PlacePosition(surface, proxy.place, cache);
    result.jumps += has_last && !judge.MayHaveCome(last_mm, step.p_DH_mm, hip_mm);
    result.unrested += !step.capped && ApproachLeft(judge, step.p_DH_mm, hip_mm) > 0.0;
    last_mm = step.p_DH_mm;
    has_last = true;
  }
}

class ProxyTorture : public ::testing::TestWithParam<int> {};

TEST_P(ProxyTorture, NeverFallsThroughAndAlwaysRests) {
  const int refinement = GetParam();
  // The judge takes its time on fine lattices.
  const int steps = refinement <= 2 ? 3000 : 1500;
  const int grids = std::max(6, test::Scaled(refinement == 1 ? 15 : 6));
  std::mt19937_64 random(6);
  for (int levels : {0, 256, 16, 4, 2, 1}) {
    Torture result;
    for (int n = 0; n < grids; ++n) {
      TortureGrid(random, *RandomVolume(random, levels), refinement, steps, result);
    }
    result.Print(levels);
    result.ExpectSound();
  }
}

// Plateaus as large as the ball, at values of the volume.
TEST_P(ProxyTorture, TheFieldOfABallIsAVolumeLikeOthers) {
  const int grids = std::max(3, test::Scaled(6));
  std::mt19937_64 random(8);
  for (int levels : {0, 16, 2}) {
    Torture result;
    for (int n = 0; n < grids; ++n) {
      const BallField field(
          {.radius_mm = 0.5 + 2.5 * static_cast<double>(n) / grids, .is_least = n % 3 == 2});
      const auto volume = field.Of(*RandomVolume(random, levels), 1, [](double) {});
      TortureGrid(random, *volume, GetParam(), 1500, result, field.margin());
    }
    result.Print(levels);
    result.ExpectSound();
  }
}

// τ and the side change under the proxy, again and again: it is moved out, or buried,
// and never left inside.
struct Ejections {
  long steps = 0, ejecting = 0, buried = 0, inside = 0;
};

void ChangeGrid(std::mt19937_64& random, int levels, int refinement, int steps, Ejections& result) {
  std::uniform_real_distribution<double> uniform;
  const auto volume = RandomVolume(random, levels);
  if (!HasRange(*volume)) return;
  const auto surface_of = [&](double isovalue, FreeSide side) {
    return MakeHapticSurface(*volume, AffineMap{}, isovalue, DecompositionMethod::kTpbcc, 1, side,
                             refinement);
  };
  static CellCache cache;
  cache = CellCache();
  Proxy proxy;
  Vec3 hip = Vec3::Constant(2.0);
  double isovalue = 0.5;
  FreeSide side = FreeSide::kBelow;
  // The densities are those of every τ and either side.
  lab::FreshCells cells(surface_of(isovalue, side));
  for (int n = 0; n < steps; ++n) {
    if (uniform(random) < 0.2) isovalue = uniform(random);
    if (uniform(random) < 0.05) {
      isovalue = volume->StoredCell(Vec3i(1, 2, 1))[static_cast<std::size_t>(uniform(random) * 8)];
    }
    if (uniform(random) < 0.1) {
      side = side == FreeSide::kBelow ? FreeSide::kAbove : FreeSide::kBelow;
    }
    const Vec3 r(uniform(random), uniform(random), uniform(random));
    hip = uniform(random) < 0.05 ? Vec3(6.0 * r - Vec3::Ones())
                                 : Vec3(hip + 0.4 * (r - Vec3::Constant(0.5)));
    hip = hip.cwiseMax(-1.0).cwiseMin(5.0);
    const HapticSurface surface = surface_of(isovalue, side);
    const ProxyStep step = StepProxy(surface, hip, 4.0, proxy, cache);
    ++result.steps;
    result.ejecting += step.mode == ProxyMode::kEjecting;
    result.buried += proxy.buried;
    if (proxy.buried) continue;
    const bool outside = proxy.place.kind == Place::Kind::kOutside;
    const double density = cells.HoldersOf(surface.X_LD.Apply(step.p_DH_mm)).Density();
    result.inside += !(surface.sign() * density - surface.isovalue <= kDensityTolerance);
    result.inside += !outside && surface.sign() * step.density > surface.isovalue;
  }
}

TEST_P(ProxyTorture, ChangesOfIsovalueAndSideNeverLeaveItInside) {
  const int grids = std::max(10, test::Scaled(GetParam() == 1 ? 30 : 10));
  std::mt19937_64 random(7);
  for (int levels : {2, 3, 4, 16, 0}) {
    Ejections result;
    for (int n = 0; n < grids; ++n) ChangeGrid(random, levels, GetParam(), 1000, result);
    std::printf("levels %2d: %ld steps, %ld ejecting, %ld buried, %ld inside\n", levels,
                result.steps, result.ejecting, result.buried, result.inside);
    EXPECT_GT(result.ejecting, result.steps / 100);
    EXPECT_EQ(result.inside, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Refinements, ProxyTorture, ::testing::Values(1, 2, 3, 4));

// --- The judge itself, on ways that no proxy may take

// Material from x = 2 to x = 6 within 9³ voxels; `hole`: with a way through along x.
std::shared_ptr<const VolumeSnapshot> Slab(bool hole = false) {
  return MakeVolume(Vec3i::Constant(9), [=](int i, int j, int k) {
    const bool solid = i >= 2 && i <= 6 && !(hole && j == 4 && k == 4);
    return solid ? 1.0 : 0.0;
  });
}

HapticSurface SurfaceOf(const VolumeSnapshot& volume, FreeSide side = FreeSide::kBelow) {
  const Mat3 mirror = Vec3(1.0, -1.0, 1.0).asDiagonal();
  return MakeHapticSurface(volume, {0.1 * mirror, Vec3(3.0, -7.0, 11.0)}, 0.5,
                           DecompositionMethod::kTpbcc, 1, side);
}

// Positions in voxels.
bool MayHaveCome(const HapticSurface& surface, const Vec3& from, const Vec3& to, const Vec3& hip) {
  return PathJudge(surface).MayHaveCome(surface.X_DI.Apply(from), surface.X_DI.Apply(to),
                                        surface.X_DI.Apply(hip));
}

TEST(PathJudge, AJumpThroughTheWholeVolumeIsNoWay) {
  const auto slab = Slab(), with_hole = Slab(true);
  const Vec3 before(-2.5, 4, 4), behind(10.5, 4, 4);
  EXPECT_FALSE(MayHaveCome(SurfaceOf(*slab), before, behind, behind));
  EXPECT_TRUE(MayHaveCome(SurfaceOf(*with_hole), before, behind, behind));
  // Beside the hole: it is held before it comes there.
  EXPECT_FALSE(MayHaveCome(SurfaceOf(*with_hole), Vec3(-2.5, 2, 2), behind, Vec3(10.5, 2, 2)));
  // The slab ends with the lattice: past it all is free.
  EXPECT_TRUE(
      MayHaveCome(SurfaceOf(*slab), Vec3(-2.5, 4, 9.5), Vec3(10.5, 4, 9.5), Vec3(10.5, 4, 9.5)));
  // Met near its end, and slid along: each step on this way is nearer to the HIP.
  EXPECT_TRUE(
      MayHaveCome(SurfaceOf(*slab), Vec3(-2.5, 4, 7), Vec3(10.5, 4, 9.5), Vec3(10.5, 4, 9.5)));
}

TEST(PathJudge, AJumpThroughAWallWithinTheVolumeIsNoWay) {
  const auto wall = MakeVolume(Vec3i::Constant(9), [](int i, int, int) { return i == 4; });
  const HapticSurface surface = SurfaceOf(*wall);
  EXPECT_FALSE(MayHaveCome(surface, Vec3(3, 4, 4), Vec3(5, 4, 4), Vec3(5, 4, 4)));
  EXPECT_FALSE(MayHaveCome(surface, Vec3(3.5, 4, 4), Vec3(4.5, 4, 4), Vec3(4.4, 4, 4)));
  EXPECT_TRUE(MayHaveCome(surface, Vec3(3, 4, 4), Vec3(3.5, 4.1, 4), Vec3(4, 4.1, 4)));
  // On the other side the wall is what is free.
  EXPECT_FALSE(MayHaveCome(SurfaceOf(*wall, FreeSide::kAbove), Vec3(4, 4, 4), Vec3(9.5, 4, 4),
                           Vec3(9.5, 4, 4)));
  EXPECT_TRUE(
      MayHaveCome(SurfaceOf(*wall, FreeSide::kAbove), Vec3(4, 2, 2), Vec3(4, 6, 6), Vec3(4, 6, 6)));
}

TEST(PathJudge, AWayThatLeadsAwayFromTheHipIsNone) {
  const auto slab = Slab();
  const HapticSurface surface = SurfaceOf(*slab);
  // Held at x = 1.5, and found on another place of the same face, farther away.
  EXPECT_TRUE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(1.5, 4, 4), Vec3(3, 4, 4)));
  EXPECT_FALSE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(1.5, 7, 7), Vec3(3, 4, 4)));
  // In free space nothing but the HIP is where it goes.
  EXPECT_TRUE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(0, 7, 7), Vec3(0, 7, 7)));
  EXPECT_FALSE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(0, 6, 6), Vec3(0, 7, 7)));
}

}  // namespace

namespace {

using testing::ApproachLeft;
using testing::BandOf;
using testing::kDensityTolerance;
using testing::MoveHip;
using testing::PathJudge;

constexpr double kTickS = 1e-3;
double Random(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

// Random values on 6³ lattices of `levels` values; 0: continuous.
std::shared_ptr<const VolumeSnapshot> LayeredVolume(std::mt19937_64& random, int levels) {
  return testing::MakeVolume(Vec3i::Constant(6), [&](int i, int j, int k) {
    if (i + j + k == 0) return 0.0;
    if (i + j + k == 15) return 1.0;
    const double value = Random(random, 0.0, 1.0);
    return levels == 0 ? value : std::floor(value * levels) / std::max(1, levels - 1);
  });
}

// Three layers a few gaps apart, at values of the volume too.
HapticLayers RandomLayers(std::mt19937_64& random, int levels, double gap) {
  HapticLayers layers;
  double isovalue = Random(random, 0.1, 0.6);
  if (levels > 1 && random() % 2 == 0) {
    isovalue = static_cast<double>(random() % static_cast<unsigned>(levels)) / levels;
  }
  for (int id = 1; id <= 3; ++id) {
    layers.layer[static_cast<std::size_t>(layers.count++)] = {
        .id = id,
        .isovalue = isovalue,
        .stiffness_n_per_mm = Random(random, 0.1, 2.0),
        .pop_in_n = random() % 8 == 0 ? 0.0 : Random(random, 0.01, 0.5),
        .pop_out_n = random() % 8 == 0 ? 0.0 : Random(random, 0.01, 0.5)};
    isovalue += gap * Random(random, 1.0, 2.0);
  }
  return layers;
}

HapticSurface LayeredSurface(std::mt19937_64& random, const VolumeSnapshot& volume,
                             int refinement) {
  Mat3 axes = Mat3::Identity();
  if (random() % 2 == 0) axes << 1.0, 0.3, 0.0, 0.0, -0.7, 0.1, 0.2, 0.0, 2.5;
  return MakeHapticSurface(volume, {axes, Vec3(3.0, -7.0, 11.0)}, 0.5, DecompositionMethod::kTpbcc,
                           1, FreeSide::kBelow, refinement);
}

struct LayerTally {
  long steps = 0, pops = 0, contacts = 0, deepest = 0, capped = 0, ejecting_pops = 0;
  long fall_throughs = 0, misplaced = 0, jumps = 0, unrested = 0, other_bands = 0;

  void Print(const char* what, int levels) const {
    std::printf(
        "%s, levels %3d: %ld steps, %ld pops, %ld in contact, %ld behind all, fall-throughs %ld, "
        "misplaced %ld, jumps %ld, not at rest %ld, capped %ld\n",
        what, levels, steps, pops, contacts, deepest, fall_throughs, misplaced, jumps, unrested,
        capped);
  }
  void ExpectSound() const {
    EXPECT_GT(pops, steps / 200);
    EXPECT_GT(contacts, steps / 20);
    for (const long fault :
         {fall_throughs, misplaced, jumps, unrested, other_bands, capped, ejecting_pops}) {
      EXPECT_EQ(fault, 0);
    }
  }
};

void TortureLayers(std::mt19937_64& random, int levels, int refinement, double gap, int steps,
                   LayerTally& result) {
  const auto volume = LayeredVolume(random, levels);
  const HapticLayers layers = RandomLayers(random, levels, gap);
  HapticSurface surface = LayeredSurface(random, *volume, refinement);
  surface.layers = &layers;
  HapticSettings settings{};
  const bool has_friction = random() % 4 == 0;
  settings.passivity_control = random() % 4 == 0;
  HapticLayers rough = layers;
  for (HapticLayer& layer : rough.layer) layer.dynamic_friction = layer.static_friction = 0.4;
  if (has_friction) surface.layers = &rough;
  auto state = std::make_unique<RendererState>();
  std::map<int, std::unique_ptr<PathJudge>> judges;  // by the layers passed
  Vec3 hip_I = Vec3::Constant(-2.5), last_mm = surface.X_DI.Apply(hip_I);
  int passed = 0;
  bool has_last = false;
  for (int n = 0; n < steps; ++n) {
    MoveHip(random, hip_I);
    const Vec3 hip_mm = surface.X_DI.Apply(hip_I);
    const HapticOutput output = StepRenderer(surface, settings, hip_mm, kTickS, *state);
    const Vec3& p_mm = output.proxy.p_DH_mm;
    ++result.steps;
    result.pops += output.popped;
    result.contacts += output.contact_layer != 0;
    result.deepest += output.layers_passed == layers.count;
    result.capped += output.proxy.capped;
    result.ejecting_pops += output.popped && output.proxy.mode == ProxyMode::kEjecting;
    result.other_bands += std::abs(output.layers_passed - passed) != output.popped;
    has_last = has_last && !output.popped;
    passed = output.layers_passed;
    auto& judge = judges[passed];
    if (!judge) judge = std::make_unique<PathJudge>(BandOf(surface, passed));
    const bool outside = state->proxy.place.kind == Place::Kind::kOutside;
    result.fall_throughs += !outside && !BandOf(surface, passed).Holds(output.proxy.density);
    // Also where it is no number, in a gap between cells.
    const double inside = judge->cells().Inside(judge->HoldersAt(p_mm).Density());
    result.misplaced += !(inside <= kDensityTolerance);
    if (!has_friction) {
      result.jumps += has_last && !judge->MayHaveCome(last_mm, p_mm, hip_mm);
      result.unrested += !output.proxy.capped && ApproachLeft(*judge, p_mm, hip_mm) > 0.0;
    }
    last_mm = p_mm;
    has_last = true;
  }
}

class LayerTorture : public ::testing::TestWithParam<int> {};

TEST_P(LayerTorture, OnlyAPopLeadsOutOfABand) {
  const int refinement = GetParam();
  const int grids = std::max(1, test::Scaled(refinement == 1 ? 3 : 1));
  std::mt19937_64 random(11);
  for (const int levels : {0, 256, 16, 4, 2}) {
    LayerTally result;
    for (const double gap : {0.2, 0.02, 1e-4, kLeastLayerGap}) {
      for (int n = 0; n < grids; ++n) {
        TortureLayers(random, levels, refinement, gap, 2000, result);
      }
    }
    result.Print("fixed", levels);
    result.ExpectSound();
  }
}

// The first layers in order that are in `ids` and can be passed: how many a stylus is behind that
// had passed those.
int PrefixOf(const HapticLayers& layers, const std::array<bool, kMaxLayers + 1>& ids) {
  int count = 0;
  for (const HapticLayer& layer : layers.all()) {
    if (!ids[static_cast<std::size_t>(layer.id)] || !(layer.pop_in_n > 0.0)) break;
    ++count;
  }
  return count;
}

// One of the layers gets another isovalue, appears or disappears.
HapticLayers Changed(std::mt19937_64& random, HapticLayers layers) {
  const int at = static_cast<int>(random() % 3);
  const auto end = [&] { return layers.layer.begin() + layers.count; };
  if (layers.count == 3 && random() % 4 == 0) {
    std::copy(layers.layer.begin() + at + 1, end(), layers.layer.begin() + at);
    --layers.count;
  } else if (layers.count == 3) {
    layers.layer[static_cast<std::size_t>(at)].isovalue = Random(random, 0.05, 0.95);
  } else {
    int id = 1;
    while (std::any_of(layers.layer.begin(), end(), [&](auto& layer) { return layer.id == id; })) {
      ++id;
    }
    layers.layer[2] = {
        .id = id, .isovalue = Random(random, 0.05, 0.95), .pop_in_n = 0.2, .pop_out_n = 0.1};
    layers.count = 3;
  }
  std::sort(layers.layer.begin(), end(),
            [](const auto& a, const auto& b) { return a.isovalue < b.isovalue; });
  for (int n = 1; n < layers.count; ++n) {
    const auto i = static_cast<std::size_t>(n);
    layers.layer[i].isovalue =
        std::max(layers.layer[i].isovalue, layers.layer[i - 1].isovalue + 2.0 * kLeastLayerGap);
  }
  return layers;
}

// Layers swap, appear and disappear under the stylus: it is never deeper than the layers that it
// had passed, and never left beyond a bound.
void ChangeLayers(std::mt19937_64& random, int levels, int refinement, bool glides, int steps,
                  LayerTally& result) {
  const auto volume = LayeredVolume(random, levels);
  HapticLayers layers = RandomLayers(random, 0, 0.1);
  HapticSurface surface = LayeredSurface(random, *volume, refinement);
  surface.layers = &layers;
  auto state = std::make_unique<RendererState>();
  state->glides = glides;
  lab::FreshCells cells(surface);  // the densities are those of every layer
  std::array<bool, kMaxLayers + 1> ids{};
  Vec3 hip_I = Vec3::Constant(-2.5);
  for (int n = 0; n < steps; ++n) {
    if (n % 50 == 49) layers = Changed(random, layers);
    MoveHip(random, hip_I);
    const Vec3 hip_mm = surface.X_DI.Apply(hip_I);
    const int before = PrefixOf(layers, ids);
    const HapticOutput output = StepRenderer(surface, {}, hip_mm, kTickS, *state);
    const ProxyStep& proxy = output.proxy;
    const int passed = output.layers_passed;
    ++result.steps;
    result.pops += output.popped;
    result.contacts += output.contact_layer != 0;
    result.deepest += passed == layers.count;
    // A buried stylus finds itself where it is.
    const bool found = (proxy.p_DH_mm - hip_mm).norm() < 1e-9;
    result.other_bands +=
        std::abs(passed - before) != output.popped && !found && proxy.mode != ProxyMode::kInside;
    ids = {};
    for (int k = 0; k < passed; ++k) {
      ids[static_cast<std::size_t>(layers.layer[static_cast<std::size_t>(k)].id)] = true;
    }
    if (state->proxy.buried) continue;
    // While it glides, a bound is between what it was and what was asked for.
    HapticSurface band = BandOf(surface, passed);
    if (glides) band.lower = state->proxy.lower, band.isovalue = state->proxy.isovalue;
    result.fall_throughs +=
        state->proxy.place.kind != Place::Kind::kOutside && !band.Holds(proxy.density);
    const double density = cells.HoldersOf(surface.X_LD.Apply(proxy.p_DH_mm)).Density();
    result.misplaced += !(density <= band.isovalue + kDensityTolerance &&
                          density >= band.lower - kDensityTolerance);
  }
}

TEST_P(LayerTorture, ChangesNeverLeaveItBeyondABound) {
  const int grids = std::max(2, test::Scaled(GetParam() == 1 ? 10 : 4));
  std::mt19937_64 random(12);
  for (const bool glides : {false, true}) {
    for (const int levels : {0, 16, 2}) {
      LayerTally result;
      for (int n = 0; n < grids; ++n) {
        ChangeLayers(random, levels, GetParam(), glides, 2000, result);
      }
      result.Print(glides ? "gliding" : "changed", levels);
      result.ExpectSound();
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Refinements, LayerTorture, ::testing::Values(1, 2, 3));

}  // namespace

}  // namespace palpate
