// How long the numeric loops of tests are.
#pragma once

#include <algorithm>
#include <cstdlib>

namespace palpate::test {

// PALPATE_TORTURE=N, which tests/run.sh --long sets, makes them N times as long. A sanitizer slows
// them down and looks at other things: there a tenth is enough.
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
