#include "server/import/file_headers.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/import/image_header.h"

namespace palpate {
namespace {

// By name, in lower case and without blanks. In some names the blanks are optional.
using NrrdFields = std::map<std::string, std::string, std::less<>>;

std::string FieldName(std::string_view text) {
  std::string name;
  for (const char c : Lower(text)) {
    if (c != ' ') name += c;
  }
  return name;
}

void AddField(std::string_view line, NrrdFields* fields) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos) {
    Refuse("the NRRD header has the line " + Quoted(line) + ", which is no field; correct it");
  }
  if (line.substr(colon).starts_with(":=")) return;  // a key with a value, which we ignore
  const std::string name = FieldName(Trim(line.substr(0, colon)));
  if (!fields->emplace(name, Trim(line.substr(colon + 1))).second) {
    Refuse("the NRRD header states " + Quoted(name) + " twice; correct it");
  }
}

// `whole`: `head` is the whole file. Sets `end` to the byte after the header's last line.
NrrdFields ReadNrrdFields(std::string_view head, bool whole, std::int64_t* end) {
  NrrdFields fields;
  std::size_t at = 0;
  for (bool first = true;; first = false) {
    const std::size_t newline = head.find('\n', at);
    const bool last = newline == std::string_view::npos;
    if (last && !whole) Refuse("the NRRD header is too long; is this an NRRD file?");
    std::string_view line = head.substr(at, last ? std::string_view::npos : newline - at);
    at = last ? head.size() : newline + 1;
    if (line.find('\0') != std::string_view::npos) Refuse("the NRRD header holds binary data");
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() && !first) break;
    if (!first && line[0] != '#') AddField(line, &fields);
    if (last || at >= head.size()) break;
  }
  *end = static_cast<std::int64_t>(at);
  return fields;
}

const std::string& RequiredField(const NrrdFields& fields, std::string_view name) {
  const auto field = fields.find(name);
  if (field == fields.end()) {
    Refuse("the NRRD header has no field '" + std::string(name) +
           "'; the file is damaged or incomplete");
  }
  return field->second;
}

std::optional<std::string> FindField(const NrrdFields& fields, std::string_view name) {
  const auto field = fields.find(name);
  return field == fields.end() ? std::nullopt : std::optional(field->second);
}

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

// Computes the place of an NRRD file's voxels.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
//
// Uses the first three axes. Turns the frame into LPS if the header's space is RAS, LAS or LPS, and
// leaves any other space as it is: only these say where it lies in a patient. Lengths are in the
// header's units (space units, or units of axes without a space), or in mm if the header has none.
// A unit that is not known is left to the caller. A header without a space has only spacings; its
// axis mins give the place. A spacing may be negative (RepairSpacing). `spacing_is_given`: only
// their signs matter.
ImageGeometry ParseNrrdGeometry(const NrrdFields& fields, const std::array<std::int64_t, 3>& size,
                                bool spacing_is_given) {
  const auto directions = FindField(fields, "spacedirections");
  return directions ? FromDirections(fields, *directions)
                    : FromSpacings(fields, size, spacing_is_given);
}

ScalarType ParseType(const std::string& type) {
  static const std::map<std::string, ScalarType, std::less<>> kTypes = {
      {"signed char", ScalarType::kInt8},
      {"int8", ScalarType::kInt8},
      {"int8_t", ScalarType::kInt8},
      {"uchar", ScalarType::kUint8},
      {"unsigned char", ScalarType::kUint8},
      {"uint8", ScalarType::kUint8},
      {"uint8_t", ScalarType::kUint8},
      {"short", ScalarType::kInt16},
      {"short int", ScalarType::kInt16},
      {"signed short", ScalarType::kInt16},
      {"signed short int", ScalarType::kInt16},
      {"int16", ScalarType::kInt16},
      {"int16_t", ScalarType::kInt16},
      {"ushort", ScalarType::kUint16},
      {"unsigned short", ScalarType::kUint16},
      {"unsigned short int", ScalarType::kUint16},
      {"uint16", ScalarType::kUint16},
      {"uint16_t", ScalarType::kUint16},
      {"int", ScalarType::kInt32},
      {"signed int", ScalarType::kInt32},
      {"int32", ScalarType::kInt32},
      {"int32_t", ScalarType::kInt32},
      {"uint", ScalarType::kUint32},
      {"unsigned int", ScalarType::kUint32},
      {"uint32", ScalarType::kUint32},
      {"uint32_t", ScalarType::kUint32},
      {"float", ScalarType::kFloat32},
      {"double", ScalarType::kFloat64},
  };
  const auto found = kTypes.find(Lower(type));
  if (found == kTypes.end()) {
    Refuse("voxels of type " + Quoted(type) +
           " are not supported; convert them to 8, 16 or 32 bit integers, float or double");
  }
  return found->second;
}

