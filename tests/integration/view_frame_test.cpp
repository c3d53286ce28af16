// Frames as a whole, around a ball whose surface is known.
#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>
#include <utility>
#include <vector>

#include "client/view/drawing/shapes.h"
#include "client/view/render/shader_program.h"
#include "common/error/error.h"
#include "tests/support/frame_rig.h"
#include "tests/support/refusal.h"

namespace palpate::view {
namespace {

using testing::Difference;
using testing::FrameRig;
using testing::PixelOf;
using testing::Refusal;
using testing::Rgb8;

constexpr ImageSize kFrameSize = {320, 240};
constexpr int kX = 150, kY = 130;  // a pixel on the ball
constexpr double kBallVoxel_mm = 1.5;
const Vec3i kBallLattice = {48, 48, 48};
const Vec3 kMiddle_I = Vec3::Constant(23.5);
constexpr double kRadius_voxels = 15.0;
const Paint kRed = {{255, 0, 0, 255}, 100};

// Values fall outwards by one per voxel and are 0 on the ball.
client::VolumeUpdate FrameBall() {
  AffineMap X_DI;
  X_DI.linear *= kBallVoxel_mm;
  X_DI.translation = -kBallVoxel_mm * kMiddle_I;
  return testing::VolumeOf(
      kBallLattice, [](const Vec3& p) { return kRadius_voxels - (p - kMiddle_I).norm(); }, X_DI,
      -30.0, kRadius_voxels);
}

FrameRequest Looking() {
  FrameRequest request;
  request.size = kFrameSize;
  request.camera.Set(Vec3::Zero(), 20.0, 15.0, 150.0);
  request.surface.isovalue = 0.0;
  return request;
}

class ViewFrame : public ::testing::Test {
 protected:
  ViewFrame() { rig.Take(FrameBall()); }
  ~ViewFrame() override { EXPECT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR)); }

  // On the ray through the pixel, so far in front of the ball.
  Vec3 Before(double distance_mm) {
    rig.Draw(Looking());
    const Vec3 hit_D = rig.renderer.SurfaceAt(kX, kY).value();
    return hit_D + distance_mm * (Looking().camera.Eye() - hit_D).normalized();
  }
  Image DrawWith(FrameRequest request, const Overlay& overlay) {
    request.overlay = &overlay;
    return rig.Draw(request);
  }

  FrameRig rig;
};

Overlay PointAt(const Vec3& p_D, const Paint& paint = kRed) {
  Overlay overlay;
  AddSphere(p_D, 2.0, paint, overlay.solids);
  return overlay;
}

Overlay LineThrough(const Vec3& p_D, const Camera& camera, std::uint8_t alpha_behind) {
  const Vec3 right = camera.X_VD().linear.row(0);
  const std::array<std::uint8_t, 4> red = {255, 0, 0, 255};
  Overlay overlay;
  overlay.lines.push_back({(p_D - 2.0 * right).cast<float>(), red, alpha_behind});
  overlay.lines.push_back({(p_D + 2.0 * right).cast<float>(), red, alpha_behind});
  return overlay;
}

TEST_F(ViewFrame, TwoDrawingsOfOneRequestAreEqual) {
  FrameRequest request = Looking();
  request.surface.veil.shown = true;
  request.surface.veil.isovalue = -4.0;
  client::Pose pose;
  pose.contact = true;
  pose.hip_mm = Before(-6.0);
  pose.scp_h_mm = Before(0.0);
  pose.force_n = {0.0, 1.0, 1.0};
  const Overlay overlay =
      BuildOverlay({.pose = pose, .X_DI = rig.volume.X_DI(), .lattice_size = kBallLattice}, {},
                   request.camera, request.size);
  const Image first = DrawWith(request, overlay);
  EXPECT_EQ(DrawWith(request, overlay).rgba, first.rgba);
  FrameRequest other = request;
  other.camera.Orbit(40.0, 5.0);
  EXPECT_NE(rig.Draw(other).rgba, first.rgba);
  EXPECT_EQ(DrawWith(request, overlay).rgba, first.rgba);
  FrameRig again;
  again.Take(FrameBall());
  request.overlay = &overlay;
  EXPECT_EQ(again.Draw(request).rgba, first.rgba);
}

