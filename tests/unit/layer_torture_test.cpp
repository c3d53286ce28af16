// Layers under random attack, judged from positions alone as in proxy_torture_test.cpp: the proxy
// stays in the band between two layers until it pops through one of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <random>

#include "server/haptics/renderer.h"
#include "tests/support/layered.h"
#include "tests/support/made_volume.h"
#include "tests/support/scaled.h"
#include "tests/support/torture.h"

namespace palpate {
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
