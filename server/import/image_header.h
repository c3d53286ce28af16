// The facts of a volume file that the importer needs before a library reads the file: the size, the
// scalar type and the place of the voxels. Our own parsers read them, because libraries report
// truncated files as read, allocate as much as a header asks for, and crash on long fields.
//
// Pure values and functions. Threads: any. Not for real-time code. Errors: palpate::Error whose
// what() says "what is wrong; what to do", without the file's name.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/bricks/leaf_type.h"
#include "common/error/error.h"
#include "common/files/own_files.h"
#include "common/geometry/geometry.h"

namespace palpate {

enum class ScalarType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

int ByteCount(ScalarType type);
// Returns "int8", ..., "float64".
const char* Name(ScalarType type);
ScalarType ParseScalarType(std::string_view name);  // takes the result of Name()

// Ends a warning about a file.
inline constexpr char kReadOtherwise[] =
    "; earlier versions read this file otherwise: say again where the patient faces, and do not "
    "replay old recordings of it";

// The place of a file's voxels: maps index to W (mm, LPS).
struct ImageGeometry {
  Vec3 spacing_mm = Vec3::Ones();
  bool has_spacing = true;  // else 1 mm is assumed along an axis
  Vec3 origin_W_mm = Vec3::Zero();
  Mat3 direction = Mat3::Identity();  // columns: unit vectors, except in a sheared file
  bool is_lps = false;                // the file says where W lies in the patient
  // What the file states as the unit of length, if it is none that is known; mm are taken.
  std::string unknown_unit{};
};

// The data stream holds `skip_bytes` and then the voxels, x fastest, one frame after the other. The
// stream starts at `begin` of its file. The whole stream may be deflated (gzip or zlib). The value
// of a voxel is intercept + slope * voxel.
struct ImageHeader {
  static constexpr std::int64_t kVoxelsAtEnd = -1;  // a value of skip_bytes
  static constexpr std::int64_t kToFileEnd = -1;    // a value of compressed_bytes

  std::array<std::int64_t, 3> size{};  // voxels along x, y, z, each at least 2
  std::int64_t frames = 1;
  ScalarType type = ScalarType::kUint8;
  bool big_endian = false;
  double slope = 1.0;
  double intercept = 0.0;
  ImageGeometry geometry;
  std::string data_file;  // a name below the header's folder; empty: the header's own file
  std::int64_t begin = 0;
  std::int64_t skip_bytes = 0;
  bool compressed = false;
  std::int64_t compressed_bytes = kToFileEnd;
  bool may_be_longer = false;  // a deflated stream may have more bytes after the voxels
  std::string unit;            // of the values, as the file states it
  std::vector<std::string> warnings{};
};

// Returns the type in which the file's voxels are read: the file's own if leaves have that type and
// the values are not scaled, otherwise float.
LeafType ReadType(const ImageHeader& header);

// A place of the voxels that a NIfTI file may state; kNone: the axes of the index.
enum class NiftiForm { kQform, kSform, kNone };

struct ImportLimits {
  // Called with a size within the limits and the bytes of a file's voxel, before memory is
  // allocated. For a stack of slices it is called again and again while the slices are counted. May
  // be empty.
  std::function<void(const std::array<std::int64_t, 3>& size, int bytes_per_voxel)> on_size{};
  // Called with the value of pixels that are no picture (padding), which are read as NaN. May be
  // empty.
  std::function<void(float value)> on_padding{};
  std::int64_t max_voxels = std::int64_t{1} << 31;
  std::int64_t max_memory_bytes = std::int64_t{16} << 30;
  // Real paths. Files that a source refers to (slices, voxels of a detached header) must lie below
  // one of these folders after links are followed. Empty: anywhere.
  std::vector<std::filesystem::path> folders{};
  // Files that are refused, whatever link leads to them.
  OwnFiles own_files{};
  bool spacing_is_given = false;  // the file's own does not matter
  // What the user says the values are: first + second * the file's.
  std::optional<std::array<double, 2>> rescale{};
  std::optional<NiftiForm> form{};  // the user's choice; none: as the file says
  std::string series{};             // the SeriesInstanceUID to read; empty: the largest
  std::string acquisition{};        // the number of the pass to read, or "all"; empty: the largest
  bool may_resample = true;         // unevenly spaced slices; otherwise they are refused
};

// Takes the axes as a header lists them. If the fourth axis has frames and no axis follows, sets
// the fourth axis to 1 and returns the number of frames; otherwise returns 1.
std::int64_t TakeFrames(std::vector<std::int64_t>* axes);

// Refuses a frame that the file does not have.
void CheckFrame(std::int64_t frame, std::int64_t frames);

// Takes the axes as a header lists them. Accepts three axes of at least 2 voxels, followed only by
// axes of size 1.
std::array<std::int64_t, 3> VolumeSize(const std::vector<std::int64_t>& axes);

// Returns the bytes of the file's voxels. Throws kTooLarge if the volume exceeds the limits, before
// memory is allocated for it.
std::int64_t CheckedVoxelBytes(const std::array<std::int64_t, 3>& size, ScalarType type,
                               LeafType read_type, const ImportLimits& limits);

// Of "mm", "micron", "inches", ... Without a name, or "none": 1. None: it is no known unit.
std::optional<double> MillimetresPer(std::string_view unit);

// Refuses a spacing that is not a positive finite number.
void CheckSpacing(double spacing);

// Refuses a detached data file that is not below the header's own folder.
void CheckDataFileName(const std::string& name);

// For the text formats. `what` names the field in the message.
std::string_view Trim(std::string_view text);
std::string Lower(std::string_view text);
std::vector<std::string_view> Words(std::string_view text);
std::int64_t ParseInteger(std::string_view word, std::string_view what);
double ParseReal(std::string_view word, std::string_view what);  // accepts NaN and infinity
// Few digits, for a message.
std::string Short(double number);
std::string ListOf(const Vec3& numbers);  // "1 x 2 x 3"
// Prepares text of a file for a message: shortened, without control characters.
std::string Quoted(std::string_view text);
// Without its folder, quoted.
std::string FileName(const std::filesystem::path& file);

// A voxel counts as off by the axis along which it is farthest from its place, in voxels. Up to
// kSlightlyOff nothing is said. Beyond kFarOff the place is wrong.
inline constexpr double kSlightlyOff = 0.1;
inline constexpr double kFarOff = 0.5;

// Compares places of a file's voxels, and puts axes at right angles.
//
// Frames: I voxel index, W world (mm). Pure. Threads: any. Errors: none.
struct PlaceError {
  double voxels = 0.0;
  double mm = 0.0;
};

// Maps the index to W.
AffineMap MapOf(const ImageGeometry& geometry);

// How far the two places of a corner voxel are from each other at most, in voxels of X_WI. Infinite
// if the places are not finite.
PlaceError FarthestCorner(const AffineMap& X_WI, const AffineMap& other_WI,
                          const std::array<std::int64_t, 3>& size);

// Turns an axis with a negative spacing around, as ITK does, and warns. Warns of a spacing that is
// assumed, unless the user states it.
void RepairSpacing(bool spacing_is_given, ImageHeader* header);

// Replaces axes that are not at right angles by the nearest ones that are; spacing and the volume's
// middle stay. Returns how far that moves a corner voxel at most.
PlaceError Straighten(const std::array<std::int64_t, 3>& size, ImageGeometry* geometry);

}  // namespace palpate