TEST_F(ViewFrame, APointInFrontIsSeenAndOneBehindShinesThrough) {
  const Rgb8 surface = PixelOf(rig.Draw(Looking()), kX, kY);
  const Rgb8 in_front = PixelOf(DrawWith(Looking(), PointAt(Before(8.0))), kX, kY);
  EXPECT_GT(in_front[0], 180);
  EXPECT_LT(in_front[1], 100);
  const Rgb8 behind = PixelOf(DrawWith(Looking(), PointAt(Before(-8.0))), kX, kY);
  const double alpha = kRed.alpha_behind / 255.0;
  for (int channel = 0; channel < 3; ++channel) {
    EXPECT_NEAR(behind[channel], (1.0 - alpha) * surface[channel] + alpha * in_front[channel], 12)
        << channel;
  }
  EXPECT_GT(Difference(behind, surface), 20);
  Paint unseen = kRed;
  unseen.alpha_behind = 0;
  EXPECT_EQ(PixelOf(DrawWith(Looking(), PointAt(Before(-8.0), unseen)), kX, kY), surface);
}

TEST_F(ViewFrame, NearerBodiesHideFartherOnesWhateverTheirOrder) {
  const Paint blue = {{0, 0, 255, 255}, 0};
  for (const bool near_first : {true, false}) {
    Overlay overlay;
    const Vec3 near_D = Before(12.0), far_D = Before(5.0);
    AddSphere(near_first ? near_D : far_D, 2.0, near_first ? kRed : blue, overlay.solids);
    AddSphere(near_first ? far_D : near_D, 2.0, near_first ? blue : kRed, overlay.solids);
    const Rgb8 seen = PixelOf(DrawWith(Looking(), overlay), kX, kY);
    EXPECT_GT(seen[0], seen[2] + 100) << near_first;
  }
}

TEST_F(ViewFrame, LinesAreHiddenAsBodiesAreAndAboutAPixelAndAHalfWide) {
  const FrameRequest request = Looking();
  const Image plain = rig.Draw(request);
  const auto line = [&](double distance_mm, std::uint8_t alpha_behind) {
    return DrawWith(request, LineThrough(Before(distance_mm), request.camera, alpha_behind));
  };
  const Image in_front = line(4.0, 0);
  double width_px = 0.0;
  for (int y = kY - 6; y <= kY + 6; ++y) {
    const Rgb8 was = PixelOf(plain, kX, y), is = PixelOf(in_front, kX, y);
    width_px += static_cast<double>(was[2] - is[2]) / was[2];
  }
  EXPECT_NEAR(width_px, 1.5, 0.1);
  EXPECT_EQ(line(-4.0, 0).rgba, plain.rgba);
  const Image faint = line(-4.0, 60);
  const int through = Difference(PixelOf(faint, kX, kY), PixelOf(plain, kX, kY));
  EXPECT_GT(through, 10);
  EXPECT_LT(through, Difference(PixelOf(in_front, kX, kY), PixelOf(plain, kX, kY)) / 2);
}

