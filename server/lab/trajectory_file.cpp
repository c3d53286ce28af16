#include "server/lab/trajectory_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <fstream>
#include <string>
#include <string_view>

#include "common/error/error.h"
#include "common/files/new_file.h"

namespace palpate::lab {
namespace {

constexpr std::array<std::array<std::string_view, 3>, 2> kHeaders = {
    {{"x_mm", "y_mm", "z_mm"}, {"hip_x", "hip_y", "hip_z"}}};

[[noreturn]] void RefuseRow(const std::filesystem::path& file, std::uint64_t line_number,
                            const std::string& what) {
  throw Error(ErrorKind::kInvalidArgument,
              fmt::format("{}: line {}: {}", file.string(), line_number, what));
}

std::string_view Trim(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

std::vector<std::string_view> Split(std::string_view line) {
  std::vector<std::string_view> fields;
  for (;;) {
    const std::size_t comma = line.find(',');
    fields.push_back(Trim(line.substr(0, comma)));
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

// The columns of x, y and z.
std::array<std::size_t, 3> FindColumns(const std::filesystem::path& file, std::string_view line) {
  const std::vector<std::string_view> names = Split(line);
  for (const auto& header : kHeaders) {
    std::array<std::size_t, 3> columns{};
    for (int axis = 0; axis < 3; ++axis) {
      columns[axis] = static_cast<std::size_t>(std::find(names.begin(), names.end(), header[axis]) -
                                               names.begin());
    }
    if (*std::max_element(columns.begin(), columns.end()) < names.size()) return columns;
  }
  RefuseRow(file, 1, "a header with the columns x_mm,y_mm,z_mm is needed");
}

double ParseNumber(const std::filesystem::path& file, std::uint64_t line_number,
                   std::string_view field) {
  const std::string_view digits =
      field.starts_with('+') && field.size() > 1 ? field.substr(1) : field;
  double number = 0.0;
  const auto [stop, status] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  if (status != std::errc() || stop != digits.data() + digits.size()) {
    RefuseRow(file, line_number, fmt::format("'{}' is no number", field));
  }
  return number;
}

}  // namespace

std::vector<Vec3> ReadTrajectory(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in || !std::filesystem::is_regular_file(file)) {
    throw Error(ErrorKind::kNotFound, file.string() + ": no such file, or it cannot be read");
  }
  std::string line;
  std::getline(in, line);
  const std::array<std::size_t, 3> columns = FindColumns(file, line);
  std::vector<Vec3> hips_mm;
  for (std::uint64_t line_number = 2; std::getline(in, line); ++line_number) {
    if (Trim(line).empty()) continue;
    const std::vector<std::string_view> fields = Split(line);
    Vec3 hip_mm;
    for (int axis = 0; axis < 3; ++axis) {
      if (columns[axis] >= fields.size()) RefuseRow(file, line_number, "a column is missing");
      hip_mm[axis] = ParseNumber(file, line_number, fields[columns[axis]]);
    }
    hips_mm.push_back(hip_mm);
  }
  if (in.bad()) throw Error(ErrorKind::kUnavailable, file.string() + ": cannot be read to its end");
  if (hips_mm.empty()) RefuseRow(file, 2, "a position is needed; there is none");
  return hips_mm;
}

void WriteTrajectory(const std::filesystem::path& file, const std::vector<Vec3>& hips_mm,
                     IfThere if_there) {
  std::string text = "x_mm,y_mm,z_mm\n";
  for (const Vec3& hip : hips_mm) {
    fmt::format_to(std::back_inserter(text), "{},{},{}\n", hip.x(), hip.y(), hip.z());
  }
  WriteText(file, text, if_there);
}

void WriteText(const std::filesystem::path& file, const std::string& text, IfThere if_there) {
  NewFile out(file, if_there);
  out.Write(text);
  out.TakeName();
}

}  // namespace palpate::lab
