#include "server/import/nrrd_geometry.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

namespace palpate {
namespace {

// Parses "(x,y,z)", with optional blanks. `what` names the field. Returns an empty vector for
// "none".
std::vector<double> ParseVector(std::string_view text, const char* what) {
  std::vector<double> numbers;
  if (text == "none") return numbers;
  if (text.size() < 3 || text.front() != '(' || text.back() != ')') {
    Refuse(std::string("the NRRD header's ") + what + " holds " + Quoted(text) +
           "; correct the header");
  }
  text = text.substr(1, text.size() - 2);
  while (!text.empty()) {
    const std::string_view number = text.substr(0, text.find(','));
    numbers.push_back(ParseReal(Trim(number), what));
    text.remove_prefix(std::min(text.size(), number.size() + 1));
  }
  return numbers;
}

std::vector<std::vector<double>> ParseVectors(const std::string& text, const char* what) {
  std::vector<std::vector<double>> vectors;
  std::string_view rest = Trim(text);
  while (!rest.empty()) {
    const bool bracket = rest[0] == '(';
    const std::size_t end = bracket ? rest.find(')') : rest.find_first_of(" \t");
    const std::string_view vector =
        rest.substr(0, end == std::string_view::npos || !bracket ? end : end + 1);
    vectors.push_back(ParseVector(vector, what));
    rest = Trim(rest.substr(vector.size()));
  }
  return vectors;
}

// A space may have time as a fourth axis. The axes of space must not move along it.
Vec3 SpaceVector(const std::vector<double>& numbers, const char* what) {
  const bool time = numbers.size() == 4 && numbers[3] == 0.0;
  if (numbers.size() != 3 && !time) {
    Refuse(std::string("the NRRD header's ") + what +
           " must have three numbers for each of the first three axes; correct the header");
  }
  const Vec3 vector(numbers[0], numbers[1], numbers[2]);
  if (!vector.allFinite()) {
    Refuse(std::string("the NRRD header's ") + what + " is not finite; correct the header");
  }
  return vector;
}

// Signs that turn the header's space into LPS. None: the space does not say where it lies in a
// patient.
std::optional<Vec3> SignsOfLps(const NrrdFields& fields) {
  std::string space = Lower(FindField(fields, "space").value_or(""));
  for (const std::string_view time : {"-time", "t"}) {
    const bool short_form = time.size() == 1 && space.size() == 4;
    if ((time.size() > 1 || short_form) && space.ends_with(time)) {
      space.erase(space.size() - time.size());
    }
  }
  if (space == "right-anterior-superior" || space == "ras") return Vec3(-1.0, -1.0, 1.0);
  if (space == "left-anterior-superior" || space == "las") return Vec3(1.0, -1.0, 1.0);
  if (space == "left-posterior-superior" || space == "lps") return Vec3::Ones();
  return std::nullopt;
}

// Returns millimetres per unit of the first three axes: "mm" "mm" "mm", with or without quotes.
// Stores what is no known unit in `unknown_unit`.
Vec3 LengthUnits(const NrrdFields& fields, const char* name, std::string* unknown_unit) {
  Vec3 mm = Vec3::Ones();
  const std::string text = FindField(fields, name).value_or("");
  std::string_view rest = Trim(text);
  for (int axis = 0; axis < 3 && !rest.empty(); ++axis) {
    const bool quoted = rest.front() == '"';
    if (quoted) rest.remove_prefix(1);
    const std::string_view unit = rest.substr(0, rest.find_first_of(quoted ? "\"" : " \t"));
    const std::optional<double> known = MillimetresPer(Trim(unit));
    if (!known) *unknown_unit = Trim(unit);
    mm[axis] = known.value_or(1.0);
    rest.remove_prefix(std::min(rest.size(), unit.size() + (quoted ? 1 : 0)));
    rest = Trim(rest);
  }
  return mm;
}

ImageGeometry FromDirections(const NrrdFields& fields, const std::string& directions) {
  const auto vectors = ParseVectors(directions, "space directions");
  if (vectors.size() < 3) {
    Refuse("the NRRD header's space directions are fewer than three; correct the header");
  }
  ImageGeometry geometry;
  const std::optional<Vec3> to_lps = SignsOfLps(fields);
  geometry.is_lps = to_lps.has_value();
  const Vec3 signs = to_lps.value_or(Vec3::Ones())
                         .cwiseProduct(LengthUnits(fields, "spaceunits", &geometry.unknown_unit));
  for (int k = 0; k < 3; ++k) {
    const Vec3 step = signs.cwiseProduct(SpaceVector(vectors[k], "space directions"));
    geometry.spacing_mm[k] = step.norm();
    if (step.isZero(0.0)) {
      Refuse("the NRRD header's space directions give an axis no direction; correct the header");
    }
    CheckSpacing(step.norm());
    geometry.direction.col(k) = step / step.norm();
  }
  if (const auto origin = FindField(fields, "spaceorigin")) {
    auto numbers = ParseVector(Trim(*origin), "space origin");
    if (numbers.size() == 4) numbers.pop_back();  // the time of the first frame
    geometry.origin_W_mm = signs.cwiseProduct(SpaceVector(numbers, "space origin"));
  }
  return geometry;
}

// Returns the numbers of the first three axes, with NaN where the header gives none.
Vec3 PerAxis(const NrrdFields& fields, const char* name, const char* what) {
  Vec3 numbers = Vec3::Constant(std::nan(""));
  const std::string text = FindField(fields, name).value_or("");
  int axis = 0;
  for (const std::string_view word : Words(text)) {
    // Axes after the third have no place in space ("nan").
    if (axis < 3) numbers[axis++] = ParseReal(word, what);
  }
  return numbers;
}

ImageGeometry FromSpacings(const NrrdFields& fields, const std::array<std::int64_t, 3>& size,
                           bool spacing_is_given) {
  ImageGeometry geometry;
  const Vec3 mm = LengthUnits(fields, "units", &geometry.unknown_unit);
  const Vec3 mins = mm.cwiseProduct(PerAxis(fields, "axismins", "axis mins"));
  const Vec3 maxs = mm.cwiseProduct(PerAxis(fields, "axismaxs", "axis maxs"));
  const Vec3 spacings = mm.cwiseProduct(PerAxis(fields, "spacings", "spacings"));
  const std::string text =
      Lower(FindField(fields, "centers").value_or(FindField(fields, "centerings").value_or("")));
  const auto centers = Words(text);
  bool placed = mins.allFinite();
  Vec3 origin = mins;
  for (int k = 0; k < 3; ++k) {
    const bool node = centers.size() > static_cast<std::size_t>(k) && centers[k] == "node";
    const double steps = static_cast<double>(size[k] - (node ? 1 : 0));
    const double from_range = (maxs[k] - mins[k]) / steps;
    // NaN is what is not known.
    const bool stated = !std::isnan(spacings[k]) && !spacing_is_given;
    if (stated) CheckSpacing(std::abs(spacings[k]));
    const bool ranged = !stated && std::isfinite(from_range) && from_range > 0.0;
    if (stated || ranged) geometry.spacing_mm[k] = stated ? spacings[k] : from_range;
    if (spacing_is_given && spacings[k] < 0.0) geometry.spacing_mm[k] = -1.0;
    geometry.has_spacing = geometry.has_spacing && (stated || ranged);
    placed = placed && (stated || ranged);
    // In a cell-centred axis, the sample lies in the middle of the cell.
    if (!node) origin[k] += geometry.spacing_mm[k] / 2;
  }
  if (placed) geometry.origin_W_mm = origin;
  return geometry;
}

}  // namespace

ImageGeometry ParseNrrdGeometry(const NrrdFields& fields, const std::array<std::int64_t, 3>& size,
                                bool spacing_is_given) {
  const auto directions = FindField(fields, "spacedirections");
  return directions ? FromDirections(fields, *directions)
                    : FromSpacings(fields, size, spacing_is_given);
}

}  // namespace palpate