// Both sides of the gap between H and V are told apart, and one that is none shows.
TEST_F(ViewFrame, AWireframeOnTheSurfaceIsSeenAndAFifthOfAVoxelUnderItIsFaint) {
  FrameRequest request = Looking();
  const Vec3 hit_D = Before(0.0);
  request.camera.Set(hit_D, 20.0, 15.0, 12.0);
  const AffineMap X_ID = rig.volume.X_DI()->Inverse();
  const auto blue_at_line = [&](double height_voxels) {
    OverlayScene scene;
    scene.X_DI = rig.volume.X_DI();
    const Vec3 out_I = (X_ID.Apply(hit_D) - kMiddle_I).normalized();
    for (int n = -4; n <= 4; ++n) {
      for (int end = 0; end < 2; ++end) {
        const Vec3 across = 0.05 * (n + end) * out_I.unitOrthogonal();
        scene.haptic_lines_I.push_back(kMiddle_I +
                                       (kRadius_voxels + height_voxels) *
                                           (out_I + across / kRadius_voxels).normalized());
      }
    }
    OverlayOptions options = {
        .points = false, .force = false, .stylus = false, .haptic_surface = true, .box = false};
    const Overlay overlay = BuildOverlay(scene, options, request.camera, request.size);
    const Image image = DrawWith(request, overlay);
    const Vec3 at_D =
        rig.volume.X_DI()->Apply(kMiddle_I + (kRadius_voxels + height_voxels) * out_I);
    const Eigen::Vector4d clip = request.camera.ClipFromD(kFrameSize, {}) * at_D.homogeneous();
    const int x = static_cast<int>((0.5 + 0.5 * clip.x() / clip.w()) * kFrameSize.width);
    const int y = static_cast<int>((0.5 - 0.5 * clip.y() / clip.w()) * kFrameSize.height);
    int most = 0;  // the line's middle may lie between two rows
    for (const int row : {y - 1, y, y + 1}) {
      const Rgb8 seen = PixelOf(image, x, row);
      most = std::max(most, seen[2] - seen[1]);
    }
    return most;
  };
  const int full = blue_at_line(0.3);
  EXPECT_GT(full, 60);
  EXPECT_GT(blue_at_line(0.0), 0.8 * full);
  EXPECT_LT(blue_at_line(-0.2), 0.5 * full);
  EXPECT_GT(blue_at_line(-0.2), blue_at_line(-100.0) + 10);
}

TEST_F(ViewFrame, TheVeilTintsWhatIsBehindItAndNothingElse) {
  FrameRequest request = Looking();
  const auto pixel_with = [&](bool veil, double distance_mm) {
    request.surface.veil.shown = veil;
    request.surface.veil.isovalue = -6.0;  // 9 mm outside of the ball
    return PixelOf(DrawWith(request, PointAt(Before(distance_mm))), kX, kY);
  };
  EXPECT_EQ(pixel_with(true, 16.0), pixel_with(false, 16.0));
  const Rgb8 behind = pixel_with(true, 4.0), without = pixel_with(false, 4.0);
  EXPECT_GT(behind[2], without[2] + 20);
  EXPECT_LT(behind[0], without[0]);
  // As the surface beside it is tinted.
  request.surface.veil.shown = false;
  const Rgb8 surface = PixelOf(rig.Draw(request), kX, kY);
  request.surface.veil.shown = true;
  const Rgb8 veiled = PixelOf(rig.Draw(request), kX, kY);
  EXPECT_GT(Difference(veiled, surface), 20);
}

// Under an overlay, too. Distances have the points' rows, from the top.
TEST_F(ViewFrame, SurfaceAtIsOnTheBallAndOnThePixelsRay) {
  const FrameRequest request = Looking();
  const Vec3 hit_D = Before(0.0);
  DrawWith(request, PointAt(Before(8.0)));
  EXPECT_EQ(rig.renderer.SurfaceAt(kX, kY), hit_D);
  const auto distances = rig.renderer.SurfaceDistances();
  ASSERT_EQ(distances.size(), static_cast<std::size_t>(kFrameSize.width) * kFrameSize.height);
  int hits = 0;
  for (int y = 0; y < kFrameSize.height; y += 7) {
    for (int x = 0; x < kFrameSize.width; x += 7) {
      const Ray ray = request.camera.RayThrough(x + 0.5, y + 0.5, kFrameSize);
      const double nearest = ray.direction.cross(-ray.origin).norm() / kBallVoxel_mm;
      const auto p_D = rig.renderer.SurfaceAt(x, y);
      if (nearest < kRadius_voxels - 0.5) {
        ASSERT_TRUE(p_D) << x << ' ' << y;
      }
      if (nearest > kRadius_voxels + 0.5) {
        ASSERT_FALSE(p_D) << x << ' ' << y;
      }
      const float distance = distances[static_cast<std::size_t>(y) * kFrameSize.width + x];
      EXPECT_EQ(std::isinf(distance), !p_D);
      if (!p_D) continue;
      ++hits;
      EXPECT_NEAR(distance, (*p_D - request.camera.Eye()).norm(), 1e-3);
      EXPECT_NEAR(p_D->norm() / kBallVoxel_mm, kRadius_voxels, 0.05);
      EXPECT_LT(ray.direction.cross(*p_D - ray.origin).norm(), 0.01);
      EXPECT_LT(p_D->dot(ray.direction), 0.0);  // the near side
    }
  }
  EXPECT_GT(hits, 150);
  EXPECT_FALSE(rig.renderer.SurfaceAt(-1, 0));
  EXPECT_FALSE(rig.renderer.SurfaceAt(kFrameSize.width, 0));
  EXPECT_FALSE(rig.renderer.SurfaceAt(0, kFrameSize.height));
}

