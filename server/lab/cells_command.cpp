#include "server/lab/commands.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <string>
#include <string_view>
#include <type_traits>

#include "common/error/error.h"
#include "common/isosurface/cell.h"
#include "common/isosurface/placement.h"

namespace palpate::lab {
namespace {

constexpr std::size_t kFlushBytes = 1 << 20;

[[noreturn]] void RefuseLine(std::uint64_t line_number, const std::string& what) {
  throw Error(ErrorKind::kInvalidArgument, fmt::format("line {}: {}", line_number, what));
}

constexpr std::string_view kBlanks = " \t\r";

std::string_view SkipBlanks(std::string_view text) {
  return text.substr(std::min(text.find_first_not_of(kBlanks), text.size()));
}

// The next column of `rest`; empty at the end and between two commas.
std::string_view NextColumn(std::string_view& rest) {
  rest = SkipBlanks(rest);
  const std::size_t end = std::min(rest.find_first_of(", \t\r"), rest.size());
  const std::string_view column = rest.substr(0, end);
  rest = SkipBlanks(rest.substr(end));
  if (!rest.empty() && rest.front() == ',') rest.remove_prefix(1);
  return column;
}

// Like std::from_chars, but a number too small for a double becomes 0.
template <class Number>
bool Parse(std::string_view column, Number& number) {
  const char* end = column.data() + column.size();
  const auto [stop, status] = std::from_chars(column.data(), end, number);
  if constexpr (std::is_same_v<Number, double>) {
    if (status == std::errc::result_out_of_range) {
      number = std::strtod(std::string(column).c_str(), nullptr);
      return stop == end;
    }
  }
  return status == std::errc() && stop == end;
}

template <class Number, std::size_t kCount>
std::array<Number, kCount> ParseColumns(std::string_view rest, std::uint64_t line_number,
                                        const char* expected) {
  std::array<Number, kCount> numbers{};
  for (Number& number : numbers) {
    std::string_view column = NextColumn(rest);
    if (column.empty()) RefuseLine(line_number, fmt::format("{} are needed", expected));
    if (column.front() == '+') column.remove_prefix(1);
    if (!Parse(column, number)) {
      RefuseLine(line_number, fmt::format("'{}' is no number; {} are needed", column, expected));
    }
    if (!std::isfinite(static_cast<double>(number))) {
      RefuseLine(line_number, "every density must be finite");
    }
  }
  return numbers;
}

// Densities in other units: value = offset + scale * density.
struct Units {
  double offset = 0.0;
  double scale = 1.0;
};

// Normalises over the cell's range and resolves ties. Halves the values first, so that the range of
// huge values of both signs does not overflow.
CellDensities ResolveAlone(const CellDensities& raw, Units& units) {
  const auto [lo, hi] = std::minmax_element(raw.begin(), raw.end());
  double half_range = *hi / 2 - *lo / 2;
  // In a constant cell, the size of its value replaces the range, so that the step stays small
  // compared to the value.
  if (!(half_range > 0.0)) half_range = std::abs(*hi) / 2;
  units = {*lo, half_range > 0.0 ? half_range : 0.5};
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    d[v] = ResolvedDensity((raw[v] / 2 - *lo / 2) / units.scale, o[0], o[1], o[2]);
  }
  return d;
}

double InUnits(double density, const Units& units) {
  return units.offset + units.scale * density + units.scale * density;
}

// Densities of the vertices in the input's units. Densities of corners are computed from the input
// itself, by lowering it as ties are resolved: normalising and converting back could raise them by
// one bit.
std::array<double, kMaxVertices> DensitiesInUnits(const Decomposition& cell,
                                                  const CellDensities& raw, const Units& units) {
  std::array<double, kMaxVertices> densities{};
  for (int v = 0; v < kMaxVertices; ++v) {
    if (!(cell.complex.used_vertices >> v & 1)) continue;
    densities[v] = InUnits(cell.density[v], units);
  }
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    densities[v] = raw[v] - 2.0 * (units.scale * (kTieStep * TieHash(o[0], o[1], o[2])));
  }
  return densities;
}

void AppendJson(const Decomposition& cell, const std::array<double, kMaxVertices>& density,
                int sigma_c, std::string& out) {
  std::array<int, kMaxVertices> number{};
  auto to = std::back_inserter(out);
  fmt::format_to(to, "{{\"sigma_f\":{},\"sigma_c\":{},\"vertices\":[", cell.face_saddle_count,
                 sigma_c);
  int used = 0;
  for (int v = 0; v < kMaxVertices; ++v) {
    if (!(cell.complex.used_vertices >> v & 1)) continue;
    const Vec3& p = cell.position[v];
    fmt::format_to(to, "{}[{},{},{},{}]", used ? "," : "", p.x(), p.y(), p.z(), density[v]);
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
    RefuseLine(line_number,
               fmt::format("cell {},{},{} is outside of the volume: -1 to {}, {}, {} are its cells",
                           cell.x(), cell.y(), cell.z(), volume.size().x() - 1,
                           volume.size().y() - 1, volume.size().z() - 1));
  }
  return volume.ResolvedCell(cell);
}

void AppendCell(std::string_view line, std::uint64_t line_number, ComparedMethod method,
                const VolumeSnapshot* volume, std::string& out) {
  Units units;
  CellDensities raw{};
  if (!volume) raw = ParseColumns<double, 8>(line, line_number, "8 densities d0..d7");
  const CellDensities d = volume ? ReadCell(*volume, line, line_number) : ResolveAlone(raw, units);
  Decomposition cell = Decompose(d, method);
  // The count is for the whole cell, also if the method looks at fewer saddles.
  cell.face_saddle_count = CellSaddles(d).count;
  const int sigma_c = FindBodySaddles(d).count;
  AppendJson(cell, volume ? cell.density : DensitiesInUnits(cell, raw, units), sigma_c, out);
}

}  // namespace

void DecomposeCells(std::istream& in, std::ostream& out, ComparedMethod method,
                    const VolumeSnapshot* volume) {
  std::string text;
  std::uint64_t line_number = 0;
  const auto flush = [&] {
    out.write(text.data(), static_cast<std::streamsize>(text.size()));
    out.flush();
    text.clear();
  };
  try {
    for (std::string line; std::getline(in, line);) {
      ++line_number;
      const std::string_view content = SkipBlanks(line);
      if (content.empty() || content.front() == '#') continue;
      AppendCell(content, line_number, method, volume, text);
      // The reader may wait for this answer before it sends the next line.
      if (text.size() > kFlushBytes || in.rdbuf()->in_avail() <= 0) flush();
    }
  } catch (const Error&) {
    flush();  // keep the output of the lines before the error
    throw;
  }
  flush();
  if (!out) throw Error(ErrorKind::kUnavailable, "cannot write the output");
}

}  // namespace palpate::lab
