// The volume on the graphics card follows edits, and pictures are drawn when something
// changed and only then.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "tests/support/cast_rig.h"

namespace palpate::view {
namespace {

using testing::CastRig;
using testing::Look;
using testing::MakeVoxels;
using testing::Picture;
using testing::VoxelArray;

constexpr ImageSize kCastSize{120, 90};

// No multiple of a brick along any axis.
VoxelArray CastWaves() {
  return MakeVoxels({30, 25, 33}, [](int i, int j, int k) {
    return static_cast<float>(std::sin(0.4 * i) + std::sin(0.5 * j) * std::cos(0.3 * k));
  });
}

CastRequest RequestFor(const VoxelArray& voxels) {
  const Look look{Vec3(45.0, 40.0, 70.0), Vec3(15.0, 12.0, 16.0)};
  CastRequest request = testing::RequestFor(look, {}, voxels.size, kCastSize);
  request.surface.isovalue = 0.3;
  request.surface.veil.shown = true;
  request.surface.veil.isovalue = -0.5;
  return request;
}

// Bricks of `voxels`, as an edit sends them.
client::VolumeUpdate Edit(const VoxelArray& voxels, const std::vector<Vec3i>& bricks) {
  client::VolumeUpdate update = testing::WholeVolume(voxels, {});
  const Vec3i counts = update.lattice->BrickCounts();
  update.all = false;
  update.bricks.clear();
  for (const Vec3i& brick : bricks) {
    update.bricks.push_back({BrickNumber(brick, counts), testing::BrickOf(voxels, brick)});
  }
  return update;
}

class VolumeOnTheCard : public ::testing::Test {
 protected:
  OffscreenContext context_;
};

// What the card holds, whatever the volume is.
VoxelArray Held(const VolumeTexture& texture, float background) {
  const Vec3i padded = texture.size() + Vec3i::Constant(2);
  std::vector<float> texels(static_cast<std::size_t>(padded.prod()));
  glBindTexture(GL_TEXTURE_3D, texture.voxels());
  glGetTexImage(GL_TEXTURE_3D, 0, GL_RED, GL_FLOAT, texels.data());
  VoxelArray held = MakeVoxels(texture.size(), [&](int i, int j, int k) {
    const std::size_t row = static_cast<std::size_t>(i + 1) * padded.y() + j + 1;
    return texels[row * padded.z() + k + 1] / texture.scale().Scaled(1.0f);
  });
  held.background = background;
  return held;
}

std::vector<float> HeldRanges(const VolumeTexture& texture) {
  std::vector<float> ranges(2 * static_cast<std::size_t>(texture.cell_brick_count().prod()));
  glBindTexture(GL_TEXTURE_3D, texture.ranges());
  glGetTexImage(GL_TEXTURE_3D, 0, GL_RG, GL_FLOAT, ranges.data());
  return ranges;
}

// Takes up `most` bricks at a time; every picture on the way must be the one of a volume
// that is just what the card holds then.
void ExpectTrueSurfacesOnTheWay(CastRig& rig, const CastRequest& request, float background,
                                std::size_t most) {
  CastRig reference(Held(rig.texture, background));
  std::size_t waiting = SIZE_MAX;
  std::vector<float> ranges;
  for (bool done = false; !done;) {
    done = rig.texture.TakeUp(rig.volume, most);
    EXPECT_EQ(done, rig.texture.waiting_bricks() == 0);
    ASSERT_LT(rig.texture.waiting_bricks(), waiting);
    waiting = rig.texture.waiting_bricks();
    const Picture seen = rig.Cast(request);
    reference.volume.Take(testing::WholeVolume(Held(rig.texture, background), {}));
    ASSERT_TRUE(reference.texture.TakeUp(reference.volume, SIZE_MAX));
    const Picture expected = reference.Cast(request);
    ASSERT_EQ(seen.depth, expected.depth) << waiting << " bricks left";
    ASSERT_EQ(seen.veil_depth, expected.veil_depth) << waiting << " bricks left";
    ASSERT_EQ(seen.color, expected.color) << waiting << " bricks left";
    // A brick is among the corners of eight cell bricks.
    const std::vector<float> now = HeldRanges(rig.texture);
    std::size_t changed = 0;
    for (std::size_t n = 0; n < ranges.size(); n += 2) {
      changed += ranges[n] != now[n] || ranges[n + 1] != now[n + 1] ? 1 : 0;
    }
    EXPECT_LE(changed, 8 * most);
    ranges = now;
  }
}

// In the middle of which are bricks that no surface passes.
VoxelArray CastBall(const Vec3& middle, double radius) {
  return MakeVoxels({30, 25, 33}, [=](int i, int j, int k) {
    return static_cast<float>(std::max(-1.0, radius - (Vec3(i, j, k) - middle).norm()));
  });
}

TEST_F(VolumeOnTheCard, ShowsATrueSurfaceWhileItIsTakenUp) {
  VoxelArray voxels = CastBall({15.0, 12.0, 16.0}, 18.0);
  const CastRequest request = RequestFor(voxels);
  const float background = voxels.background;
  CastRig rig(MakeVoxels({3, 3, 3}, [](int, int, int) { return 0.0f; }));
  rig.volume.Take(testing::WholeVolume(voxels, {}));
  rig.texture.TakeUp(rig.volume, 0);
  EXPECT_GT(rig.texture.waiting_bricks(), rig.volume.lattice()->Bricks() / 2);
  ExpectTrueSurfacesOnTheWay(rig, request, background, 5);

  // Other values, of which half come while the first wait.
  voxels = CastBall({4.0, 20.0, 3.0}, 21.0);
  std::vector<Vec3i> even, all;
  for (std::uint64_t n = 0; n < rig.volume.lattice()->Bricks(); ++n) {
    all.push_back(BrickWithNumber(n, rig.volume.lattice()->BrickCounts()));
    if (n % 2 == 0) even.push_back(all.back());
  }
  rig.volume.Take(Edit(voxels, even));
  rig.texture.TakeUp(rig.volume, 7);
  rig.volume.Take(Edit(voxels, all));
  ExpectTrueSurfacesOnTheWay(rig, request, background, 5);
  EXPECT_EQ(Held(rig.texture, background).values, voxels.values);
  CastRig fresh(MakeVoxels({3, 3, 3}, [](int, int, int) { return 0.0f; }));
  client::VolumeUpdate whole = testing::WholeVolume(voxels, {});
  whole.lattice->value_min = background;
  fresh.volume.Take(whole);
  fresh.texture.TakeUp(fresh.volume, SIZE_MAX);
  EXPECT_EQ(HeldRanges(rig.texture), HeldRanges(fresh.texture)) << "no wider than need be";
}

// A volume that replaces another leaves nothing of it, though its bricks be few.
TEST_F(VolumeOnTheCard, BeginsAnew) {
  CastRig rig(CastWaves());
  const VoxelArray ball = MakeVoxels({20, 20, 20}, [](int i, int j, int k) {
    return static_cast<float>(std::max(0.0, 5.0 - (Vec3(i, j, k) - Vec3(9.0, 9.0, 9.0)).norm()));
  });
  rig.Cast(RequestFor(ball));
  rig.volume.Take(testing::WholeVolume(ball, {}));
  EXPECT_FALSE(rig.texture.TakeUp(rig.volume, 1));
  EXPECT_TRUE(rig.texture.TakeUp(rig.volume, SIZE_MAX));
  EXPECT_EQ(rig.Cast(RequestFor(ball)), CastRig(ball).Cast(RequestFor(ball)));

  client::VolumeUpdate none;
  none.all = true;
  rig.volume.Take(none);
  EXPECT_TRUE(rig.texture.TakeUp(rig.volume, SIZE_MAX));
  EXPECT_EQ(rig.texture.voxels(), 0u);
  const Picture nothing = rig.Cast(RequestFor(ball));
  for (std::size_t n = 0; n < nothing.pixels(); ++n) ASSERT_FALSE(nothing.Shows(n));
}

TEST_F(VolumeOnTheCard, IsNotShownBeforeItHasAPlace) {
  const VoxelArray voxels = CastWaves();
  client::VolumeUpdate update = testing::WholeVolume(voxels, {});
  update.placement.reset();
  CastRig rig(voxels);
  rig.volume.Take(update);
  rig.texture.TakeUp(rig.volume, SIZE_MAX);
  const Picture nothing = rig.Cast(RequestFor(voxels));
  EXPECT_EQ(nothing.depth, std::vector<float>(nothing.pixels(), 1.0f));
  EXPECT_EQ(rig.caster.casts(), 1u);
}

TEST_F(VolumeOnTheCard, IsCastAgainOnlyAfterAChange) {
  const VoxelArray voxels = CastWaves();
  CastRig rig(voxels);
  CastRequest request = RequestFor(voxels);
  EXPECT_TRUE(rig.caster.Cast(rig.texture, request));
  EXPECT_FALSE(rig.caster.Cast(rig.texture, request));
  rig.texture.TakeUp(rig.volume, SIZE_MAX);
  EXPECT_FALSE(rig.caster.Cast(rig.texture, request)) << "nothing was to be taken up";

  const std::vector<std::function<void(CastRequest&)>> changes{
      [](CastRequest& r) { r.size.width += 1; },
      [](CastRequest& r) { r.eye_D.x() += 1e-9; },
      [](CastRequest& r) { r.clip_from_D(0, 0) *= 1.01; },
      [](CastRequest& r) { r.surface.shown = false; },
      [](CastRequest& r) { r.surface.isovalue += 0.1; },
      [](CastRequest& r) { r.surface.free_above = true; },
      [](CastRequest& r) { r.surface.color.x() *= 0.5f; },
      [](CastRequest& r) { r.surface.coloring = SurfaceColoring::kSlope; },
      [](CastRequest& r) { r.surface.color_map = ColorMap::kHot; },
      [](CastRequest& r) { r.surface.window_min -= 1.0; },
      [](CastRequest& r) { r.surface.window_max += 1.0; },
      [](CastRequest& r) { r.surface.veil.shown = false; },
      [](CastRequest& r) { r.surface.veil.isovalue += 0.1; },
      [](CastRequest& r) { r.surface.veil.color.y() *= 0.5f; },
      [](CastRequest& r) { r.surface.veil.opacity *= 0.5; },
      [](CastRequest& r) { r.surface.crop.min.x() = 0.2; },
      [](CastRequest& r) { r.surface.crop.max.z() = 0.8; },
      [](CastRequest& r) { r.surface.planes[0].on = true; },
      [](CastRequest& r) { r.surface.planes[1].normal_I = Vec3::UnitY(); },
      [](CastRequest& r) { r.surface.planes[1].offset_voxels = 4.0; },
      [](CastRequest& r) { r.surface.caps = false; }};
  for (std::size_t n = 0; n < changes.size(); ++n) {
    changes[n](request);
    EXPECT_TRUE(rig.caster.Cast(rig.texture, request)) << n;
    EXPECT_FALSE(rig.caster.Cast(rig.texture, request)) << n;
  }
  EXPECT_EQ(rig.caster.casts(), 1 + changes.size());

  client::VolumeUpdate moved = Edit(voxels, {});
  moved.placement->X_DI.translation.x() = 1.0;
  rig.volume.Take(moved);
  rig.texture.TakeUp(rig.volume, SIZE_MAX);
  EXPECT_TRUE(rig.caster.Cast(rig.texture, request));
  rig.volume.Take(Edit(voxels, {Vec3i(1, 1, 1)}));
  rig.texture.TakeUp(rig.volume, SIZE_MAX);
  EXPECT_TRUE(rig.caster.Cast(rig.texture, request));
  EXPECT_FALSE(rig.caster.Cast(rig.texture, request));

  const CastRequest last = request;
  request.size = {1 << 20, 90};
  EXPECT_THROW(rig.caster.Cast(rig.texture, request), Error);
  EXPECT_FALSE(rig.caster.Cast(rig.texture, last)) << "it has that still";
  request.size = {0, 90};
  EXPECT_FALSE(rig.caster.Cast(rig.texture, request));
}

TEST_F(VolumeOnTheCard, IsRefusedWhereItIsTooLarge) {
  GLint most = 0;
  glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &most);
  VoxelArray voxels{{1, most - 1, 1}, 0.0f};
  voxels.values.assign(static_cast<std::size_t>(voxels.size.prod()), 1.0f);
  ViewVolume volume;
  VolumeTexture texture;
  volume.Take(testing::WholeVolume(voxels, {}));
  try {
    texture.TakeUp(volume, SIZE_MAX);
    FAIL() << "taken up";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kTooLarge);
    const std::string what = error.what();
    EXPECT_NE(what.find(std::to_string(most - 2)), std::string::npos) << what;
  }
  // Told once; edits of it are let pass, and another volume is taken.
  volume.Take(Edit(voxels, {Vec3i(0, 0, 0)}));
  EXPECT_TRUE(texture.TakeUp(volume, SIZE_MAX));
  EXPECT_EQ(texture.voxels(), 0u);
  const VoxelArray small = CastWaves();
  volume.Take(testing::WholeVolume(small, {}));
  EXPECT_TRUE(texture.TakeUp(volume, SIZE_MAX));
  EXPECT_NE(texture.voxels(), 0u);
}

}  // namespace
}  // namespace palpate::view
