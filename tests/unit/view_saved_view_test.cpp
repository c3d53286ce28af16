#include "client/view/drawing/saved_view.h"

#include <gtest/gtest.h>

#include <random>

#include "client/view/drawing/camera.h"

namespace palpate::view {
namespace {

class ViewDice {
 public:
  double Between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vec3 Point(double reach) {
    return {Between(-reach, reach), Between(-reach, reach), Between(-reach, reach)};
  }
  Mat3 Turn() { return Eigen::AngleAxisd(Between(0, 6), Point(1).normalized()).toRotationMatrix(); }
  AffineMap Place() { return {Between(0.2, 5.0) * Turn(), Point(50)}; }
  Camera AnyCamera() {
    Camera camera;
    camera.SetUpright(Turn());
    camera.Set(Point(100), Between(-180, 180), Between(-89, 89), Between(1, 1000));
    return camera;
  }
  SurfaceOptions AnySurface() {
    SurfaceOptions surface;
    surface.crop.min = Vec3(Between(0, 0.4), Between(0, 0.4), Between(0, 0.4));
    surface.crop.max = Vec3(Between(0.6, 1), Between(0.6, 1), Between(0.6, 1));
    for (ClipPlane& plane : surface.planes) {
      plane = {Between(0, 1) < 0.5, Point(1).normalized(), Between(-50, 50)};
    }
    surface.window_min = Between(-1000, 0);
    surface.window_max = Between(1, 1000);
    return surface;
  }
  std::size_t Below(std::size_t most) { return random_() % most; }

 private:
  std::mt19937 random_{21};
};

void ExpectSame(const Camera& a, const Camera& b) {
  EXPECT_LT((a.X_VD().linear - b.X_VD().linear).norm(), 1e-9);
  EXPECT_LT((a.Eye() - b.Eye()).norm(), 1e-6);
  EXPECT_LT((a.target() - b.target()).norm(), 1e-6);
}

TEST(ViewSavedView, IsShownAgainAsItWas) {
  ViewDice dice;
  for (int n = 0; n < 1000; ++n) {
    const Camera camera = dice.AnyCamera();
    const SurfaceOptions surface = dice.AnySurface();
    const Vec3 cross_I = dice.Point(100);
    const AffineMap X_DW = dice.Place();
    const auto views = ViewsOf(JsonOf({SaveView("n", camera, surface, cross_I, X_DW)}));
    ASSERT_EQ(views.size(), 1u);
    Camera again;
    SurfaceOptions surface_again;
    Vec3 cross_again;
    ShowView(views[0], X_DW, again, surface_again, cross_again);
    ExpectSame(again, camera);
    EXPECT_EQ(surface_again.crop, surface.crop);
    EXPECT_EQ(surface_again.window_min, surface.window_min);
    EXPECT_EQ(surface_again.window_max, surface.window_max);
    EXPECT_EQ(cross_again, cross_I);
    for (std::size_t plane = 0; plane < 2; ++plane) {
      EXPECT_EQ(surface_again.planes[plane].on, surface.planes[plane].on);
      EXPECT_LT((surface_again.planes[plane].normal_I - surface.planes[plane].normal_I).norm(),
                1e-12);
    }
  }
}

TEST(ViewSavedView, StaysWithTheVolumeWhereverItIsPlaced) {
  ViewDice dice;
  for (int n = 0; n < 1000; ++n) {
    const AffineMap before = dice.Place(), after = dice.Place();
    const Camera camera = dice.AnyCamera();
    const SavedView view = SaveView("", camera, {}, Vec3::Zero(), before);
    Camera again;
    SurfaceOptions surface;
    Vec3 cross_I;
    ShowView(view, after, again, surface, cross_I);
    // A point of the volume appears where it appeared.
    const Vec3 p_W = view.target_W + 0.1 * view.distance_mm * dice.Point(1);
    const ImageSize size{640, 480};
    const auto was = Projection(camera, size).PixelOf(before.Apply(p_W));
    const auto is = Projection(again, size).PixelOf(after.Apply(p_W));
    ASSERT_TRUE(was && is);
    EXPECT_LT((*was - *is).norm(), 1e-6);
  }
}

TEST(ViewSavedView, DamagedTextGivesUsableViewsOrNone) {
  ViewDice dice;
  const std::vector<SavedView> views = {
      SaveView("one \xff\"", dice.AnyCamera(), dice.AnySurface(), Vec3::Zero(), dice.Place()),
      SaveView("two", dice.AnyCamera(), dice.AnySurface(), Vec3::Zero(), dice.Place())};
  const std::string whole = JsonOf(views);
  ASSERT_EQ(ViewsOf(whole).size(), 2u);
  EXPECT_TRUE(ViewsOf("").empty());
  EXPECT_TRUE(ViewsOf("{}").empty());
  EXPECT_TRUE(ViewsOf("[1, null, {\"name\": 3}]").empty());
  for (int n = 0; n < 5000; ++n) {
    std::string text = whole;
    for (int change = 0; change < 3; ++change) {
      const std::size_t at = dice.Below(text.size());
      if (n % 3 == 0) {
        text.erase(at, dice.Below(20));
      } else {
        text[at] = "0123456789eE-.,[]{}\"ntrue "[dice.Below(26)];
      }
    }
    for (const SavedView& view : ViewsOf(text)) {
      Camera camera;
      SurfaceOptions surface;
      Vec3 cross_I;
      ShowView(view, {}, camera, surface, cross_I);
      EXPECT_TRUE(camera.X_VD().linear.allFinite());
      EXPECT_LT(surface.window_min, surface.window_max);
      EXPECT_TRUE((surface.crop.min.array() < surface.crop.max.array()).all());
    }
  }
}

}  // namespace
}  // namespace palpate::view
