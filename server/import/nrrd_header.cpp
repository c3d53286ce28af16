#include "server/import/nrrd_header.h"

#include <cmath>
#include <map>
#include <optional>

namespace palpate {
namespace {

using Fields = std::map<std::string, std::string, std::less<>>;

constexpr std::size_t kLongestLine = 4096;

// Names without the blanks, which are optional in some of them.
std::string FieldName(std::string_view text) {
  std::string name;
  for (const char c : Lower(text)) {
    if (c != ' ') name += c;
  }
  return name;
}

void AddField(std::string_view line, Fields* fields) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos) {
    Refuse("the NRRD header has the line " + Quoted(line) + ", which is no field; correct it");
  }
  if (line.substr(colon).starts_with(":=")) return;  // a key and value: not ours to read
  const std::string name = FieldName(Trim(line.substr(0, colon)));
  if (!fields->emplace(name, Trim(line.substr(colon + 1))).second) {
    Refuse("the NRRD header states " + Quoted(name) + " twice; correct it");
  }
}

// Fields of the header; `end` is set behind its last line.
Fields ReadFields(std::string_view head, bool whole, std::int64_t* end) {
  Fields fields;
  std::size_t at = 0;
  for (bool first = true;; first = false) {
    const std::size_t newline = head.find('\n', at);
    const bool last = newline == std::string_view::npos;
    if (last && !whole) Refuse("the NRRD header is too long; is this an NRRD file?");
    std::string_view line = head.substr(at, last ? std::string_view::npos : newline - at);
    at = last ? head.size() : newline + 1;
    if (line.size() > kLongestLine) Refuse("the NRRD header has an overlong line; correct it");
    if (line.find('\0') != std::string_view::npos) Refuse("the NRRD header holds binary data");
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() && !first) break;
    if (!first && line[0] != '#') AddField(line, &fields);
    if (last || at >= head.size()) break;
  }
  *end = static_cast<std::int64_t>(at);
  return fields;
}

const std::string& Required(const Fields& fields, std::string_view name) {
  const auto field = fields.find(name);
  if (field == fields.end()) {
    Refuse("the NRRD header has no field '" + std::string(name) +
           "'; the file is damaged or incomplete");
  }
  return field->second;
}