TEST_F(ViewFrame, ASurfaceThatIsNotShownIsNotCast) {
  FrameRequest request = Looking();
  const Image shown = rig.Draw(request);
  const std::uint64_t casts = rig.renderer.casts();
  EXPECT_EQ(casts, 1u);
  request.surface.shown = false;
  const Image hidden = rig.Draw(request);
  EXPECT_FALSE(rig.renderer.SurfaceAt(kX, kY));
  EXPECT_GT(Difference(PixelOf(hidden, kX, kY), PixelOf(shown, kX, kY)), 50);
  const Rgb8 point = PixelOf(DrawWith(request, PointAt(Vec3::Zero())), 160, 120);
  EXPECT_GT(point[0], point[1] + 100);
  request.camera.Orbit(10.0, 0.0);
  rig.Draw(request);
  EXPECT_EQ(rig.renderer.casts(), casts);
  EXPECT_EQ(rig.Draw(Looking()).rgba, shown.rgba);
}

// Also when only bricks have come, which is no cast of all pixels.
TEST_F(ViewFrame, TheVersionOfTheSurfaceRisesWithEachChangeOfIt) {
  FrameRequest request = Looking();
  std::vector<float> seen;
  std::uint64_t version = 0;
  int refined = 0;
  for (bool changes = true; changes;) {
    const std::uint64_t casts = rig.renderer.casts();
    rig.renderer.Draw(request);
    std::vector<float> now = rig.renderer.SurfaceDistances();
    if (now != seen) {
      EXPECT_GT(rig.renderer.surface_version(), version);
      refined += rig.renderer.casts() == casts ? 1 : 0;
    }
    seen = std::move(now);
    version = rig.renderer.surface_version();
    const std::uint64_t bricks = rig.renderer.volume_version();
    rig.renderer.TakeUp(rig.volume, 8);
    changes = rig.renderer.volume_version() != bricks;
  }
  EXPECT_GT(refined, 0);
  rig.renderer.Draw(request);
  EXPECT_EQ(rig.renderer.surface_version(), version);
  request.surface.shown = false;
  rig.renderer.Draw(request);
  EXPECT_GT(rig.renderer.surface_version(), version);
}

TEST_F(ViewFrame, SizesMayChangeAndBeZero) {
  FrameRequest request = Looking();
  const Image first = rig.Draw(request);
  for (const ImageSize& size : {ImageSize{0, 0}, {0, 50}, {50, 0}, {1, 1}, {37, 211}, {-3, 5}}) {
    request.size = size;
    const Overlay overlay = PointAt(Vec3::Zero());
    const Image image = DrawWith(request, overlay);
    const bool empty = size.width <= 0 || size.height <= 0;
    EXPECT_EQ(image.rgba.size(), empty ? 0u : 4u * size.width * size.height);
    EXPECT_EQ(rig.renderer.DrawnTexture() == 0, empty);
    EXPECT_EQ(rig.renderer.SurfaceDistances().size(), image.rgba.size() / 4);
    EXPECT_FALSE(empty && rig.renderer.SurfaceAt(0, 0));
  }
  EXPECT_EQ(rig.Draw(Looking()).rgba, first.rgba);
}

