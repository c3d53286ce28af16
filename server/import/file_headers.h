// The headers of the formats that are a header and voxels.
//
// Threads: pure functions, but for CheckedRawHeader, which reads the file's size. Errors:
// palpate::Error, see image_header.h.
#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

#include "server/import/image_header.h"
#include "server/volume/load/import_process.h"

namespace palpate {

// Parses NRRD headers (teem's format definition, NRRD0001 to NRRD0005): attached and detached,
// encodings raw and gzip, one data file.
//
// `head`: the first bytes of the file, at least up to the end of the header.
// `whole`: `head` is the whole file. `spacing_is_given`: the header's spacing does not matter.
ImageHeader ParseNrrdHeader(std::string_view head, bool whole, bool spacing_is_given = false);

constexpr std::size_t kNifti1HeaderBytes = 348;
constexpr std::size_t kNifti2HeaderBytes = 540;
constexpr std::size_t kLongestNiftiHeader = kNifti2HeaderBytes;

// Parses NIfTI headers that are in one file with the voxels ("n+1" of NIfTI-1, "n+2" of NIfTI-2),
// little and big endian.
//
// W is LPS and NIfTI is RAS, so x and y change their sign. The place of the voxels is that of the
// sform if its code is not 0, otherwise of the qform if its code is not 0. Without both, the axes
// are those of the index, and the header warns. It also warns if the qform, or the spacing in
// pixdim, disagrees with the sform. The nearest right angles replace a slight shear; a sform that
// is sheared by more than half a voxel is refused, unless it is `form`.
//
// `head`: the first bytes of the (inflated) file: kLongestNiftiHeader bytes, or all of the file.
// `form`: the user's choice, without warnings of what else the file says. `spacing_is_given`: the
// header's spacing does not matter. Values that nibabel repairs are repaired, with a warning.
ImageHeader ParseNiftiHeader(std::string_view head, const std::optional<NiftiForm>& form = {},
                             bool spacing_is_given = false);

// Parses MetaImage headers (.mha with the voxels after the header, .mhd with a data file).
//
// `head`: the first bytes of the file, at least up to the line ElementDataFile. `spacing_is_given`:
// the header's spacing does not matter.
ImageHeader ParseMetaImageHeader(std::string_view head, bool spacing_is_given = false);

// Files that hold only voxels. The caller describes the voxels in place of a header.
//
// Refuses a file whose size differs from the sum of the offset and the voxels.
ImageHeader CheckedRawHeader(const std::filesystem::path& path, const RawVoxels& raw,
                             const ImportLimits& limits);

}  // namespace palpate
