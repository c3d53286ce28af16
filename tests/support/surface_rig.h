// Compares the pictures of a surface caster, pixel by pixel, with rays cast in double precision.
//
// Frame: I (voxels). Pixels count from the lower left corner, as in OpenGL.
#pragma once

#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "client/view/render/brick_cache.h"
#include "client/view/render/offscreen_context.h"
#include "client/view/render/surface_caster.h"
#include "tests/support/view_volumes.h"

namespace palpate::testing {

// A surface caster with its context, a volume and a camera. Returns its pictures as arrays.
//
// Pixels count from the lower left corner, as in OpenGL.

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

inline constexpr view::ImageSize kSize{160, 120};
// With this size, the middle column and row are rays in the planes of the camera's axes.
inline constexpr view::ImageSize kOddSize{161, 121};
inline constexpr view::ImageSize kSmallSize{81, 61};

// The expected content of a pixel.
struct Expected {
  bool shows = false;
  bool is_cap = false;
  Vec3 point_I = Vec3::Zero();
  std::vector<Vec3> veil_I{};
};

struct Scene {
  VoxelArray voxels;
  AffineMap X_DI{};
  view::SurfaceOptions options{};
};

inline std::vector<HalfSpace> KeptOf(const Scene& scene) {
  std::vector<HalfSpace> kept = PaddedBox(scene.voxels.size);
  for (int a = 0; a < 3; ++a) {
    const double cells = scene.voxels.size[a] + 1.0;
    const view::CropBox& crop = scene.options.crop;
    if (crop.min[a] > 0.0) kept.push_back({-Vec3::Unit(a), -(crop.min[a] * cells - 1.0)});
    if (crop.max[a] < 1.0) kept.push_back({Vec3::Unit(a), crop.max[a] * cells - 1.0});
  }
  for (const view::ClipPlane& plane : scene.options.planes) {
    if (plane.on) kept.push_back({plane.normal_I, plane.offset_voxels});
  }
  return kept;
}

inline Expected ExpectAt(const Scene& scene, const CpuCaster& cpu, const Vec3& eye,
                         const Vec3& direction) {
  Expected expected;
  const auto part = cpu.Kept(eye, direction);
  if (!part) return expected;
  const view::SurfaceOptions& options = scene.options;
  CpuCaster::Part clear = *part;  // the part before the surface
  const auto stop = [&](double t) {
    expected.shows = true;
    expected.point_I = eye + t * direction;
    clear.to = t;
    clear.ends_outside = false;
  };
  const bool above = cpu.BeginsAbove(eye, direction, *part, options.isovalue);
  if (options.shown && options.caps && part->begins_at_cut && above != options.free_above) {
    expected.is_cap = true;
    stop(part->from);
  } else if (options.shown) {
    const auto hits = cpu.Crossings(eye, direction, *part, options.isovalue, 1);
    if (!hits.empty()) stop(hits.front());
  }
  if (!options.veil.shown || expected.is_cap) return expected;
  for (const double t : cpu.Crossings(eye, direction, clear, options.veil.isovalue, 1000)) {
    expected.veil_I.push_back(eye + t * direction);
  }
  return expected;
}

inline std::vector<Expected> ExpectPicture(const Scene& scene, const Look& look,
                                           const view::ImageSize& size) {
  const CpuCaster cpu(scene.voxels, KeptOf(scene));
  std::vector<Expected> picture;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const Vec3 direction = DirectionOf(look, scene.X_DI, size, x, y);
      picture.push_back(ExpectAt(scene, cpu, look.eye_I, direction.normalized()));
    }
  }
  return picture;
}

// True if any of the 3 x 3 pixels around `pixel` differs from it.
inline bool AnyAround(const std::vector<Expected>& picture, const view::ImageSize& size,
                      std::size_t pixel,
                      const std::function<bool(const Expected&, const Expected&)>& differs) {
  const int x = static_cast<int>(pixel) % size.width;
  const int y = static_cast<int>(pixel) / size.width;
  for (int v = std::max(0, y - 1); v <= std::min(size.height - 1, y + 1); ++v) {
    for (int u = std::max(0, x - 1); u <= std::min(size.width - 1, x + 1); ++u) {
      if (differs(picture[pixel], picture[static_cast<std::size_t>(v * size.width + u)])) {
        return true;
      }
    }
  }
  return false;
}

