#include "client/cli/isovalues.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "client/cli/description.h"
#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

constexpr std::size_t kColumns = 64;
constexpr int kRows = 3;
constexpr std::array<const char*, 9> kEighths = {" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};

std::string WithUnit(const client::VolumeInfo& volume, double value) {
  return NumberText(value) + (volume.unit.empty() ? "" : " ") + volume.unit;
}

// Logarithmic: a thin skin is then as visible as the air around it.
std::vector<double> ColumnHeights(const std::vector<std::uint64_t>& counts) {
  const std::size_t columns = std::min(kColumns, counts.size());
  std::vector<double> heights(columns);
  for (std::size_t bin = 0; bin < counts.size(); ++bin) {
    heights[bin * columns / counts.size()] += static_cast<double>(counts[bin]);
  }
  double greatest = 0.0;
  for (double& height : heights) greatest = std::max(greatest, height = std::log1p(height));
  for (double& height : heights) height /= greatest > 0.0 ? greatest : 1.0;
  return heights;
}

std::string RowOf(const std::vector<double>& heights, int row_from_below) {
  std::string text;
  for (const double height : heights) {
    const int eighths = static_cast<int>(std::lround(height * 8 * kRows)) - 8 * row_from_below;
    // What is there at all is seen.
    const bool is_least = row_from_below == 0 && height > 0.0;
    text += kEighths[static_cast<std::size_t>(std::clamp(eighths, is_least ? 1 : 0, 8))];
  }
  return text.substr(0, text.find_last_not_of(' ') + 1);
}

// A mark below the isovalue.
std::string MarkAt(const client::ValueHistogram& histogram, std::size_t columns, double isovalue) {
  const double share = (isovalue - histogram.low) / (histogram.high - histogram.low);
  const double place = std::clamp(share, 0.0, 1.0) * static_cast<double>(columns);
  return std::string(std::min(static_cast<std::size_t>(place), columns - 1), ' ') + "^";
}

}  // namespace

std::string DescribeIsovalue(const client::VolumeInfo& volume, double isovalue) {
  std::string text = "isovalue " + WithUnit(volume, isovalue);
  for (const client::SuggestedIsovalue& suggested : volume.suggested_isovalues) {
    if (suggested.isovalue != isovalue) continue;
    return text + " (" + suggested.reason + ")";
  }
  return text;
}

std::string DescribeIsovalues(const client::VolumeInfo& volume, double isovalue) {
  const client::ValueHistogram& histogram = volume.histogram;
  if (histogram.counts.empty() || !(histogram.low < histogram.high)) return "";
  const std::vector<double> heights = ColumnHeights(histogram.counts);
  std::string text;
  for (int row = kRows - 1; row >= 0; --row) {
    AppendLine(text, row == kRows - 1 ? "histogram" : "", RowOf(heights, row));
  }
  AppendLine(text, "", MarkAt(histogram, heights.size(), isovalue));
  AppendLine(text, "",
             fmt::format("{} to {}, logarithmic; ^ {}",
                         NumberText(std::max(histogram.low, volume.value_min)),
                         WithUnit(volume, std::min(histogram.high, volume.value_max)),
                         DescribeIsovalue(volume, isovalue)));
  std::string named;
  for (const client::SuggestedIsovalue& suggested : volume.suggested_isovalues) {
    named += (named.empty() ? "" : ", ") + suggested.name + " " + NumberText(suggested.isovalue);
  }
  std::string peaks;
  for (const double peak : histogram.peaks) {
    peaks += fmt::format("{}{:.4g}", peaks.empty() ? "; peaks at " : ", ", peak);
  }
  AppendLine(text, "", "isovalues by name: " + named + peaks);
  return text;
}

double SuggestedIsovalueOf(const client::VolumeInfo& volume, std::string_view name) {
  std::string names;
  for (const client::SuggestedIsovalue& suggested : volume.suggested_isovalues) {
    if (suggested.name == name) return suggested.isovalue;
    names += (names.empty() ? "" : ", ") + suggested.name;
  }
  Refuse(fmt::format("isovalue cannot be '{}' for {}: give a number{}{}", name,
                     OneLine(volume.source), names.empty() ? "" : ", or ", names));
}

}  // namespace palpate::cli
