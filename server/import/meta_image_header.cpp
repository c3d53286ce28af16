#include "server/import/file_headers.h"

#include <cmath>
#include <initializer_list>
#include <map>
#include <string>
#include <vector>

#include "server/import/image_header.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {
namespace {

using MetaImageFields = std::map<std::string, std::string, std::less<>>;

// Reads fields up to ElementDataFile, which is always the last. Sets `end` to the byte after its
// line.
MetaImageFields ReadFields(std::string_view head, std::int64_t* end) {
  MetaImageFields fields;
  std::size_t at = 0;
  while (!fields.contains("ElementDataFile")) {
    const std::size_t newline = head.find('\n', at);
    const bool last = newline == std::string_view::npos;
    const std::string_view line =
        Trim(head.substr(at, last ? std::string_view::npos : newline - at));
    at = last ? head.size() : newline + 1;
    const std::size_t separator = line.find_first_of("=:");
    if (line.find('\0') != std::string_view::npos ||
        (!line.empty() && separator == std::string_view::npos)) {
      Refuse("this is no MetaImage file: " + Quoted(line) + " is not 'Name = value'");
    }
    if (!line.empty()) {
      const std::string name(Trim(line.substr(0, separator)));
      const bool is_new = fields.emplace(name, Trim(line.substr(separator + 1))).second;
      if (!is_new && name != "Comment") {
        Refuse("the MetaImage header states " + Quoted(name) + " twice; correct it");
      }
    }
    if (last) break;
  }
  *end = static_cast<std::int64_t>(at);
  return fields;
}

const std::string& Required(const MetaImageFields& fields, std::string_view name) {
  const auto field = fields.find(name);
  if (field == fields.end()) {
    Refuse("the MetaImage header has no " + std::string(name) +
           "; the file is damaged or incomplete");
  }
  return field->second;
}

bool Flag(const MetaImageFields& fields, std::string_view name, bool absent) {
  const auto field = fields.find(name);
  if (field == fields.end()) return absent;
  const std::string value = Lower(field->second);
  return value == "true" || value == "t" || value == "1";
}

std::int64_t Integer(const MetaImageFields& fields, std::string_view name, std::int64_t absent) {
  const auto field = fields.find(name);
  return field == fields.end() ? absent : ParseInteger(field->second, name);
}

ScalarType ParseElementType(const std::string& type) {
  // MetaIO's LONG has 32 bits, as on the machines of its time.
  static const std::map<std::string, ScalarType, std::less<>> kTypes = {
      {"MET_CHAR", ScalarType::kInt8},     {"MET_UCHAR", ScalarType::kUint8},
      {"MET_SHORT", ScalarType::kInt16},   {"MET_USHORT", ScalarType::kUint16},
      {"MET_INT", ScalarType::kInt32},     {"MET_UINT", ScalarType::kUint32},
      {"MET_FLOAT", ScalarType::kFloat32}, {"MET_DOUBLE", ScalarType::kFloat64},
  };
  const auto found = kTypes.find(type);
  if (found == kTypes.end()) {
    Refuse("voxels of type " + Quoted(type) +
           " are not supported; convert them to 8, 16 or 32 bit integers, float or double");
  }
  return found->second;
}

// The numbers of the first of these fields that is there; empty if none is.
std::vector<double> Numbers(const MetaImageFields& fields,
                            std::initializer_list<std::string_view> names, std::size_t count) {
  std::vector<double> numbers;
  for (const std::string_view name : names) {
    const auto field = fields.find(name);
    if (field == fields.end() || !numbers.empty()) continue;
    for (const std::string_view word : Words(field->second)) {
      numbers.push_back(ParseReal(word, name));
    }
    if (numbers.size() != count) {
      Refuse("the MetaImage header's " + std::string(name) + " needs " + std::to_string(count) +
             " numbers; correct it");
    }
  }
  return numbers;
}

// Where the axes of a volume in LPS come from, such as "RAI": along each, the nearest side.
std::string AnatomicalOf(const Mat3& direction) {
  std::string sides;
  for (int k = 0; k < 3; ++k) {
    Eigen::Index axis = 0;
    direction.col(k).cwiseAbs().maxCoeff(&axis);
    sides += (direction(axis, k) > 0.0 ? "RAI" : "LPS")[axis];
  }
  return sides;
}

// Each field has several names.
ImageGeometry ParseGeometry(const MetaImageFields& fields, std::size_t dimension,
                            bool spacing_is_given) {
  const auto spacing = Numbers(fields, {"ElementSpacing", "ElementSize"}, dimension);
  const auto origin = Numbers(fields, {"Offset", "Position", "Origin"}, dimension);
  const auto matrix =
      Numbers(fields, {"TransformMatrix", "Rotation", "Orientation"}, dimension * dimension);
  ImageGeometry geometry;
  geometry.has_spacing = !spacing.empty();
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    if (!origin.empty()) geometry.origin_W_mm[k] = origin[axis];
    if (!spacing.empty() && !spacing_is_given) {
      CheckSpacing(std::abs(spacing[axis]));
      geometry.spacing_mm[k] = spacing[axis];
    } else if (!spacing.empty() && spacing[axis] < 0.0) {
      geometry.spacing_mm[k] = -1.0;
    }
    // A row of the matrix is the direction of an axis.
    for (int row = 0; row < 3 && !matrix.empty(); ++row) {
      geometry.direction(row, k) = matrix[axis * dimension + static_cast<std::size_t>(row)];
    }
  }
  if (!geometry.origin_W_mm.allFinite() || !geometry.direction.allFinite()) {
    Refuse("the MetaImage header's place or TransformMatrix is not finite; correct it");
  }
  // MetaIO writes ??? for what it does not know. A TransformMatrix alone leads to a world that the
  // header does not place in a patient. ITK's files have both, and ITK's world is LPS.
  const auto anatomical = fields.find("AnatomicalOrientation");
  geometry.is_lps =
      anatomical != fields.end() && anatomical->second == AnatomicalOf(geometry.direction);
  return geometry;
}

