#include "client/cli/progress_call.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "client/cli/output.h"

namespace palpate::cli {
namespace {

constexpr int kBarWidth = 30;

}  // namespace

ProgressPrinter::ProgressPrinter() : is_terminal_(IsTerminal(STDERR_FILENO)) {}

ProgressPrinter::~ProgressPrinter() {
  if (bar_drawn_) {
    std::fputs("\r\x1b[K", stderr);
  }
}

void ProgressPrinter::Print(const v1::LoadVolumeProgress& progress) {
  const double fraction = std::clamp(progress.fraction(), 0.0, 1.0);
  const std::string stage = OneLine(progress.stage());
  if (is_terminal_) {
    const auto filled = static_cast<std::size_t>(fraction * kBarWidth);
    fmt::print(stderr, "\r\x1b[K[{:<{}}] {:3.0f} % {:.30}", std::string(filled, '#'), kBarWidth,
               100.0 * fraction, stage);
    bar_drawn_ = true;
    return;
  }
  const int quarter = static_cast<int>(fraction * 4.0);
  if (stage != stage_ || quarter != quarter_) {
    stage_ = stage;
    quarter_ = quarter;
    fmt::print(stderr, "{:3.0f} % {}\n", 100.0 * fraction, stage);
  }
}

}  // namespace palpate::cli
