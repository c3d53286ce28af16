#include "client/cli/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "client/cli/output.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

constexpr int kProgressWidth = 30;
// In a pipe. Work that takes less leaves no line.
constexpr std::chrono::seconds kLinePeriod{2};

}  // namespace

ProgressPrinter::ProgressPrinter(std::function<Clock::time_point()> now)
    : is_terminal_(IsTerminal(STDERR_FILENO)), now_(std::move(now)), last_line_(now_()) {}

ProgressPrinter::~ProgressPrinter() {
  if (bar_drawn_) std::fputs("\r\x1b[K", stderr);
}

void ProgressPrinter::Print(std::string_view stage, double fraction, std::string_view detail) {
  fraction = std::clamp(fraction, 0.0, 1.0);
  const std::string text = OneLine(stage) + (detail.empty() ? "" : " " + OneLine(detail));
  if (is_terminal_) {
    const auto filled = static_cast<std::size_t>(fraction * kProgressWidth);
    fmt::print(stderr, "\r\x1b[K[{:<{}}] {:3.0f} % {:.36}", std::string(filled, '#'),
               kProgressWidth, 100.0 * fraction, text);
    bar_drawn_ = true;
    return;
  }
  const Clock::time_point now = now_();
  if (now - last_line_ < kLinePeriod) return;
  last_line_ = now;
  fmt::print(stderr, "{:3.0f} % {}\n", 100.0 * fraction, text);
}

}  // namespace palpate::cli
