#include "server/import/image_header.h"

#include <Eigen/SVD>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <utility>

namespace palpate {

int ByteCount(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8:
    case ScalarType::kUint8:
      return 1;
    case ScalarType::kInt16:
    case ScalarType::kUint16:
      return 2;
    case ScalarType::kInt32:
    case ScalarType::kUint32:
    case ScalarType::kFloat32:
      return 4;
    case ScalarType::kFloat64:
      return 8;
  }
  return 8;
}

namespace {

constexpr std::pair<ScalarType, const char*> kTypeNames[] = {
    {ScalarType::kInt8, "int8"},       {ScalarType::kUint8, "uint8"},
    {ScalarType::kInt16, "int16"},     {ScalarType::kUint16, "uint16"},
    {ScalarType::kInt32, "int32"},     {ScalarType::kUint32, "uint32"},
    {ScalarType::kFloat32, "float32"}, {ScalarType::kFloat64, "float64"},
};

}  // namespace

const char* Name(ScalarType type) {
  for (const auto& [known, name] : kTypeNames) {
    if (known == type) return name;
  }
  return "";
}

ScalarType ParseScalarType(std::string_view name) {
  std::string names;
  for (const auto& [type, known] : kTypeNames) {
    if (name == known) return type;
    names += std::string(names.empty() ? "" : ", ") + known;
  }
  Refuse("there is no voxel type " + Quoted(name) + "; use one of " + names);
}

LeafType ReadType(const ImageHeader& header) {
  const bool is_scaled = header.slope != 1.0 || header.intercept != 0.0;
  return is_scaled ? LeafType::kFloat : LeafTypeNamed(Name(header.type)).value_or(LeafType::kFloat);
}

std::int64_t TakeFrames(std::vector<std::int64_t>* axes) {
  if (axes->size() < 4 || (*axes)[3] < 1) return 1;
  if (std::any_of(axes->begin() + 4, axes->end(), [](std::int64_t axis) { return axis != 1; })) {
    return 1;
  }
  if ((*axes)[3] > std::numeric_limits<std::int32_t>::max()) {
    Refuse("there are " + std::to_string((*axes)[3]) + " frames; correct the header");
  }
  return std::exchange((*axes)[3], 1);
}

void CheckFrame(std::int64_t frame, std::int64_t frames) {
  if (frame >= 0 && frame < frames) return;
  Refuse("there is no frame " + std::to_string(frame) + "; " +
         (frames > 1 ? "choose one from 0 to " + std::to_string(frames - 1)
                     : "the file holds one volume, frame 0"));
}

std::array<std::int64_t, 3> VolumeSize(const std::vector<std::int64_t>& axes) {
  std::string listed;
  for (const std::int64_t axis : axes) {
    listed += (listed.empty() ? "" : "x") + std::to_string(axis);
    if (axis < 1) Refuse("size " + std::to_string(axis) + " of an axis; correct the header");
  }
  if (axes.size() < 3) {
    Refuse("the image has " + std::to_string(axes.size()) + " axes (" + listed +
           "); a volume needs three");
  }
  if (std::any_of(axes.begin() + 3, axes.end(), [](std::int64_t axis) { return axis > 1; })) {
    Refuse("the image has more than three axes (" + listed + "); extract one volume of it first");
  }
  for (int k = 0; k < 3; ++k) {
    if (axes[k] < 2) {
      Refuse("the volume is " + listed + " voxels; every axis needs at least two");
    }
  }
  return {axes[0], axes[1], axes[2]};
}

