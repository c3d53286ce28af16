// A straight stroke of the pointer over a curved surface, on a real daemon: how deep it goes does
// not depend on how often the pointer is sampled, nor on how long the daemon takes.
#include <gtest/gtest.h>

#include <algorithm>
#include <future>
#include <limits>
#include <random>

#include "client/view/palpated/brush.h"
#include "client/view/viewer/pointer.h"
#include "tests/support/live_view.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::view {
namespace {

using test::BricksOf;
using test::Settle;
using Bricks = std::vector<Brick>;
using Eigen::Vector2d;

constexpr ImageSize kView{640, 480};
constexpr double kVoxel_mm = 1.0;  // of the built-in volumes, in W
constexpr float kNothing = std::numeric_limits<float>::infinity();

// How the pointer gets from the stroke's one end to the other.
struct Pointer {
  int samples_per_s = 60;
  bool daemon_is_slow = false;  // answers only after the stroke
};
constexpr double kStroke_s = 2.0;
constexpr Pointer kPointers[] = {{60, false}, {60, true}, {5, false},
                                 {5, true},   {2, false}, {2, true}};

class ViewStroke : public ::testing::TestWithParam<const char*> {
 protected:
  ViewStroke() : daemon_({"--volume", GetParam()}) {}
  void SetUp() override {
    daemon_.Start();
    feed_ = std::make_unique<LiveFeed>(
        client::ServerChoice{.address = {.socket_path = daemon_.socket()}});
    ASSERT_TRUE(Settle(*feed_));
    Frame();  // the brush knows the daemon before its first stroke, as in a window
    ASSERT_EQ(volume().lattice()->spacing_mm, Vec3::Constant(kVoxel_mm));
    isovalue_ = feed_->settings()->isovalue;
    Bounds bounds{.min_mm = Vec3::Constant(1e9), .max_mm = Vec3::Constant(-1e9)};
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 share(corner & 1, corner >> 1 & 1, corner >> 2);
      const Vec3 p_D = volume().X_DI()->Apply(
          share.cwiseProduct((volume().lattice()->size - Vec3i::Ones()).cast<double>()));
      bounds.min_mm = bounds.min_mm.cwiseMin(p_D);
      bounds.max_mm = bounds.max_mm.cwiseMax(p_D);
    }
    camera_.Reset(bounds);
    camera_.Fit(bounds);
  }
  const ViewVolume& volume() const { return feed_->volume(); }
  double device_mm_per_voxel() const { return volume().X_DI()->linear.col(0).norm(); }

  // The distance of the surface from the eye, in mm of D.
  float DistanceAt(double x_px, double y_px) const {
    const Ray ray = camera_.RayThrough(x_px, y_px, kView);
    const AffineMap X_ID = volume().X_DI()->Inverse();
    const auto above = [&](double t) {
      return volume().Interpolate(X_ID.Apply(ray.origin + t * ray.direction)) - isovalue_;
    };
    const double step_mm = 0.1 * device_mm_per_voxel();
    const double outside = above(0.0);
    for (double t = 0.3 * camera_.distance_mm(); t < 2.0 * camera_.distance_mm(); t += step_mm) {
      if (above(t) * outside > 0.0) continue;
      double lower = t - step_mm;
      double upper = t;
      for (int n = 0; n < 30; ++n) {
        const double middle = 0.5 * (lower + upper);
        (above(middle) * outside > 0.0 ? lower : upper) = middle;
      }
      return static_cast<float>(upper);
    }
    return kNothing;
  }
  // Along a row of the picture, one per pixel.
  std::vector<float> Row(int y) const {
    std::vector<float> distances;
    for (int x = 0; x < kView.width; ++x) distances.push_back(DistanceAt(x + 0.5, y + 0.5));
    return distances;
  }
  // Only one row of the picture has a surface: a stroke along it sees no more.
  SeenSurface Seen(int y) const {
    SeenSurface surface{.size = kView, .camera = camera_, .distances_mm = {}};
    surface.distances_mm.assign(static_cast<std::size_t>(kView.width * kView.height), kNothing);
    const std::vector<float> row = Row(y);
    std::copy(row.begin(), row.end(), surface.distances_mm.begin() + y * kView.width);
    return surface;
  }

