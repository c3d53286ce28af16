// `palpate watch`.
#pragma once

#include <cstdint>
#include <optional>

namespace palpate::cli {

class Connection;

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

// Shows the stream until the end that the options name, Ctrl-C or SIGTERM: live
// on a terminal, else a line a second; then a summary.
// Errors: as Connection::ErrorOf and WriteOutput; kUnavailable when the daemon
// goes away.
void Watch(const Connection& connection, const WatchOptions& options);

// Samples per message: about 31 messages a second of text, 100 of JSON, and
// never more samples than asked for. Pure.
std::uint32_t BatchFor(const WatchOptions& options, double rate_hz);

}  // namespace palpate::cli
