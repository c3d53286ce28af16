#include "client/cli/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "client/cli/output.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

constexpr int kProgressWidth = 30;

}  // namespace

ProgressPrinter::ProgressPrinter() : is_terminal_(IsTerminal(STDERR_FILENO)) {}

ProgressPrinter::~ProgressPrinter() {
  if (bar_drawn_) std::fputs("\r\x1b[K", stderr);
}

void ProgressPrinter::Print(std::string_view stage, double fraction, std::string_view detail) {
  fraction = std::clamp(fraction, 0.0, 1.0);
  const std::string name = OneLine(stage);
  const std::string text = name + (detail.empty() ? "" : " " + OneLine(detail));
  if (is_terminal_) {
    const auto filled = static_cast<std::size_t>(fraction * kProgressWidth);
    fmt::print(stderr, "\r\x1b[K[{:<{}}] {:3.0f} % {:.36}", std::string(filled, '#'),
               kProgressWidth, 100.0 * fraction, text);
    bar_drawn_ = true;
    return;
  }
  const int quarter = static_cast<int>(fraction * 4.0);
  if (name != stage_ || quarter != quarter_) {
    stage_ = name;
    quarter_ = quarter;
    fmt::print(stderr, "{:3.0f} % {}\n", 100.0 * fraction, text);
  }
}

}  // namespace palpate::cli
