// `palpate watch`.
//
// Threads: main only. Apart for its tests.
#pragma once

#include <cstdint>
#include <optional>

#include "client/cli/invocation.h"

namespace palpate::cli {

struct WatchOptions {
  // Samples per second, in (0, 1000]. Absent: 1000, or 60 with `json`.
  std::optional<double> rate_hz;
  // Ends after this many samples, at least 1.
  std::optional<std::uint64_t> count;
  // Ends after this time.
  std::optional<double> seconds;
  // One JSON object per sample instead of text.
  bool json = false;
};

// Returns the samples per message: about 31 messages per second for text, 100 for JSON. Never more
// samples than asked for. Pure.
std::uint32_t BatchFor(const WatchOptions& options, double rate_hz);

}  // namespace palpate::cli
