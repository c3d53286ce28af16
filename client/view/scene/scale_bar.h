// A bar of a round length, so that sizes in a picture can be read.
//
// Threads: pure functions.
#pragma once

#include <string>

namespace palpate::view {

struct ScaleBar {
  double length_mm = 0.0;  // 1, 2 or 5 times a power of ten; 0: none
  double length_px = 0.0;
};

// The longest bar of at most `most_px`.
ScaleBar FitScaleBar(double mm_per_px, double most_px);
// "50 mm", "0.02 mm".
std::string TextOf(const ScaleBar& bar);

}  // namespace palpate::view
