// The next filter of the volume, as a person sets it.
//
// Threads: plain values and pure functions.
#pragma once

#include <optional>

#include "client/sdk/edit.h"
#include "client/view/drawing/view_options.h"
#include "common/bricks/volume_event.h"

namespace palpate::view {

enum class FilterRegion { kWhole, kCropBox, kProxyBall };

struct FilterForm {
  client::Filter filter{};
  FilterRegion region = FilterRegion::kWhole;
  double radius_mm = 10.0;  // of the ball; mm of the volume, W
};

// Gaussian, mean and median: they have a width and a region. The other three filter whole volumes.
bool HasRegion(client::FilterKind kind);
// Offset and mean curvature.
bool IsForLevelSets(client::FilterKind kind);
// The most iterations that palpated takes with this width; 0: the filter has none.
int MostIterations(client::FilterKind kind, int width);

// The filter to send, with values that palpated takes. `proxy_W`: the middle of the ball. None: the
// ball has no middle yet.
std::optional<client::Filter> FilterOf(const FilterForm& form, const CropBox& crop,
                                       const Vec3i& lattice_size,
                                       const std::optional<Vec3>& proxy_W);

}  // namespace palpate::view
