#include "client/view/viewer/filter_form.h"

#include <algorithm>

#include "client/view/drawing/cut_handles.h"

namespace palpate::view {

using client::FilterKind;

bool HasRegion(FilterKind kind) {
  return kind == FilterKind::kGaussian || kind == FilterKind::kMean || kind == FilterKind::kMedian;
}

bool IsForLevelSets(FilterKind kind) {
  return kind == FilterKind::kOffset || kind == FilterKind::kMeanCurvature;
}

int MostIterations(FilterKind kind, int width) {
  switch (kind) {
    case FilterKind::kGaussian:
      return 8 / std::max(width, 1);
    case FilterKind::kMean:
    case FilterKind::kMedian:
      return 32 / std::max(width, 1);
    case FilterKind::kMeanCurvature:
      return 1000;
    case FilterKind::kUnknown:
    case FilterKind::kOffset:
    case FilterKind::kResample:
      break;
  }
  return 0;
}

std::optional<client::Filter> FilterOf(const FilterForm& form, const CropBox& crop,
                                       const Vec3i& lattice_size,
                                       const std::optional<Vec3>& proxy_W) {
  client::Filter filter = form.filter;
  filter.width = std::clamp(filter.width, 1, 8);
  filter.iterations =
      std::clamp(filter.iterations, 1, std::max(1, MostIterations(filter.kind, filter.width)));
  filter.region = {};
  if (!HasRegion(filter.kind)) return filter;
  if (form.region == FilterRegion::kCropBox) {
    const Vec3 last_I = (lattice_size - Vec3i::Ones()).cast<double>();
    const auto corner = [&](const Vec3& fractions) -> Vec3 {
      return PointOfFractions(fractions, lattice_size).cwiseMax(0.0).cwiseMin(last_I);
    };
    filter.region = client::Box{.min = corner(crop.min), .max = corner(crop.max)};
    filter.frame = client::EditFrame::kIndex;
  }
  if (form.region == FilterRegion::kProxyBall) {
    if (!proxy_W) return std::nullopt;
    filter.region = client::Sphere{.center = *proxy_W, .radius = form.radius_mm};
    filter.frame = client::EditFrame::kWorld;
  }
  return filter;
}

}  // namespace palpate::view