// More pixels than a texture or a viewport has, and than any memory.
std::vector<ImageSize> TooLarge() {
  GLint texture = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &texture);
  GLint viewport[2] = {};
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport);
  return {{std::min(texture, viewport[0]) + 1, 4},
          {4, std::min(texture, viewport[1]) + 1},
          {1 << 20, 1 << 20},
          {std::numeric_limits<int>::max(), 1}};
}

TEST_F(ViewFrame, WhatIsTooLargeIsRefusedAndChangesNothing) {
  const Image frame = rig.Draw(Looking());
  SliceRequest across{.position_voxels = 20.0, .size = {60, 50}, .surface = {}};
  rig.DrawSlice(across);
  const Image slice = rig.renderer.ReadSlice(2);
  const unsigned texture = rig.renderer.DrawnTexture();
  const auto casts = rig.renderer.casts() + rig.renderer.slice_casts();
  const auto at = rig.renderer.SurfaceAt(kX, kY);
  for (const ImageSize& size : TooLarge()) {
    FrameRequest request = Looking();
    request.size = size;
    request.camera.Orbit(10.0, 0.0);
    EXPECT_EQ(Refusal([&] { rig.renderer.Draw(request); }), ErrorKind::kTooLarge);
    EXPECT_EQ(rig.renderer.DrawnTexture(), texture);
    EXPECT_EQ(rig.renderer.ReadBack().rgba, frame.rgba);
    EXPECT_EQ(rig.renderer.SurfaceAt(kX, kY), at);
    SliceRequest large = across;
    large.size = size;
    EXPECT_EQ(Refusal([&] { rig.renderer.DrawSlice(large); }), ErrorKind::kTooLarge);
    EXPECT_EQ(rig.renderer.ReadSlice(2).rgba, slice.rgba);
    EXPECT_EQ(rig.Draw(Looking()).rgba, frame.rgba);
    rig.DrawSlice(across);
    EXPECT_EQ(rig.renderer.ReadSlice(2).rgba, slice.rgba);
  }
  EXPECT_EQ(rig.renderer.casts() + rig.renderer.slice_casts(), casts) << "nothing was lost";
}

TEST_F(ViewFrame, StateThatOthersLeaveBehindDoesNoHarm) {
  const Overlay overlay = PointAt(Before(8.0));
  const Image first = DrawWith(Looking(), overlay);
  const auto spoil = [] {
    for (const GLenum on : {GL_SCISSOR_TEST, GL_BLEND, GL_CULL_FACE, GL_DEPTH_TEST,
                            GL_FRAMEBUFFER_SRGB, GL_RASTERIZER_DISCARD, GL_STENCIL_TEST}) {
      glEnable(on);
    }
    glScissor(0, 0, 3, 3);
    glCullFace(GL_FRONT);
    glFrontFace(GL_CW);
    glDepthFunc(GL_NEVER);
    glDepthMask(GL_FALSE);
    glColorMask(GL_TRUE, GL_FALSE, GL_FALSE, GL_TRUE);
    glBlendEquation(GL_FUNC_REVERSE_SUBTRACT);
    glPolygonMode(GL_FRONT_AND_BACK, GL_LINE);
    glViewport(1, 2, 3, 4);
    glActiveTexture(GL_TEXTURE3);
    glPixelStorei(GL_UNPACK_ROW_LENGTH, 100);
    glPixelStorei(GL_UNPACK_SKIP_PIXELS, 3);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 8);
  };
  spoil();
  EXPECT_EQ(DrawWith(Looking(), overlay).rgba, first.rgba);
  spoil();
  rig.Take(FrameBall());
  EXPECT_EQ(DrawWith(Looking(), overlay).rgba, first.rgba);
  SliceRequest across{.position_voxels = 20.0, .size = {60, 50}, .surface = {}};
  rig.DrawSlice(across);
  const Image slice = rig.renderer.ReadSlice(2);
  across.surface.isovalue = 1.0;
  rig.DrawSlice(across);
  spoil();
  across.surface.isovalue = 0.0;
  rig.DrawSlice(across);
  EXPECT_EQ(rig.renderer.ReadSlice(2).rgba, slice.rgba);
  FrameRequest other = Looking();
  other.camera.Orbit(5.0, 0.0);
  rig.Draw(other);
  spoil();
  EXPECT_EQ(DrawWith(Looking(), overlay).rgba, first.rgba);
}