void ReadEncoding(const NrrdFields& fields, ImageHeader* header) {
  const std::string encoding = Lower(RequiredField(fields, "encoding"));
  header->compressed = encoding == "gzip" || encoding == "gz";
  if (!header->compressed && encoding != "raw") {
    Refuse("the NRRD encoding " + Quoted(encoding) + " is not supported; use raw or gzip");
  }
  if (ByteCount(header->type) > 1) {
    const std::string endian = Lower(RequiredField(fields, "endian"));
    header->big_endian = endian == "big";
    if (endian != "little" && endian != "big") {
      Refuse("the NRRD header's endian is " + Quoted(endian) + "; it must be little or big");
    }
  }
}

void ReadDataPlace(const NrrdFields& fields, std::int64_t header_end, ImageHeader* header) {
  if (const auto name = FindField(fields, "datafile")) {
    if (name->starts_with("LIST") || name->find('%') != std::string::npos) {
      Refuse("the NRRD header lists several data files; join them into one file first");
    }
    CheckDataFileName(*name);
    header->data_file = *name;
  } else {
    header->begin = header_end;
  }
  const auto lines = FindField(fields, "lineskip");
  if (lines && ParseInteger(*lines, "line skip") != 0) {
    Refuse("the NRRD field 'line skip' is not supported; use 'byte skip'");
  }
  const auto skip = FindField(fields, "byteskip");
  if (skip) header->skip_bytes = ParseInteger(*skip, "byte skip");
  if (header->skip_bytes < (header->compressed ? 0 : -1)) {
    Refuse("the NRRD field 'byte skip' is " + Quoted(*skip) + "; correct the header");
  }
}

bool IsOneOf(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

// Sizes alone do not distinguish a series from voxels with several values. The kinds must.
void CheckKinds(const NrrdFields& fields, const std::vector<std::int64_t>& axes) {
  const std::string text = FindField(fields, "kinds").value_or("");
  const auto kinds = Words(text);
  const std::string first = Lower(kinds.empty() ? "" : kinds.front());
  if (!kinds.empty() && axes.size() > 3 && axes[0] > 1 &&
      !IsOneOf(first, {"domain", "space", "???"})) {
    Refuse("every voxel is a " + Quoted(first) + " of several values; extract one of them first");
  }
  const bool series = axes.size() > 3 && axes[3] > 1;
  if (series && (kinds.size() < 4 || !IsOneOf(Lower(kinds[3]), {"time", "list"}))) {
    Refuse(
        "the image has more than three axes, and the header does not say that the last one is "
        "time; extract one volume, or add 'kinds: domain domain domain time' if it is");
  }
}

void ReadSizes(const NrrdFields& fields, ImageHeader* header) {
  const std::int64_t dimension = ParseInteger(RequiredField(fields, "dimension"), "dimension");
  std::vector<std::int64_t> axes;
  for (const std::string_view word : Words(RequiredField(fields, "sizes"))) {
    axes.push_back(ParseInteger(word, "sizes"));
  }
  if (dimension != static_cast<std::int64_t>(axes.size()) || dimension > 16) {
    Refuse("the NRRD header's dimension and sizes disagree; correct the header");
  }
  CheckKinds(fields, axes);
  header->frames = TakeFrames(&axes);
  header->size = VolumeSize(axes);
}

}  // namespace

ImageHeader ParseNrrdHeader(std::string_view head, bool whole, bool spacing_is_given) {
  if (head.size() < 9 || !head.starts_with("NRRD000") || head[7] < '1' || head[7] > '5' ||
      (head[8] != '\n' && head[8] != '\r')) {
    Refuse("this is no NRRD file: it does not start with NRRD0001 to NRRD0005");
  }
  std::int64_t header_end = 0;
  const NrrdFields fields = ReadNrrdFields(head, whole, &header_end);

  ImageHeader header;
  header.type = ParseType(RequiredField(fields, "type"));
  ReadSizes(fields, &header);
  header.geometry = ParseNrrdGeometry(fields, header.size, spacing_is_given);
  RepairSpacing(spacing_is_given, &header);
  ReadEncoding(fields, &header);
  ReadDataPlace(fields, header_end, &header);
  if (const auto unit = FindField(fields, "sampleunits")) {
    header.unit = unit->size() > 1 && unit->front() == '"' && unit->back() == '"'
                      ? unit->substr(1, unit->size() - 2)
                      : *unit;
  }
  return header;
}

}  // namespace palpate
