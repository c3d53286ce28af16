// Reads the formats whose voxels we read ourselves.
#include "server/import/file_headers.h"
#include "server/import/readers.h"
#include "server/import/tiff_stack.h"
#include "server/import/value_checks.h"
#include "server/import/voxel_reader.h"

namespace palpate {
namespace {

constexpr double kCheckedShare = 0.2;  // of the import's progress
constexpr double kReadShare = 0.8;

VolumeMetadata MetadataOf(const ImageHeader& header) {
  VolumeMetadata metadata;
  for (int k = 0; k < 3; ++k) metadata.size[k] = static_cast<int>(header.size[k]);
  metadata.spacing_mm = header.geometry.spacing_mm;
  metadata.origin_W_mm = header.geometry.origin_W_mm;
  metadata.direction = header.geometry.direction;
  if (header.geometry.is_lps) metadata.patient_axes = "LPS";
  metadata.frames = static_cast<int>(header.frames);
  metadata.unit = header.unit;
  metadata.original_type = Name(header.type);
  return metadata;
}

// A file may count in voxels. Another unit that is not known may be a thousand times as long as mm.
void CheckUnit(const std::string& unit, const ImportLimits& limits, Reporter* reporter) {
  if (unit.empty() || limits.spacing_is_given) return;
  const std::string name = Lower(unit);
  if (name != "pixel" && name != "pixels" && name != "voxel" && name != "voxels") {
    Refuse("the header's unit of length is " + Quoted(unit) +
           ", which is not known; correct it, or give the spacing: --spacing-mm X,Y,Z");
  }
  reporter->Warn("the unit of length is " + Quoted(unit) +
                 ", which is no length; mm are taken, give the spacing with --spacing-mm");
}

// `read` delivers the voxels.
VolumeMetadata ReadChecked(const ImageHeader& header, const ImportLimits& limits,
                           const VoxelSink& sink, Reporter* reporter,
                           const std::function<void(const VoxelSink&)>& read) {
  VolumeMetadata metadata = MetadataOf(header);
  if (header.unit != "HU" || limits.rescale) {
    read(sink);
    return metadata;
  }
  HounsfieldCheck check;
  read(check.Watching(sink));
  check.Judge(false, true, &metadata.unit, reporter);
  return metadata;
}

VolumeMetadata ReadFrame(const std::filesystem::path& path, const ImageHeader& header,
                         std::int64_t frame, const ImportLimits& limits, const VoxelSink& sink,
                         Reporter* reporter) {
  reporter->Progress(kCheckedShare, "reading");
  return ReadChecked(header, limits, sink, reporter,
                     [&](const VoxelSink& checked) { ReadVoxels(path, header, frame, checked); });
}

}  // namespace

VolumeMetadata ReadPlainVolume(const std::filesystem::path& path, ImageFormat format,
                               const std::optional<std::int64_t>& frame, const ImportLimits& limits,
                               const VoxelSink& sink, Reporter* reporter) {
  reporter->Progress(0.0, "checking");
  const ImageHeader header = ReadCheckedHeader(path, format, limits);
  CheckUnit(header.geometry.unknown_unit, limits, reporter);
  for (const std::string& warning : header.warnings) reporter->Warn(warning);
  CheckFrame(frame.value_or(0), header.frames);
  if (!frame && header.frames > 1) {
    reporter->Warn("there are " + std::to_string(header.frames) +
                   " frames; the first is read, choose another one with --frame");
  }
  return ReadFrame(path, header, frame.value_or(0), limits, sink, reporter);
}

VolumeMetadata ReadRawVolume(const std::filesystem::path& path, const RawVoxels& raw,
                             const ImportLimits& limits, const VoxelSink& sink,
                             Reporter* reporter) {
  reporter->Progress(0.0, "checking");
  return ReadFrame(path, CheckedRawHeader(path, raw, limits), 0, limits, sink, reporter);
}

VolumeMetadata ReadTiffVolume(const std::filesystem::path& input, const ImportLimits& limits,
                              const VoxelSink& sink, Reporter* reporter) {
  reporter->Progress(0.0, "checking");
  const TiffStack stack = OpenTiffStack(input, limits);
  if (!stack.states_spacing && !limits.spacing_is_given) {
    Refuse(
        "the file states no spacing along x, y and z, as only ImageJ and OME do in TIFF; give it: "
        "--spacing-mm X,Y,Z");
  }
  for (const std::string& warning : stack.header.warnings) reporter->Warn(warning);
  const auto progress = [reporter](double fraction) {
    reporter->Progress(kCheckedShare + (kReadShare - kCheckedShare) * fraction, "reading");
  };
  progress(0.0);
  return ReadChecked(stack.header, limits, sink, reporter,
                     [&](const VoxelSink& checked) { ReadTiffVoxels(stack, progress, checked); });
}

}  // namespace palpate