TEST(ViewFrameEmpty, WithoutAVolumeThereIsTheBackgroundAndTheOverlay) {
  FrameRig rig;
  EXPECT_TRUE(rig.renderer.TakeUp(rig.volume, 10));
  FrameRequest request = Looking();
  const Image empty = rig.Draw(request);
  // Quiet: neighbours differ by next to nothing, and the top is lighter.
  for (int y = 1; y < kFrameSize.height; ++y) {
    EXPECT_LT(Difference(PixelOf(empty, 9, y), PixelOf(empty, 9, y - 1)), 9);
  }
  EXPECT_GT(PixelOf(empty, 9, 0)[2], PixelOf(empty, 9, kFrameSize.height - 1)[2]);
  const Overlay overlay = PointAt(Vec3::Zero());
  request.overlay = &overlay;
  const Rgb8 point = PixelOf(rig.Draw(request), 160, 120);
  EXPECT_GT(point[0], 150);
  EXPECT_EQ(rig.renderer.casts(), 0u);
}

TEST(ViewFrameEmpty, AShaderThatIsRefusedIsAnErrorThatSaysWhy) {
  const OffscreenContext context;
  try {
    const ShaderProgram program("#version 430 core\nvoid main() { nonsense = 1; }\n");
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInternal);
    EXPECT_NE(std::string(error.what()).find("nonsense"), std::string::npos) << error.what();
  }
}

// With all threads of a driver that draws in software.
double ProcessSeconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// Where the driver draws on a card, there is nothing of it to be seen here.
class ViewFrameTime : public ViewFrame {};

TEST_F(ViewFrameTime, AMovedProxyCostsBelowATwentiethOfACast) {
  constexpr int kCasts = 4, kFrames = 60;
  FrameRequest request = Looking();
  request.size = {800, 600};
  client::Pose pose;
  pose.contact = true;
  pose.scp_h_mm = Before(0.0);
  pose.force_n = {0.5, 1.0, 1.0};
  const auto draw = [&] {
    const Overlay overlay =
        BuildOverlay({.pose = pose, .X_DI = rig.volume.X_DI(), .lattice_size = kBallLattice}, {},
                     request.camera, request.size);
    request.overlay = &overlay;
    rig.Draw(request);
    glFinish();
  };
  draw();  // compiles shaders
  const std::uint64_t before = rig.renderer.casts();
  const double start = ProcessSeconds();
  for (int n = 0; n < kCasts; ++n) {
    request.camera.Orbit(3.0, 0.0);
    draw();
  }
  const double middle = ProcessSeconds();
  ASSERT_EQ(rig.renderer.casts(), before + kCasts);
  for (int n = 0; n < kFrames; ++n) {
    pose.hip_mm = pose.scp_h_mm - Vec3(0.0, 0.05 * n, 0.0);
    draw();
  }
  const double end = ProcessSeconds();
  EXPECT_EQ(rig.renderer.casts(), before + kCasts);
  const double cast_ms = 1e3 * (middle - start) / kCasts;
  const double frame_ms = 1e3 * (end - middle) / kFrames;
  std::printf("cast %.1f ms, moved proxy %.2f ms, %.2f %%\n", cast_ms, frame_ms,
              100.0 * frame_ms / cast_ms);
  EXPECT_LT(frame_ms, 0.05 * cast_ms);
}

}  // namespace
}  // namespace palpate::view
