#include "server/lab/published_table.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "common/error/error.h"
#include "common/isosurface/cell.h"

namespace palpate::lab {
namespace {

std::optional<double> ParseNumber(const std::string& text) {
  std::istringstream in(text);
  double value;
  if (!(in >> value) || !(in >> std::ws).eof() || !std::isfinite(value)) return std::nullopt;
  return value;
}

PublishedRow ParseRow(const std::string& line, const std::string& where) {
  std::vector<std::string> columns;
  std::istringstream in(line);
  for (std::string column; std::getline(in, column, ',');) columns.push_back(column);
  PublishedRow row;
  constexpr std::size_t kFirstDensity = 2, kFirstFigure = 10;
  columns.resize(std::max(columns.size(), kFirstFigure + 3));
  row.name = columns[0];
  std::array<std::optional<double>, 9> numbers;
  for (std::size_t n = 0; n < 9; ++n) {
    numbers[n] = ParseNumber(columns[n + 1]);
    if (!numbers[n]) {
      throw Error(ErrorKind::kInvalidArgument,
                  where + ": expected a name, an isovalue and 8 densities");
    }
  }
  row.isovalue = *numbers[0];
  for (std::size_t v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    row.d[v] = *numbers[v + kFirstDensity - 1];
    row.resolved[v] = ResolvedDensity(row.d[v], o[0], o[1], o[2]);
  }
  for (std::size_t n = 0; n < 3; ++n) row.difference[n] = ParseNumber(columns[kFirstFigure + n]);
  return row;
}

}  // namespace

std::vector<PublishedRow> ReadPublishedTable(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) {
    throw Error(ErrorKind::kNotFound, "cannot read the paper's Table 4, " + file.string() +
                                          "; name the file with --table");
  }
  std::vector<PublishedRow> rows;
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    if (line.empty() || line[0] == '#') continue;
    rows.push_back(ParseRow(line, file.string() + ", line " + std::to_string(number)));
  }
  return rows;
}

bool MeetsPublished(ComparedMethod method, double published, double ours) {
  constexpr double kAbsolute = 0.15, kRelative = 0.02, kTptd = 0.3;
  const double difference = std::abs(ours - published);
  if (method == ComparedMethod::kTptd) return difference <= kTptd;
  return difference <= std::max(kAbsolute, kRelative * published);
}

}  // namespace palpate::lab