std::int64_t CheckedVoxelBytes(const std::array<std::int64_t, 3>& size, ScalarType type,
                               LeafType read_type, const ImportLimits& limits) {
  const std::string listed = std::to_string(size[0]) + "x" + std::to_string(size[1]) + "x" +
                             std::to_string(size[2]) + " voxels";
  std::int64_t voxels = 0;
  const bool overflow = __builtin_mul_overflow(size[0], size[1], &voxels) ||
                        __builtin_mul_overflow(voxels, size[2], &voxels);
  constexpr std::int64_t kLongestAxis = std::numeric_limits<std::int32_t>::max() / 2;
  if (overflow || voxels > limits.max_voxels ||
      *std::max_element(size.begin(), size.end()) > kLongestAxis) {
    throw Error(ErrorKind::kTooLarge, listed + " are more than the limit of " +
                                          std::to_string(limits.max_voxels) +
                                          " voxels; crop or resample the volume");
  }
  // The peak is the greater of two: the file's voxels together with what a reader makes of them; or
  // the leaves (0.4 bytes more per voxel) together with the tree of floats that is written to a
  // file (4.4 bytes).
  const int bytes_per_voxel = ByteCount(type);
  const int peak = static_cast<int>(VoxelBytes(read_type)) + std::max(bytes_per_voxel, 5);
  std::int64_t memory = 0;
  if (__builtin_mul_overflow(voxels, peak, &memory) || memory > limits.max_memory_bytes) {
    throw Error(ErrorKind::kTooLarge, listed + " need about " +
                                          std::to_string(voxels / 1024 * peak / 1024 + 1) +
                                          " MiB of memory, the limit is " +
                                          std::to_string(limits.max_memory_bytes >> 20) +
                                          " MiB; crop or resample the volume, or raise the limit");
  }
  if (limits.on_size) limits.on_size(size, bytes_per_voxel);
  return voxels * bytes_per_voxel;
}

namespace {

struct LengthUnit {
  std::string_view name;
  double mm;
};
constexpr LengthUnit kLengthUnits[] = {
    {"mm", 1.0},          {"millimeter", 1.0},  {"millimetre", 1.0},  {"cm", 10.0},
    {"centimeter", 10.0}, {"centimetre", 10.0}, {"m", 1e3},           {"meter", 1e3},
    {"metre", 1e3},       {"um", 1e-3},         {"\u00b5m", 1e-3},    {"\u03bcm", 1e-3},
    {"micron", 1e-3},     {"micrometer", 1e-3}, {"micrometre", 1e-3}, {"nm", 1e-6},
    {"nanometer", 1e-6},  {"nanometre", 1e-6},  {"in", 25.4},         {"inch", 25.4},
    {"inche", 25.4},
};

}  // namespace

std::optional<double> MillimetresPer(std::string_view unit) {
  std::string name = Lower(unit);
  if (name.empty() || name == "none" || unit.starts_with("???")) return 1.0;
  if (name.size() > 5 && name.ends_with('s')) name.pop_back();
  for (const LengthUnit& known : kLengthUnits) {
    if (known.name == name) return known.mm;
  }
  return std::nullopt;
}

void CheckSpacing(double spacing) {
  if (!std::isfinite(spacing) || spacing <= 0.0) {
    Refuse("the voxel spacing " + std::to_string(spacing) +
           " is not a positive number; give it with --spacing-mm X,Y,Z");
  }
}

void CheckDataFileName(const std::string& name) {
  const std::filesystem::path path(name);
  const bool climbs = std::any_of(path.begin(), path.end(),
                                  [](const std::filesystem::path& part) { return part == ".."; });
  if (name.empty() || path.is_absolute() || climbs || name.find('\0') != std::string::npos) {
    Refuse(
        "the data file " + Quoted(name) +
        " lies outside of the header's folder; put both into one folder and name it without one");
  }
}

std::string_view Trim(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\n\v\f";
  const std::size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::string Lower(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return lower;
}

std::vector<std::string_view> Words(std::string_view text) {
  std::vector<std::string_view> words;
  for (text = Trim(text); !text.empty(); text = Trim(text)) {
    const std::string_view word = text.substr(0, text.find_first_of(" \t\r\n\v\f"));
    words.push_back(word);
    text.remove_prefix(word.size());
  }
  return words;
}

namespace {

template <typename Number>
Number Parse(std::string_view word, std::string_view what) {
  std::string_view digits = word;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);
  Number number{};
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  if (error != std::errc() || end != digits.data() + digits.size()) {
    Refuse("the header's " + std::string(what) + " holds " + Quoted(word) +
           " where a number belongs; correct the header");
  }
  return number;
}

}  // namespace