void ReadElementDataPlace(const MetaImageFields& fields, std::int64_t header_end,
                          ImageHeader* header) {
  const std::string& name = Required(fields, "ElementDataFile");
  const std::string lower = Lower(name);
  const std::int64_t skip = Integer(fields, "HeaderSize", 0);
  header->compressed = Flag(fields, "CompressedData", false);
  if (header->compressed && fields.contains("CompressedDataSize")) {
    header->compressed_bytes = Integer(fields, "CompressedDataSize", 0);
    if (header->compressed_bytes < 0) {
      Refuse("CompressedDataSize is negative; correct the header");
    }
    // As some write who did not count.
    if (header->compressed_bytes == 0) header->compressed_bytes = ImageHeader::kToFileEnd;
  }
  if (lower == "local") {
    // As MetaIO: counted from the file's first byte, or -1 for voxels at its end.
    const bool is_behind = skip == 0 || skip >= header_end;
    if (header->compressed ? skip != 0 : !is_behind && skip != ImageHeader::kVoxelsAtEnd) {
      Refuse("HeaderSize " + std::to_string(skip) + " does not fit the data; correct the header");
    }
    header->begin = skip > 0 ? skip : header_end;
    if (skip == ImageHeader::kVoxelsAtEnd) header->skip_bytes = skip;
    return;
  }
  if (lower.starts_with("list") || name.find('%') != std::string::npos || Words(name).size() > 1) {
    Refuse("the MetaImage header lists several data files; join them into one file first");
  }
  CheckDataFileName(name);
  header->data_file = name;
  header->skip_bytes = skip;
  if (skip < (header->compressed ? 0 : -1) || (header->compressed && skip != 0)) {
    Refuse("HeaderSize " + std::to_string(skip) + " does not fit the data; correct the header");
  }
}

}  // namespace

ImageHeader ParseMetaImageHeader(std::string_view head, bool spacing_is_given) {
  std::int64_t header_end = 0;
  const MetaImageFields fields = ReadFields(head, &header_end);
  const std::int64_t dimension = ParseInteger(Required(fields, "NDims"), "NDims");
  if (dimension < 1 || dimension > 10) {
    Refuse("the MetaImage header's NDims is " + std::to_string(dimension) + "; correct it");
  }
  std::vector<std::int64_t> axes;
  for (const std::string_view word : Words(Required(fields, "DimSize"))) {
    axes.push_back(ParseInteger(word, "DimSize"));
  }
  if (static_cast<std::int64_t>(axes.size()) != dimension) {
    Refuse("the MetaImage header's NDims and DimSize disagree; correct it");
  }
  if (Integer(fields, "ElementNumberOfChannels", 1) != 1) {
    Refuse("every voxel has several values (ElementNumberOfChannels); extract one of them first");
  }
  if (!Flag(fields, "BinaryData", true)) {
    Refuse("MetaImage voxels as text are not supported; save them as BinaryData = True");
  }
  ImageHeader header;
  header.type = ParseElementType(Required(fields, "ElementType"));
  header.size = VolumeSize(axes);
  header.big_endian =
      Flag(fields, "ElementByteOrderMSB", false) || Flag(fields, "BinaryDataByteOrderMSB", false);
  header.geometry = ParseGeometry(fields, axes.size(), spacing_is_given);
  const auto anatomical = fields.find("AnatomicalOrientation");
  if (anatomical != fields.end() && IsPatientAxes(anatomical->second) && !header.geometry.is_lps) {
    header.warnings.push_back("AnatomicalOrientation " + anatomical->second +
                              " is not what its TransformMatrix says: left and right are unknown");
  }
  RepairSpacing(spacing_is_given, &header);
  ReadElementDataPlace(fields, header_end, &header);
  return header;
}

}  // namespace palpate
