#include "server/volume/edit/mean_filter.h"

#include <cstddef>

namespace palpate {
namespace {

// The number of sums computed together, so that the compiler uses vector instructions.
constexpr int kTogether = 16;

}  // namespace

MeanFilter::MeanFilter(const Vec3i& size, int width, float around)
    : size_(size),
      width_(width),
      stride_y_(static_cast<std::size_t>(size.z() + 2 * width)),
      stride_x_(static_cast<std::size_t>(size.y() + 2 * width) * stride_y_),
      values_(static_cast<std::size_t>(size.x() + 2 * width) * stride_x_, around),
      next_(values_) {}

// Uses OpenVDB's order x, z, y, because the sums depend on it.
void MeanFilter::Run(const std::function<void()>& check) {
  Pass(stride_x_, check);
  Pass(1, check);
  Pass(stride_y_, check);
}

// Computes as OpenVDB does: adds floats from the first voxel to the last, and multiplies by a
// float.
void MeanFilter::Pass(std::size_t stride, const std::function<void()>& check) {
  const int count = 2 * width_ + 1;
  const float share = 1.0f / static_cast<float>(count);
  const std::size_t back = static_cast<std::size_t>(width_) * stride;
  for (int x = 0; x < size_.x(); ++x) {
    check();
    for (int y = 0; y < size_.y(); ++y) {
      const float* const first = Row(x, y) - back;
      float* const out = next_.data() + Place(x, y);
      int z = 0;
      for (; z + kTogether <= size_.z(); z += kTogether) {
        float sums[kTogether] = {};
        for (int n = 0; n < count; ++n) {
          const float* const from = first + z + static_cast<std::size_t>(n) * stride;
          for (int u = 0; u < kTogether; ++u) sums[u] += from[u];
        }
        for (int u = 0; u < kTogether; ++u) out[z + u] = sums[u] * share;
      }
      for (; z < size_.z(); ++z) {
        float sum = 0.0f;
        for (int n = 0; n < count; ++n) sum += first[z + static_cast<std::size_t>(n) * stride];
        out[z] = sum * share;
      }
    }
  }
  values_.swap(next_);
}

}  // namespace palpate