std::int64_t ParseInteger(std::string_view word, std::string_view what) {
  return Parse<std::int64_t>(word, what);
}

double ParseReal(std::string_view word, std::string_view what) { return Parse<double>(word, what); }

std::string Short(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", number);
  return text;
}

std::string ListOf(const Vec3& numbers) {
  return Short(numbers.x()) + " x " + Short(numbers.y()) + " x " + Short(numbers.z());
}

std::string Quoted(std::string_view text) {
  constexpr std::size_t kLongest = 80;
  std::string quoted = "'";
  for (const char c : text.substr(0, kLongest)) {
    const auto byte = static_cast<unsigned char>(c);
    quoted += byte < 0x20 || byte >= 0x7f ? '?' : c;
  }
  return quoted + (text.size() > kLongest ? "...'" : "'");
}

std::string FileName(const std::filesystem::path& file) { return Quoted(file.filename().string()); }

namespace {

Vec3 LastVoxel(const std::array<std::int64_t, 3>& size) {
  return Vec3(static_cast<double>(size[0]), static_cast<double>(size[1]),
              static_cast<double>(size[2])) -
         Vec3::Ones();
}

}  // namespace

AffineMap MapOf(const ImageGeometry& geometry) {
  return {geometry.direction * geometry.spacing_mm.asDiagonal(), geometry.origin_W_mm};
}

PlaceError FarthestCorner(const AffineMap& X_WI, const AffineMap& other_WI,
                          const std::array<std::int64_t, 3>& size) {
  const Vec3 last = LastVoxel(size);
  const Mat3 to_index = X_WI.linear.inverse();
  PlaceError greatest;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 at_I = last.cwiseProduct(Vec3(corner & 1, (corner >> 1) & 1, (corner >> 2) & 1));
    const Vec3 apart_mm = other_WI.Apply(at_I) - X_WI.Apply(at_I);
    const PlaceError error{(to_index * apart_mm).cwiseAbs().maxCoeff(), apart_mm.norm()};
    if (!std::isfinite(error.voxels + error.mm)) {
      return {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
    }
    greatest = {std::max(greatest.voxels, error.voxels), std::max(greatest.mm, error.mm)};
  }
  return greatest;
}

void RepairSpacing(bool spacing_is_given, ImageHeader* header) {
  ImageGeometry& geometry = header->geometry;
  if (!geometry.has_spacing && !spacing_is_given) {
    header->warnings.push_back(
        "the header does not state the spacing of each axis; 1 mm is taken where it is missing, "
        "give it with --spacing-mm");
  }
  for (int k = 0; k < 3; ++k) {
    if (geometry.spacing_mm[k] >= 0.0) continue;
    geometry.spacing_mm[k] *= -1.0;
    geometry.direction.col(k) *= -1.0;
    header->warnings.push_back("the spacing along " + std::string(1, "xyz"[k]) +
                               " is negative; the axis is turned around, as ITK does");
  }
}

PlaceError Straighten(const std::array<std::int64_t, 3>& size, ImageGeometry* geometry) {
  const AffineMap sheared = MapOf(*geometry);
  const Vec3 middle_I = 0.5 * LastVoxel(size);
  const Eigen::JacobiSVD<Mat3> svd(geometry->direction, Eigen::ComputeFullU | Eigen::ComputeFullV);
  geometry->direction = svd.matrixU() * svd.matrixV().transpose();
  geometry->origin_W_mm = sheared.Apply(middle_I) - MapOf(*geometry).linear * middle_I;
  return FarthestCorner(MapOf(*geometry), sheared, size);
}

}  // namespace palpate
