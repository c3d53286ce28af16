#include "server/import/data_check.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <vector>

#include "server/import/file_headers.h"
#include "server/import/voxel_reader.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestTextHeader = 1 << 20;
constexpr std::size_t kCheckedBytes = 1 << 18;
constexpr std::int64_t kLongestData = std::int64_t{1} << 60;

std::ifstream Open(const fs::path& path) {
  CheckReadable(path);
  std::ifstream in(path, std::ios::binary);
  if (!in) Refuse("the file cannot be opened");
  return in;
}

std::string ReadHead(const fs::path& path, std::size_t count) {
  std::ifstream in = Open(path);
  std::string head(count, '\0');
  in.read(head.data(), static_cast<std::streamsize>(count));
  head.resize(static_cast<std::size_t>(in.gcount()));
  return head;
}

bool IsDeflated(std::string_view head) { return head.starts_with("\x1f\x8b"); }

ImageHeader ReadNiftiHeader(const fs::path& path, const ImportLimits& limits) {
  std::string head = ReadHead(path, kLongestNiftiHeader);
  const bool compressed = IsDeflated(head);
  if (compressed) {
    std::ifstream in = Open(path);
    Inflater inflater(&in, 0, static_cast<std::int64_t>(fs::file_size(path)));
    head.assign(kLongestNiftiHeader, '\0');
    head.resize(inflater.Read(head.data(), head.size()));
  }
  ImageHeader header = ParseNiftiHeader(head, limits.form, limits.spacing_is_given);
  header.compressed = compressed;
  return header;
}

ImageHeader ReadHeader(const fs::path& path, ImageFormat format, const ImportLimits& limits) {
  if (fs::file_size(path) == 0) Refuse("the file is empty");
  if (format == ImageFormat::kNifti) return ReadNiftiHeader(path, limits);
  const std::string head = ReadHead(path, kLongestTextHeader);
  return format == ImageFormat::kNrrd
             ? ParseNrrdHeader(head, head.size() < kLongestTextHeader, limits.spacing_is_given)
             : ParseMetaImageHeader(head, limits.spacing_is_given);
}

[[noreturn]] void RefuseLength(std::int64_t present, std::int64_t needed) {
  Refuse("there are " + std::to_string(present) + " bytes of voxels where the header needs " +
         std::to_string(needed) +
         (present < needed ? "; the file is truncated" : "; the header does not fit the data"));
}

void CheckCompressed(const fs::path& path, std::int64_t length, const ImageHeader& header,
                     std::int64_t needed) {
  std::ifstream in = Open(path);
  Inflater inflater(&in, header.begin, length);
  std::vector<char> sink(kCheckedBytes);
  std::int64_t present = 0;
  for (;;) {
    const auto count = static_cast<std::int64_t>(inflater.Read(sink.data(), sink.size()));
    present += count;
    if (count == 0) break;
    // Reads to the stream's end, which carries the checksum. A decompression bomb is not read to
    // its end.
    if (present > needed && !header.may_be_longer) RefuseLength(present, needed);
    if (present > 2 * needed + (1 << 20)) break;
  }
  if (present < needed)
    RefuseLength(present - std::min(present, header.skip_bytes), needed - header.skip_bytes);
}

// All frames must be there, not only the requested one.
void CheckData(const fs::path& path, const ImageHeader& header, const ImportLimits& limits) {
  const std::int64_t frame_bytes =
      CheckedVoxelBytes(header.size, header.type, ReadType(header), limits);
  const fs::path data = header.data_file.empty() ? path : path.parent_path() / header.data_file;
  if (!header.data_file.empty() && !fs::exists(data)) {
    throw Error(ErrorKind::kNotFound, "the data file " + Quoted(header.data_file) +
                                          " is missing; put it into the header's folder");
  }
  CheckPlace(data, limits);
  CheckReadable(data);
  const std::int64_t length = static_cast<std::int64_t>(fs::file_size(data)) - header.begin;
  const bool at_end = header.skip_bytes == ImageHeader::kVoxelsAtEnd;
  std::int64_t voxel_bytes = 0;
  std::int64_t needed = 0;
  if (__builtin_mul_overflow(frame_bytes, header.frames, &voxel_bytes) ||
      __builtin_add_overflow(voxel_bytes, at_end ? 0 : header.skip_bytes, &needed) ||
      needed > kLongestData) {
    Refuse("the header needs more bytes than a file can have; correct it");
  }
  if (!header.compressed) {
    if (length < needed)
      RefuseLength(std::max<std::int64_t>(length - (needed - voxel_bytes), 0), voxel_bytes);
    return;
  }
  if (header.compressed_bytes > length) RefuseLength(length, header.compressed_bytes);
  const bool whole = header.compressed_bytes == ImageHeader::kToFileEnd;
  CheckCompressed(data, whole ? length : header.compressed_bytes, header, needed);
}

}  // namespace

void CheckPlace(const fs::path& file, const ImportLimits& limits) {
  std::error_code error;
  const fs::path real = fs::weakly_canonical(file, error);
  const auto holds = [&](const fs::path& folder) {
    const fs::path below = real.lexically_relative(folder);
    return !below.empty() && *below.begin() != "..";
  };
  if (!limits.folders.empty() && limits.own_files.Hold(file)) {
    throw Error(
        ErrorKind::kPermissionDenied,
        file.filename().string() + " is palpated's own, or the kernel's; name another file");
  }
  if (limits.folders.empty() || (!error && std::ranges::any_of(limits.folders, holds))) return;
  throw Error(ErrorKind::kPermissionDenied,
              file.filename().string() +
                  " is a link that leads out of the folders that may be read "
                  "(volume.load_folders of palpated's configuration); put the file itself there");
}

void CheckReadable(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (status.type() == fs::file_type::not_found) {
    throw Error(ErrorKind::kNotFound, "there is no such file; check its name");
  }
  if (error == std::errc::permission_denied || access(path.c_str(), R_OK) != 0) {
    throw Error(ErrorKind::kPermissionDenied,
                "the file may not be read; give this user the permission");
  }
  if (error) Refuse("the file cannot be read: " + error.message());
  if (status.type() != fs::file_type::regular) Refuse("this is not a regular file");
}

ImageHeader ReadCheckedHeader(const fs::path& path, ImageFormat format,
                              const ImportLimits& limits) {
  CheckReadable(path);
  const ImageHeader header = ReadHeader(path, format, limits);
  CheckData(path, header, limits);
  return header;
}

ImageHeader CheckedRawHeader(const std::filesystem::path& path, const RawVoxels& raw,
                             const ImportLimits& limits) {
  CheckReadable(path);
  ImageHeader header;
  header.type = ParseScalarType(raw.type);
  header.size = VolumeSize({raw.size.begin(), raw.size.end()});
  header.big_endian = raw.big_endian;
  header.skip_bytes = raw.offset_bytes;
  if (raw.offset_bytes < 0) Refuse("the offset of raw voxels is negative; correct it");
  const std::int64_t voxel_bytes =
      CheckedVoxelBytes(header.size, header.type, ReadType(header), limits);
  std::int64_t needed = 0;
  const auto present = static_cast<std::int64_t>(std::filesystem::file_size(path));
  if (__builtin_add_overflow(raw.offset_bytes, voxel_bytes, &needed) || needed != present) {
    Refuse("the file has " + std::to_string(present) + " bytes where an offset of " +
           std::to_string(raw.offset_bytes) + " and " + std::to_string(voxel_bytes) +
           " bytes of voxels are stated; correct size, type or offset");
  }
  return header;
}

}  // namespace palpate