// True if a pixel nearby is of another kind or has another depth.
inline bool NearSilhouette(const std::vector<Expected>& picture, const Vec3& eye,
                           const view::ImageSize& size, std::size_t pixel) {
  return AnyAround(picture, size, pixel, [&](const Expected& here, const Expected& there) {
    const double jump = (here.point_I - eye).norm() - (there.point_I - eye).norm();
    return here.shows != there.shows || (here.shows && std::abs(jump) > 2.0);
  });
}

inline bool NearVeilEdge(const std::vector<Expected>& picture, const view::ImageSize& size,
                         std::size_t pixel) {
  return AnyAround(picture, size, pixel, [](const Expected& here, const Expected& there) {
    return here.veil_I.empty() != there.veil_I.empty();
  });
}

struct Comparison {
  int both = 0;
  int far = 0;       // both hit, but more than 0.05 voxel apart
  int disagree = 0;  // near a silhouette
  int wrong = 0;     // disagree, but not near a silhouette
  double worst_voxels = 0.0;
};

inline Comparison Compare(const Scene& scene, const Look& look, const view::CastRequest& request,
                          const Picture& drawn, const std::vector<Expected>& expected) {
  Comparison result;
  for (std::size_t n = 0; n < drawn.pixels(); ++n) {
    EXPECT_EQ(drawn.Shows(n), drawn.depth[n] < 1.0f) << "pixel " << n;
    if (drawn.Shows(n) != expected[n].shows) {
      ++(NearSilhouette(expected, look.eye_I, request.size, n) ? result.disagree : result.wrong);
    } else if (drawn.Shows(n)) {
      ++result.both;
      const Vec3 point_I = PointOf(request, scene.X_DI, n, drawn.depth[n]);
      const double apart = (point_I - expected[n].point_I).norm();
      if (apart > 0.05) ++result.far;
      result.worst_voxels = std::max(result.worst_voxels, apart);
    }
  }
  return result;
}

// Views from all around: exactly and nearly along the axes, and with the middle row and column of
// the picture in planes of the lattice or in the middle between planes.
inline std::vector<Look> LooksAt(const Vec3i& size) {
  const Vec3 middle = (0.5 * (size - Vec3i::Ones()).cast<double>()).array().floor();
  const double away = 1.9 * size.maxCoeff();
  std::vector<Look> looks;
  for (int a = 0; a < 3; ++a) {
    for (const double sign : {-1.0, 1.0}) {
      const Vec3 up = a == 1 ? Vec3::UnitZ() : Vec3::UnitY();
      looks.push_back({middle + sign * away * Vec3::Unit(a), middle, up});
    }
  }
  const Vec3 half = middle + Vec3::Constant(0.5);
  looks.push_back({half + away * Vec3::UnitZ(), half});
  looks.push_back({middle + away * Vec3(1e-7, 2e-7, 1.0), middle});
  looks.push_back({middle + away * Vec3(1.0, 1e-4, -1e-5), middle});
  looks.push_back({middle + away * Vec3(0.5, 0.4, 0.75), middle});
  looks.push_back({middle + away * Vec3(-0.6, -0.5, -0.6), middle});
  looks.push_back({middle + 20.0 * away * Vec3(0.01, 0.0, -0.01), middle});
  return looks;
}

inline AffineMap Mirrored() {
  return {Mat3(Vec3(-0.7, 1.3, 0.5).asDiagonal()), Vec3(3.0, -8.0, 100.0)};
}

inline AffineMap Sheared() {
  AffineMap map;
  map.linear << 0.9, 0.2, 0.0, -0.1, 0.6, 0.3, 0.1, 0.0, -1.1;
  map.translation = Vec3(-20.0, 5.0, 7.0);
  return map;
}

inline VoxelArray Sphere(int n, double radius) {
  return MakeVoxels(Vec3i::Constant(n), [=](int i, int j, int k) {
    return static_cast<float>(radius - (Vec3(i, j, k) - Vec3::Constant(0.5 * n - 0.3)).norm());
  });
}

inline VoxelArray Gyroid(const Vec3i& size) {
  return MakeVoxels(size, [](int i, int j, int k) {
    const Vec3 p = 0.45 * Vec3(i, j, k);
    return static_cast<float>(std::sin(p.x()) * std::cos(p.y()) +
                              std::sin(p.y()) * std::cos(p.z()) +
                              std::sin(p.z()) * std::cos(p.x()));
  });
}

