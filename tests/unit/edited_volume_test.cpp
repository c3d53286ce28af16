// Voxels change under and around the proxy.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "server/haptics/renderer.h"
#include "tests/support/made_volume.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

constexpr double kDtS = 1e-3;
constexpr int kEdge = 32;
constexpr double kIsovalue = 0.5;
const auto kSeeds = static_cast<std::uint64_t>(test::Scaled(20));
const Vec3 kCentre = Vec3::Constant((kEdge - 1) / 2.0);

std::shared_ptr<const VolumeSnapshot> Ball() {
  return testing::MakeVolume(Vec3i::Constant(kEdge), [](int i, int j, int k) {
    if (i + j + k == 0) return 0.0;
    if (i + j + k == 3 * (kEdge - 1)) return 1.0;
    return std::clamp(0.5 - ((Vec3(i, j, k) - kCentre).norm() - 11.0) / 8.0, 0.0, 1.0);
  });
}

class Editor {
 public:
  explicit Editor(std::uint64_t seed) : random_(seed) {}

  // Other values in a box of up to 6³ voxels; all bricks that it touches are new.
  std::shared_ptr<const VolumeSnapshot> Edit(const VolumeSnapshot& volume, const Vec3i& low) {
    const int edge = std::uniform_int_distribution<int>(1, 6)(random_);
    const Vec3i high = (low + Vec3i::Constant(edge)).cwiseMin(kEdge);
    const bool noise = random_() % 2 == 0;
    const auto flat = static_cast<float>(Share());
    std::vector<BrickChange> changes;
    for (int a = low.x() >> 3; a <= (high.x() - 1) >> 3; ++a) {
      for (int b = low.y() >> 3; b <= (high.y() - 1) >> 3; ++b) {
        for (int c = low.z() >> 3; c <= (high.z() - 1) >> 3; ++c) {
          Brick brick = volume.bricks().At({a, b, c})->Floats();
          for (int n = 0; n < kBrickVoxels; ++n) {
            const Vec3i p = Vec3i(a, b, c) * kBrickEdge + Vec3i(n >> 6, n >> 3 & 7, n & 7);
            if ((p.array() < low.array()).any() || (p.array() >= high.array()).any()) continue;
            brick[n] = noise ? static_cast<float>(Share()) : flat;
          }
          changes.push_back({{a, b, c}, Leaf::Of(LeafType::kFloat, brick)});
        }
      }
    }
    const std::uint64_t revision = volume.revision() + 1;
    return std::make_shared<VolumeSnapshot>(volume.metadata(),
                                            volume.bricks().With(changes, revision), revision, 1);
  }

  double Share() { return std::uniform_real_distribution<double>(0.0, 1.0)(random_); }
  Vec3i Corner() {
    std::uniform_int_distribution<int> any(0, kEdge - 1);
    return {any(random_), any(random_), any(random_)};
  }
  std::mt19937_64& random() { return random_; }

 private:
  std::mt19937_64 random_;
};

HapticSurface SurfaceOf(const VolumeSnapshot& volume) {
  return MakeHapticSurface(volume, AffineMap{}, kIsovalue, DecompositionMethod::kTpbcc, 1);
}

