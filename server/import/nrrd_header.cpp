#include "server/import/nrrd_header.h"

#include <algorithm>
#include <initializer_list>
#include <map>

#include "server/import/image_geometry.h"
#include "server/import/nrrd_fields.h"
#include "server/import/nrrd_geometry.h"

namespace palpate {
namespace {

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
