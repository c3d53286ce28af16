#include "server/lab/cells_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string>
#include <string_view>

#include "common/error/error.h"
#include "common/isosurface/placement.h"
#include "common/isosurface/ties.h"

namespace palpate::lab {
namespace {

constexpr std::size_t kFlushBytes = 1 << 20;

[[noreturn]] void Refuse(std::uint64_t line_number, const std::string& what) {
  throw Error(ErrorKind::kInvalidArgument, fmt::format("line {}: {}", line_number, what));
}

// The next column of `rest`; empty at the end.
std::string_view NextColumn(std::string_view& rest) {
  constexpr std::string_view kSeparators = ", \t\r;";
  const std::size_t start = std::min(rest.find_first_not_of(kSeparators), rest.size());
  const std::size_t end = std::min(rest.find_first_of(kSeparators, start), rest.size());
  const std::string_view column = rest.substr(start, end - start);
  rest = rest.substr(end);
  return column;
}

template <class Number, std::size_t kCount>
std::array<Number, kCount> ParseColumns(std::string_view rest, std::uint64_t line_number,
                                        const char* expected) {
  std::array<Number, kCount> numbers{};
  for (Number& number : numbers) {
    std::string_view column = NextColumn(rest);
    if (column.empty()) Refuse(line_number, fmt::format("{} are needed", expected));
    if (column.front() == '+') column.remove_prefix(1);
    const char* end = column.data() + column.size();
    const auto [stop, status] = std::from_chars(column.data(), end, number);
    if (status != std::errc() || stop != end) {
      Refuse(line_number, fmt::format("'{}' is no number; {} are needed", column, expected));
    }
    if (!std::isfinite(static_cast<double>(number))) {
      Refuse(line_number, "every density must be finite");
    }
  }
  return numbers;
}

// Densities in other units: value = offset + scale * density.
struct Units {
  double offset = 0.0;
  double scale = 1.0;
};

// Normalised over the cell's range, ties resolved. Halved first: the range of
// huge values of both signs must not overflow.
CellDensities ResolveAlone(const CellDensities& raw, Units& units) {
  const auto [lo, hi] = std::minmax_element(raw.begin(), raw.end());
  const double half_range = *hi / 2 - *lo / 2;
  units = {*lo, half_range > 0.0 ? half_range : 0.5};
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    d[v] = ResolvedDensity((raw[v] / 2 - *lo / 2) / units.scale, o[0], o[1], o[2]);
  }
  return d;
}

double InUnits(double density, const Units& units, bool normalised) {
  return normalised ? density : units.offset + units.scale * density + units.scale * density;
}

void AppendJson(const Decomposition& cell, int sigma_c, const Units& units, bool normalised,
                std::string& out) {
  std::array<int, kMaxVertices> number{};
  auto to = std::back_inserter(out);
  fmt::format_to(to, "{{\"sigma_f\":{},\"sigma_c\":{},\"vertices\":[", cell.face_saddle_count,
                 sigma_c);
  int used = 0;
  for (int v = 0; v < kMaxVertices; ++v) {
    if (!(cell.complex.used_vertices >> v & 1)) continue;
    const Vec3& p = cell.position[v];
    fmt::format_to(to, "{}[{},{},{},{}]", used ? "," : "", p.x(), p.y(), p.z(),
                   InUnits(cell.density[v], units, normalised));
    number[v] = used++;
  }
  out += "],\"tetrahedra\":[";
  for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
    const auto& v = cell.complex.vertices[t];
    fmt::format_to(to, "{}[{},{},{},{}]", t ? "," : "", number[v[0]], number[v[1]], number[v[2]],
                   number[v[3]]);
  }
  out += "]}\n";
}

CellDensities ReadCell(const VolumeSnapshot& volume, std::string_view line,
                       std::uint64_t line_number) {
  const auto index = ParseColumns<int, 3>(line, line_number, "three cell indices i, j, k");
  const Vec3i cell(index[0], index[1], index[2]);
  if (!volume.HasCell(cell)) {
    Refuse(line_number,
           fmt::format("cell {},{},{} is outside of the volume: -1 to {}, {}, {} are its cells",
                       cell.x(), cell.y(), cell.z(), volume.size().x() - 1, volume.size().y() - 1,
                       volume.size().z() - 1));
  }
  return volume.ResolvedCell(cell);
}

}  // namespace

void DecomposeCells(std::istream& in, std::ostream& out, DecompositionMethod method,
                    const VolumeSnapshot* volume) {
  std::string text;
  std::uint64_t line_number = 0;
  const auto flush = [&] {
    out.write(text.data(), static_cast<std::streamsize>(text.size()));
    text.clear();
  };
  try {
    for (std::string line; std::getline(in, line);) {
      ++line_number;
      if (line.find_first_not_of(" \t\r") == std::string::npos || line[0] == '#') continue;
      Units units;
      const CellDensities d =
          volume ? ReadCell(*volume, line, line_number)
                 : ResolveAlone(ParseColumns<double, 8>(line, line_number, "8 densities d0..d7"),
                                units);
      Decomposition cell = Decompose(d, method);
      cell.face_saddle_count = CellSaddles(d).count;
      AppendJson(cell, FindBodySaddles(d).count, units, volume != nullptr, text);
      if (text.size() > kFlushBytes) flush();
    }
  } catch (const Error&) {
    flush();  // what came before stands
    throw;
  }
  flush();
  out.flush();
  if (!out) throw Error(ErrorKind::kUnavailable, "cannot write the output");
}

}  // namespace palpate::lab