TEST(EditedVolume, TheCacheChangesNothingAndNoEditLeavesTheProxyInside) {
  const HapticSettings settings{.stiffness_n_per_mm = 0.5};
  long contacts = 0, ejecting = 0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    Editor editor(seed);
    auto volume = Ball();
    auto lasting = std::make_unique<RendererState>(), fresh = std::make_unique<RendererState>();
    Vec3 hip = kCentre + Vec3(15, 0, 0);
    for (int n = 0; n < 1500; ++n) {
      if (editor.Share() < 0.3) {
        // Every other one where the proxy is.
        const Vec3 near = fresh->proxy.p_DH_mm - Vec3::Constant(2.0);
        const Vec3i low =
            n % 2 == 0 ? editor.Corner() : Vec3i(near.cast<int>().cwiseMax(0).cwiseMin(kEdge - 1));
        volume = editor.Edit(*volume, low);
      }
      const Vec3 aim = kCentre + 10.0 * Vec3(std::cos(n * 7e-3), std::sin(n * 5e-3), 0.3);
      hip += 0.1 * (aim - hip) + 0.1 * Vec3(editor.Share(), editor.Share(), editor.Share());
      const HapticSurface surface = SurfaceOf(*volume);
      fresh->cache = CellCache{};
      const HapticOutput a = StepRenderer(surface, settings, hip, kDtS, *lasting);
      const HapticOutput b = StepRenderer(surface, settings, hip, kDtS, *fresh);
      ASSERT_EQ(a.proxy.p_DH_mm, b.proxy.p_DH_mm) << seed << ' ' << n;
      ASSERT_EQ(a.force_D_n, b.force_D_n) << seed << ' ' << n;
      ASSERT_EQ(a.proxy.moves, b.proxy.moves) << seed << ' ' << n;
      ASSERT_EQ(a.proxy.mode, b.proxy.mode) << seed << ' ' << n;
      if (a.proxy.mode == ProxyMode::kFree || a.proxy.mode == ProxyMode::kConstrained) {
        ASSERT_LE(a.proxy.density, kIsovalue) << seed << ' ' << n;
        // Of the voxels themselves, found anew.
        double density = 0.0;
        PlaceAt(surface, a.proxy.p_DH_mm, fresh->cache, density);
        ASSERT_LE(density, kIsovalue + 1e-9) << seed << ' ' << n;
      }
      contacts += a.proxy.mode == ProxyMode::kConstrained;
      ejecting += a.proxy.mode == ProxyMode::kEjecting;
    }
  }
  EXPECT_GT(contacts, 250 * static_cast<long>(kSeeds));
  EXPECT_GT(ejecting, 5 * static_cast<long>(kSeeds));
}

TEST(EditedVolume, AnEditElsewhereIsNotFelt) {
  const HapticSettings settings{
      .stiffness_n_per_mm = 0.5, .static_friction = 0.4, .dynamic_friction = 0.3};
  Editor editor(7);
  auto edited = Ball();
  const auto still = Ball();
  auto a = std::make_unique<RendererState>(), b = std::make_unique<RendererState>();
  for (int n = 0; n < 3000; ++n) {
    // Contact on the side of high x, edits in the bricks of low x.
    if (n % 3 == 0) {
      Vec3i low = editor.Corner();
      low.x() %= 9;
      edited = editor.Edit(*edited, low);
    }
    const double t = n * 2e-3;
    const Vec3 hip = kCentre + Vec3(10.0 - 2.0 * std::cos(t), 3.0 * std::sin(3.0 * t), 2.0);
    const HapticOutput with = StepRenderer(SurfaceOf(*edited), settings, hip, kDtS, *a);
    const HapticOutput without = StepRenderer(SurfaceOf(*still), settings, hip, kDtS, *b);
    ASSERT_EQ(with.proxy.p_DH_mm, without.proxy.p_DH_mm) << n;
    ASSERT_EQ(with.force_D_n, without.force_D_n) << n;
    ASSERT_EQ(with.proxy.mode, without.proxy.mode) << n;
  }
}

TEST(EditedVolume, ACellKnowsWhenItMayHaveChanged) {
  const auto first = Ball();
  Brick brick = first->bricks().At({1, 2, 3})->Floats();
  brick[0] = 0.25f;
  const std::vector<BrickChange> changes = {{Vec3i(1, 2, 3), Leaf::Of(LeafType::kFloat, brick)}};
  const VolumeSnapshot second(first->metadata(), first->bricks().With(changes, 9), 9, 1);
  const auto touches = [](int v, int low) { return v >= low - 1 && v < low + 8; };
  for (int i = -1; i < kEdge; ++i) {
    for (int j = -1; j < kEdge; ++j) {
      for (int k = -1; k < kEdge; ++k) {
        const bool touched = touches(i, 8) && touches(j, 16) && touches(k, 24);
        ASSERT_EQ(second.CellRevision({i, j, k}), touched ? 9u : 1u) << i << ' ' << j << ' ' << k;
      }
    }
  }
  EXPECT_EQ(second.CellRevision({-2, 0, 0}), 0u);
  EXPECT_EQ(second.CellRevision({0, kEdge, 0}), 0u);
}

}  // namespace
}  // namespace palpate
