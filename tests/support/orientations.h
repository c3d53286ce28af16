// The 48 ways in which a volume's axes can run along those of the world.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate::testing {

// Matrices with one 1 or -1 in each row and column; half of them are mirrored.
inline std::vector<Mat3> Orientations() {
  std::vector<Mat3> all;
  std::array<int, 3> order = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Mat3 W_from_I = Mat3::Zero();
      for (int axis = 0; axis < 3; ++axis)
        W_from_I(order[static_cast<std::size_t>(axis)], axis) = signs >> axis & 1 ? -1.0 : 1.0;
      all.push_back(W_from_I);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return all;
}

}  // namespace palpate::testing
