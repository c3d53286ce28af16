// A surface caster with its context, a volume and a camera. Returns its pictures as arrays.
//
// Pixels count from the lower left corner, as in OpenGL.
#pragma once

#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "client/view/render/brick_cache.h"
#include "client/view/render/offscreen_context.h"
#include "client/view/render/surface_caster.h"
#include "tests/support/view_volumes.h"

namespace palpate::testing {

struct Picture {
  view::ImageSize size;
  std::vector<std::uint8_t> color;       // rgba
  std::vector<std::uint8_t> veil_color;  // rgba, premultiplied
  std::vector<float> depth;
  std::vector<float> veil_depth;

  std::size_t pixels() const { return depth.size(); }
  bool Shows(std::size_t pixel) const { return color[4 * pixel + 3] != 0; }
  friend bool operator==(const Picture&, const Picture&) = default;
};

// A view from one point to another, both in I; 35 degrees high.
struct Look {
  Vec3 eye_I = Vec3::Zero();
  Vec3 target_I = Vec3::UnitX();
  Vec3 up_D = Vec3::UnitY();
};

constexpr double kTanHalfView = 0.31529878887898349;

// Rows: right, up, back.
inline Mat3 Axes(const Vec3& eye_D, const Vec3& target_D, const Vec3& up_D) {
  const Vec3 back = (eye_D - target_D).normalized();
  const Vec3 right = up_D.cross(back).normalized();
  Mat3 axes;
  axes << right.transpose(), back.cross(right).transpose(), back.transpose();
  return axes;
}

inline view::CastRequest RequestFor(const Look& look, const AffineMap& X_DI, const Vec3i& lattice,
                                    const view::ImageSize& size) {
  view::CastRequest request;
  request.size = size;
  request.eye_D = X_DI.Apply(look.eye_I);
  const Mat3 axes = Axes(request.eye_D, X_DI.Apply(look.target_I), look.up_D);
  double far = 0.0;
  double near = 1e9;
  for (int n = 0; n < 8; ++n) {
    const Vec3 corner = Vec3(n >> 2, n >> 1 & 1, n & 1).cwiseProduct(lattice.cast<double>());
    const double away = -axes.row(2).dot(X_DI.Apply(corner) - request.eye_D);
    far = std::max(far, away);
    near = std::min(near, away);
  }
  far *= 1.2;
  near = std::max(0.5 * near, 1e-3 * far);
  view::Mat4 clip = view::Mat4::Zero();
  clip(0, 0) = size.height / kTanHalfView / size.width;
  clip(1, 1) = 1.0 / kTanHalfView;
  clip(2, 2) = (far + near) / (near - far);
  clip(2, 3) = 2.0 * far * near / (near - far);
  clip(3, 2) = -1.0;
  view::Mat4 view = view::Mat4::Identity();
  view.topLeftCorner<3, 3>() = axes;
  view.topRightCorner<3, 1>() = -axes * request.eye_D;
  request.clip_from_D = clip * view;
  return request;
}

// The direction to a pixel's centre, in I; its length is not 1.
inline Vec3 DirectionOf(const Look& look, const AffineMap& X_DI, const view::ImageSize& size, int x,
                        int y) {
  const Mat3 axes = Axes(X_DI.Apply(look.eye_I), X_DI.Apply(look.target_I), look.up_D);
  const Vec3 view((2.0 * x + 1.0 - size.width) / size.height * kTanHalfView,
                  (2.0 * y + 1.0 - size.height) / size.height * kTanHalfView, -1.0);
  return X_DI.linear.inverse() * (axes.transpose() * view);
}

// The point in I at a pixel's depth.
inline Vec3 PointOf(const view::CastRequest& request, const AffineMap& X_DI, std::size_t pixel,
                    float depth) {
  const auto x = static_cast<double>(pixel % static_cast<std::size_t>(request.size.width));
  const auto y = static_cast<double>(pixel / static_cast<std::size_t>(request.size.width));
  const Eigen::Vector4d clip((2.0 * x + 1.0) / request.size.width - 1.0,
                             (2.0 * y + 1.0) / request.size.height - 1.0, 2.0 * depth - 1.0, 1.0);
  const Eigen::Vector4d p = request.clip_from_D.inverse() * clip;
  return X_DI.Inverse().Apply(p.head<3>() / p.w());
}

class CastRig {
 public:
  explicit CastRig(const VoxelArray& voxels, const AffineMap& X_DI = {},
                   LeafType type = LeafType::kFloat,
                   std::size_t budget_bytes = std::size_t{1} << 30)
      : cache(budget_bytes) {
    volume.Take(WholeVolume(voxels, X_DI, type));
    cache.TakeUp(volume, SIZE_MAX);
  }

  // With all bricks that it wants and that the budget holds.
  Picture Cast(const view::CastRequest& request) {
    std::uint64_t before = 0;
    do {
      before = cache.version();
      caster.Cast(cache, request);
      cache.TakeUp(volume, SIZE_MAX);
    } while (cache.version() != before);
    return ReadPicture(request);
  }
  // With the bricks that are there.
  Picture CastOnce(const view::CastRequest& request) {
    caster.Cast(cache, request);
    return ReadPicture(request);
  }

  view::ViewVolume volume;
  view::BrickCache cache;
  view::SurfaceCaster caster;

 private:
  Picture ReadPicture(const view::CastRequest& request) const {
    const auto pixels = static_cast<std::size_t>(request.size.width * request.size.height);
    const auto colors = [&](GLuint name) {
      return Read<std::uint8_t>(name, GL_RGBA, GL_UNSIGNED_BYTE, 4 * pixels);
    };
    const Picture picture{request.size, colors(caster.color()), colors(caster.veil_color()),
                          Read<float>(caster.depth(), GL_RED, GL_FLOAT, pixels),
                          Read<float>(caster.veil_depth(), GL_RED, GL_FLOAT, pixels)};
    EXPECT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR));
    return picture;
  }

  template <typename Value>
  static std::vector<Value> Read(GLuint name, GLenum format, GLenum type, std::size_t count) {
    std::vector<Value> values(count);
    glBindTexture(GL_TEXTURE_2D, name);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glGetTexImage(GL_TEXTURE_2D, 0, format, type, values.data());
    return values;
  }
};

}  // namespace palpate::testing
