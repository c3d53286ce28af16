// The length of the numeric loops of tests.
#pragma once

#include <algorithm>
#include <cstdlib>

namespace palpate::test {

// PALPATE_TORTURE=N, set by tests/run.sh --wide, makes loops N times as long. With a sanitizer a
// tenth is enough: it is slow, and looks for other errors.
inline int Scaled(int count) {
  const char* factor = std::getenv("PALPATE_TORTURE");
  const int scaled = count * (factor ? std::max(1, std::atoi(factor)) : 1);
#ifdef PALPATE_SANITIZED
  return std::max(1, scaled / 10);
#else
  return scaled;
#endif
}

}  // namespace palpate::test