std::optional<std::string> Find(const Fields& fields, std::string_view name,
                                std::string_view synonym = {}) {
  auto field = fields.find(name);
  if (field == fields.end() && !synonym.empty()) field = fields.find(synonym);
  return field == fields.end() ? std::nullopt : std::optional(field->second);
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

// One axis of "space directions": "none" or "(x,y,z)".
void CheckDirection(std::string_view vector) {
  if (vector == "none") return;
  if (vector.size() < 3 || vector.front() != '(' || vector.back() != ')') {
    Refuse("the NRRD header's space directions hold " + Quoted(vector) + "; correct the header");
  }
  vector = vector.substr(1, vector.size() - 2);
  double squared = 0.0;
  while (!vector.empty()) {
    const std::string_view number = vector.substr(0, vector.find(','));
    const double value = ParseReal(Trim(number), "space directions");
    squared += value * value;
    vector.remove_prefix(std::min(vector.size(), number.size() + 1));
  }
  CheckSpacing(std::sqrt(squared));
}

// Vectors may hold blanks after their commas.
void CheckDirections(const std::string& text) {
  std::string_view rest = Trim(text);
  while (!rest.empty()) {
    const std::size_t end = rest[0] == '(' ? rest.find(')') : rest.find_first_of(" \t");
    const std::string_view vector =
        rest.substr(0, end == std::string_view::npos || rest[0] != '(' ? end : end + 1);
    CheckDirection(vector);
    rest = Trim(rest.substr(vector.size()));
  }
}

void CheckGeometry(const Fields& fields) {
  if (const auto spacings = Find(fields, "spacings")) {
    int axis = 0;
    for (const std::string_view word : Words(*spacings)) {
      // Axes behind the third have no spacing ("nan").
      if (axis++ < 3) CheckSpacing(ParseReal(word, "spacings"));
    }
  }
  if (const auto directions = Find(fields, "spacedirections")) CheckDirections(*directions);
  if (const auto origin = Find(fields, "spaceorigin")) {
    const std::string lower = Lower(*origin);
    if (lower.find("nan") != std::string::npos || lower.find("inf") != std::string::npos) {
      Refuse("the NRRD header's space origin is not finite; correct the header");
    }
  }
}

void ReadEncoding(const Fields& fields, ImageHeader* header) {
  const std::string encoding = Lower(Required(fields, "encoding"));
  header->compressed = encoding == "gzip" || encoding == "gz";
  if (!header->compressed && encoding != "raw") {
    Refuse("the NRRD encoding " + Quoted(encoding) + " is not supported; use raw or gzip");
  }
  if (ByteCount(header->type) > 1) {
    const std::string endian = Lower(Required(fields, "endian"));
    if (endian != "little" && endian != "big") {
      Refuse("the NRRD header's endian is " + Quoted(endian) + "; it must be little or big");
    }
  }
}

void ReadDataPlace(const Fields& fields, std::int64_t header_end, ImageHeader* header) {
  if (const auto name = Find(fields, "datafile")) {
    if (name->starts_with("LIST") || name->find('%') != std::string::npos) {
      Refuse("the NRRD header lists several data files; join them into one file first");
    }
    CheckDataFileName(*name);
    header->data_file = *name;
  } else {
    header->begin = header_end;
  }
  const auto lines = Find(fields, "lineskip");
  if (lines && ParseInteger(*lines, "line skip") != 0) {
    Refuse("the NRRD field 'line skip' is not supported; use 'byte skip'");
  }
  const auto skip = Find(fields, "byteskip");
  if (skip) header->skip_bytes = ParseInteger(*skip, "byte skip");
  if (header->skip_bytes < (header->compressed ? 0 : -1)) {
    Refuse("the NRRD field 'byte skip' is " + Quoted(*skip) + "; correct the header");
  }
}

}  // namespace

ImageHeader ParseNrrdHeader(std::string_view head, bool whole) {
  if (head.size() < 9 || !head.starts_with("NRRD000") || head[7] < '1' || head[7] > '5' ||
      (head[8] != '\n' && head[8] != '\r')) {
    Refuse("this is no NRRD file: it does not start with NRRD0001 to NRRD0005");
  }
  std::int64_t header_end = 0;
  const Fields fields = ReadFields(head, whole, &header_end);

  const std::int64_t dimension = ParseInteger(Required(fields, "dimension"), "dimension");
  std::vector<std::int64_t> axes;
  for (const std::string_view word : Words(Required(fields, "sizes"))) {
    axes.push_back(ParseInteger(word, "sizes"));
  }
  if (dimension != static_cast<std::int64_t>(axes.size()) || dimension > 16) {
    Refuse("the NRRD header's dimension and sizes disagree; correct the header");
  }
  if (const auto kinds = Find(fields, "kinds"); kinds && dimension > 3) {
    const std::string first(Words(*kinds).empty() ? "" : Words(*kinds).front());
    if (first != "domain" && first != "space" && first != "???" && axes[0] > 1) {
      Refuse("every voxel is a " + Quoted(first) + " of several values; extract one of them first");
    }
  }

  ImageHeader header;
  header.type = ParseType(Required(fields, "type"));
  header.size = VolumeSize(axes);
  CheckGeometry(fields);
  ReadEncoding(fields, &header);
  ReadDataPlace(fields, header_end, &header);
  if (const auto unit = Find(fields, "sampleunits")) {
    header.unit = unit->size() > 1 && unit->front() == '"' && unit->back() == '"'
                      ? unit->substr(1, unit->size() - 2)
                      : *unit;
  }
  return header;
}

}  // namespace palpate
