// `palpate watch`.
//
// Threads: main only.
#pragma once

#include <cstdint>
#include <optional>

#include "client/cli/invocation.h"

namespace palpate::cli {

struct WatchOptions {
  // Samples per second, in (0, 1000]. Absent: 1000, or 60 with `json`.
  std::optional<double> rate_hz;
  // Ends after that many samples, at least 1.
  std::optional<std::uint64_t> count;
  // Ends after that time.
  std::optional<double> seconds;
  // One JSON object per sample instead of text.
  bool json = false;
};

// Samples per message: about 31 messages a second of text, 100 of JSON, and
// never more samples than asked for. Pure.
std::uint32_t BatchFor(const WatchOptions& options, double rate_hz);

}  // namespace palpate::cli