inline VoxelArray Noise(const Vec3i& size) {
  std::mt19937 random(7);
  return MakeVoxels(size,
                    [&](int, int, int) { return static_cast<float>(random() % 1000) / 1000.0f; });
}

// 0 below a plane of the lattice, 1 above it, and ½ at it.
inline Scene Slab(int plane) {
  return {MakeVoxels({24, 24, 24}, [=](int, int, int k) {
    return k < plane ? 0.0f : k == plane ? 0.5f : 1.0f;
  })};
}

struct VeilComparison {
  int both = 0;
  int far = 0;       // nearest layer more than 0.05 voxel off
  int layers = 0;    // another number of layers, judged by the total opacity
  int presence = 0;  // a veil where there should be none, or the reverse, away from the veil's edge
};

inline VeilComparison CompareVeil(const Scene& scene, const view::CastRequest& request,
                                  const Picture& drawn, const std::vector<Expected>& expected) {
  VeilComparison result;
  for (std::size_t n = 0; n < drawn.pixels(); ++n) {
    const std::vector<Vec3>& veil = expected[n].veil_I;
    EXPECT_EQ(drawn.veil_color[4 * n + 3] != 0, drawn.veil_depth[n] < 1.0f);
    if (veil.empty() != (drawn.veil_color[4 * n + 3] == 0) &&
        !NearVeilEdge(expected, request.size, n)) {
      ++result.presence;
    }
    if (veil.empty() || drawn.veil_color[4 * n + 3] == 0) continue;
    ++result.both;
    const Vec3 point_I = PointOf(request, scene.X_DI, n, drawn.veil_depth[n]);
    if ((point_I - veil.front()).norm() > 0.05) ++result.far;
    const double clear = 1.0 - scene.options.veil.opacity;
    const auto layers = std::min(veil.size(), static_cast<std::size_t>(view::kMostVeilLayers));
    const double alpha = 255.0 * (1.0 - std::pow(clear, static_cast<double>(layers)));
    if (std::abs(drawn.veil_color[4 * n + 3] - alpha) > 1.5) ++result.layers;
  }
  return result;
}

class SurfaceRig : public ::testing::Test {
 protected:
  view::CastRequest RequestOf(const Scene& scene, const Look& look, const view::ImageSize& size) {
    view::CastRequest request = RequestFor(look, scene.X_DI, scene.voxels.size, size);
    request.surface = scene.options;
    return request;
  }

  void ExpectSame(const std::string& name, const Scene& scene, const std::vector<Look>& looks,
                  const view::ImageSize& size = kOddSize) {
    CastRig rig(scene.voxels, scene.X_DI);
    for (std::size_t n = 0; n < looks.size(); ++n) {
      const view::CastRequest request = RequestOf(scene, looks[n], size);
      const auto expected = ExpectPicture(scene, looks[n], size);
      const Comparison c = Compare(scene, looks[n], request, rig.Cast(request), expected);
      std::printf("%s %zu: both %d, apart %d, disagree %d, wrong %d, worst %.4f voxel\n",
                  name.c_str(), n, c.both, c.far, c.disagree, c.wrong, c.worst_voxels);
      EXPECT_GT(c.both, 200) << name << " " << n;
      EXPECT_LE(c.far, 0.001 * c.both) << name << " " << n;
      EXPECT_EQ(c.wrong, 0) << name << " " << n;
    }
  }

  // `flicker`: the largest fraction of pixels that may have a layer more or less.
  void ExpectSameVeil(const std::string& name, const Scene& scene, const view::ImageSize& size,
                      double flicker) {
    CastRig rig(scene.voxels, scene.X_DI);
    for (const Look& look : LooksAt(scene.voxels.size)) {
      const view::CastRequest request = RequestOf(scene, look, size);
      const Picture drawn = rig.Cast(request);
      const auto expected = ExpectPicture(scene, look, size);
      const VeilComparison c = CompareVeil(scene, request, drawn, expected);
      std::printf("%s: both %d, apart %d, presence %d, layers %d\n", name.c_str(), c.both, c.far,
                  c.presence, c.layers);
      EXPECT_GT(c.both, 200);
      EXPECT_LE(c.far, 0.001 * c.both);
      EXPECT_EQ(c.presence, 0);
      EXPECT_LE(c.layers, flicker * c.both);
      EXPECT_EQ(Compare(scene, look, request, drawn, expected).wrong, 0);
    }
  }

  view::OffscreenContext context_;
};

}  // namespace palpate::testing
