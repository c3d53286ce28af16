// A filter that palpated takes, of whatever was set before.
#include "client/view/viewer/filter_form.h"

#include <gtest/gtest.h>

namespace palpate::view {
namespace {

using client::FilterKind;

const Vec3i kFilteredSize(40, 50, 60);

TEST(FilterForm, HasNoMoreIterationsThanTheDaemonTakes) {
  for (int kind = 1; kind <= 6; ++kind) {
    for (int width = 0; width < 12; ++width) {
      FilterForm form;
      form.filter.kind = static_cast<FilterKind>(kind);
      form.filter.width = width;
      form.filter.iterations = 5000;
      const auto filter = FilterOf(form, {}, kFilteredSize, {});
      ASSERT_TRUE(filter);
      EXPECT_GE(filter->width, 1);
      EXPECT_LE(filter->width, 8);
      EXPECT_GE(filter->iterations, 1);
      const int product = filter->width * filter->iterations;
      if (filter->kind == FilterKind::kGaussian) {
        EXPECT_LE(product, 8);
      }
      if (filter->kind == FilterKind::kMean || filter->kind == FilterKind::kMedian) {
        EXPECT_LE(product, 32);
      }
      EXPECT_LE(filter->iterations, 1000);
    }
  }
}

TEST(FilterForm, OfTheCropBoxReplacesItsVoxelsAlone) {
  FilterForm form{.region = FilterRegion::kCropBox};
  const CropBox crop{.min = Vec3(0.0, 0.5, 0.25), .max = Vec3(1.0, 0.75, 0.5)};
  const auto filter = FilterOf(form, crop, kFilteredSize, {});
  ASSERT_TRUE(filter);
  const auto* box = std::get_if<client::Box>(&filter->region);
  ASSERT_TRUE(box);
  EXPECT_EQ(filter->frame, client::EditFrame::kIndex);
  // The layer of background is no part of the volume.
  EXPECT_EQ(box->min.x(), 0.0);
  EXPECT_EQ(box->max.x(), 39.0);
  EXPECT_NEAR(box->min.y(), 24.5, 1e-12);
  EXPECT_NEAR(box->max.z(), 29.5, 1e-12);
}

TEST(FilterForm, OfTheBallNeedsItsMiddle) {
  FilterForm form{.region = FilterRegion::kProxyBall, .radius_mm = 7.0};
  EXPECT_FALSE(FilterOf(form, {}, kFilteredSize, {}));
  const auto filter = FilterOf(form, {}, kFilteredSize, Vec3(1, 2, 3));
  ASSERT_TRUE(filter);
  const auto* ball = std::get_if<client::Sphere>(&filter->region);
  ASSERT_TRUE(ball);
  EXPECT_EQ(ball->center, Vec3(1, 2, 3));
  EXPECT_EQ(ball->radius, 7.0);
  EXPECT_EQ(filter->frame, client::EditFrame::kWorld);
  // Of a filter of whole volumes the region is left out.
  form.filter.kind = FilterKind::kResample;
  const auto whole = FilterOf(form, {}, kFilteredSize, {});
  ASSERT_TRUE(whole);
  EXPECT_TRUE(std::holds_alternative<std::monostate>(whole->region));
}

}  // namespace
}  // namespace palpate::view