  void Draw(const SeenSurface& surface, const Vector2d& from_px, const Vector2d& to_px,
            const Pointer& pointer) {
    std::promise<void> go;
    if (pointer.daemon_is_slow) {
      feed_->commands().Do("hold",
                           [wait = go.get_future().share()](client::Client&) { wait.wait(); });
    }
    const PointerStroke::Sink sink = {
        .draw = [&](const Vec3& p_D) { brush_.Stroke(options_, p_D, volume(), feed_->commands()); },
        .lift = [&] { brush_.Lift(); }};
    PointerStroke stroke;
    ASSERT_TRUE(stroke.Begin(surface, from_px, kView, 3.0 * options_.radius_mm, sink));
    const int samples = static_cast<int>(kStroke_s * pointer.samples_per_s);
    for (int n = 1; n <= samples; ++n) {
      // As X tells them: whole pixels.
      const Vector2d at_px = from_px + (to_px - from_px) * n / samples;
      stroke.MoveTo(at_px.array().round(), kView, sink);
      Frame();
      // The daemon has done all that was asked for before the next sample.
      if (!pointer.daemon_is_slow) {
        EXPECT_TRUE(test::Follow(*feed_, [&] { return !feed_->commands().busy(); }));
      }
    }
    stroke.Release();
    brush_.End();
    if (pointer.daemon_is_slow) go.set_value();
    EXPECT_TRUE(Settle(*feed_));
    EXPECT_EQ(feed_->commands().problem(), "");
    Frame();
  }
  void Frame() {
    feed_->Poll();
    brush_.Follow(volume(), feed_->losses());
  }
  void UndoTo(const Bricks& loaded) {
    brush_.Restore(brush_.TakeBegun().back().number, /*forward=*/false, feed_->commands(), {});
    EXPECT_TRUE(Settle(*feed_));
    Frame();
    EXPECT_EQ(feed_->commands().problem(), "");
    EXPECT_EQ(BricksOf(volume()), loaded);
  }

  // The greatest distance from the surface that the stroke saw, of a voxel that was changed; in W.
  double DeepestChange(const Bricks& loaded, const SeenSurface& surface, int y) const {
    std::vector<Vec3> path_I;
    for (int x = 0; x < kView.width; ++x) {
      if (const auto p_D = surface.At(Vector2d(x + 0.5, y + 0.5), kView)) {
        path_I.push_back(volume().X_DI()->Inverse().Apply(*p_D));
      }
    }
    const Bricks now = BricksOf(volume());
    const Vec3i counts = volume().lattice()->BrickCounts();
    double deepest = 0.0;
    for (std::size_t b = 0; b < now.size(); ++b) {
      const int n = static_cast<int>(b);
      const Vec3i brick(n / (counts.z() * counts.y()), n / counts.z() % counts.y(), n % counts.z());
      for (int v = 0; v < kBrickVoxels; ++v) {
        if (now[b][v] == loaded[b][v]) continue;
        const Vec3 voxel = (8 * brick + Vec3i(v / 64, v / 8 % 8, v % 8)).cast<double>();
        double nearest = 1e9;
        for (const Vec3& p_I : path_I) nearest = std::min(nearest, (p_I - voxel).norm());
        deepest = std::max(deepest, nearest);
      }
    }
    return deepest * kVoxel_mm;
  }

  test::RestartedDaemon daemon_;
  std::unique_ptr<LiveFeed> feed_;
  Brush brush_;
  BrushOptions options_;
  double isovalue_ = 0.0;
  Camera camera_;
};

TEST_P(ViewStroke, RemovesTheSameHoweverOftenThePointerIsSampled) {
  const Bricks loaded = BricksOf(volume());
  const double range = volume().lattice()->value_max - volume().lattice()->value_min;
  // The second builds up where its edits overlap.
  for (const auto& [fade_mm, value] : {std::pair{0.0, 1.0 * range}, std::pair{1.5, 0.1 * range}}) {
    options_.operation = client::EditOperation::kSubtract;
    options_.radius_mm = 3.0;
    options_.falloff_mm = fade_mm;
    options_.value = value;
    const int y = kView.height / 2 - 30;
    const SeenSurface surface = Seen(y);
    const Vector2d from_px(kView.width / 2 - 80, y);
    const Vector2d to_px(kView.width / 2 + 81, y);
    std::vector<float> first;
    for (const Pointer& pointer : kPointers) {
      SCOPED_TRACE(testing::Message() << pointer.samples_per_s << " samples a second, fades over "
                                      << fade_mm << " mm, slow: " << pointer.daemon_is_slow);
      Draw(surface, from_px, to_px, pointer);
      EXPECT_LE(DeepestChange(loaded, surface, y), options_.radius_mm + fade_mm + 0.5 * kVoxel_mm);
      const std::vector<float> row = Row(y);
      if (first.empty()) first = row;
      double apart_voxels = 0.0;
      int removed = 0;
      for (std::size_t x = 0; x < row.size(); ++x) {
        const float before = surface.distances_mm[static_cast<std::size_t>(y * kView.width) + x];
        removed += row[x] > before + 0.5 * device_mm_per_voxel();
        if (row[x] == first[x]) continue;
        apart_voxels = std::max(
            apart_voxels, static_cast<double>(std::abs(row[x] - first[x])) / device_mm_per_voxel());
      }
      EXPECT_GT(removed, 100);
      EXPECT_LE(apart_voxels, 0.5);
      UndoTo(loaded);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Curved, ViewStroke,
                         ::testing::Values("builtin:sphere:48", "builtin:bumps:48"));

}  // namespace
}  // namespace palpate::view
