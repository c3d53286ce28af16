#include "server/volume/save/volume_export.h"

#include <zlib.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <functional>
#include <ios>
#include <string>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "common/files/nrrd_header.h"
#include "server/volume/load/importer.h"
#include "server/volume/save/volume_pipe.h"
#include "server/volume/snapshot/grid_tree.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {
namespace {

// The smallest type that holds all voxels.
LeafType TypeOf(const BrickDirectory& bricks) {
  LeafType type = LeafType::kUint8;
  const Vec3i& count = bricks.brick_count();
  Vec3i b;
  for (b.x() = 0; b.x() < count.x(); ++b.x()) {
    for (b.y() = 0; b.y() < count.y(); ++b.y()) {
      for (b.z() = 0; b.z() < count.z(); ++b.z()) type = CommonType(type, bricks.At(b)->type());
    }
  }
  return type;
}

// Appends compressed data to a file.
class GzipTail {
 public:
  explicit GzipTail(const std::filesystem::path& path)
      // The fastest level: the other levels hardly make voxels smaller.
      : file_(gzopen(path.c_str(), "ab1")) {
    Check(file_ != nullptr);
    gzbuffer(file_, 1 << 20);
  }
  ~GzipTail() {
    if (file_) gzclose(file_);
  }
  GzipTail(const GzipTail&) = delete;
  GzipTail& operator=(const GzipTail&) = delete;

  template <class T>
  void Write(const std::vector<T>& values) {
    const std::size_t items = gzfwrite(values.data(), sizeof(T), values.size(), file_);
    Check(items == values.size());
  }
  void Close() {
    const gzFile file = file_;
    file_ = nullptr;
    Check(gzclose(file) == Z_OK);
  }

 private:
  static void Check(bool done) {
    if (!done) throw std::ios_base::failure("gzip");
  }
  gzFile file_;
};

// Fills in slice z, x fastest. T must hold every voxel.
template <class T>
void FillSlice(const VolumeSnapshot& volume, int z, std::vector<T>& slice) {
  const Vec3i& size = volume.size();
  const auto row = static_cast<std::size_t>(size.x());
  for (int x = 0; x < size.x(); x += kBrickEdge) {
    const int end = std::min(x + kBrickEdge, size.x());
    for (int y = 0; y < size.y(); ++y) {
      const Leaf& leaf = volume.bricks().Find(x, y, z);
      for (int i = x; i < end; ++i) {
        slice[static_cast<std::size_t>(y) * row + static_cast<std::size_t>(i)] =
            static_cast<T>(leaf[VoxelInBrick(i, y, z)]);
      }
    }
  }
}

template <class T>
void WriteVoxels(const VolumeSnapshot& volume, GzipTail& tail,
                 const std::function<void(double fraction)>& progress) {
  const Vec3i& size = volume.size();
  std::vector<T> slice(static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y()));
  for (int z = 0; z < size.z(); ++z) {
    progress(static_cast<double>(z) / size.z());
    FillSlice(volume, z, slice);
    tail.Write(slice);
  }
}

// Writes volumes as NRRD: one file, of the smallest leaf type that holds all voxels, gzip, lengths
// in mm. The header names a space (LPS) only if the volume's is known.
//
// Any thread; not for real-time code.
//
// Writes `path`, replacing its contents. `progress` is called with the share done; it may throw to
// cancel. Throws std::ios_base::failure if the file cannot be written.
void WriteNrrd(const std::filesystem::path& path, const VolumeSnapshot& volume,
               const std::function<void(double fraction)>& progress) {
  std::ofstream header;
  header.exceptions(std::ios::badbit | std::ios::failbit);
  header.open(path, std::ios::binary | std::ios::trunc);
  const LeafType type = TypeOf(volume.bricks());
  const VolumeMetadata& metadata = volume.metadata();
  header << ToText(NrrdHeader{.type = type == LeafType::kFloat ? "float" : std::string(Name(type)),
                              .encoding = "gzip",
                              .size = metadata.size,
                              .X_WI = metadata.WorldFromIndex(),
                              .is_lps = metadata.patient_axes == "LPS",
                              .unit = metadata.unit});
  header.close();
  GzipTail tail(path);
  VisitType(type, [&](auto voxel) { WriteVoxels<decltype(voxel)>(volume, tail, progress); });
  tail.Close();
}

enum class Format { kVdb, kNrrd };

std::string SuffixOf(const std::filesystem::path& path) {
  std::string suffix = path.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return suffix;
}

Format FormatOf(const std::filesystem::path& path) {
  const std::string suffix = SuffixOf(path);
  if (suffix == ".vdb") return Format::kVdb;
  if (suffix == ".nrrd") return Format::kNrrd;
  Refuse(path.string() + ": the name must end with .vdb or .nrrd, which says the format");
}

Format CheckedFormat(const ExportRequest& request) {
  const std::filesystem::path& path = request.path;
  if (path.native().find('\0') != std::string::npos) Refuse("the path holds a NUL character");
  if (!path.is_absolute()) Refuse(path.string() + ": the path must be absolute");
  const Format format = FormatOf(path);
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) Refuse(path.string() + " is a folder");
  if (!std::filesystem::is_directory(path.parent_path(), error)) {
    Refuse("there is no folder " + path.parent_path().string() + ": make it first");
  }
  // Checked before the work, and again at its end.
  if (!request.overwrite && std::filesystem::exists(path, error)) {
    throw Error(
        ErrorKind::kConflict,
        path.string() +
            " is there: allow to overwrite it (--overwrite, overwrite=True), or name another one");
  }
  return format;
}

void WriteVdb(const VolumeSnapshot& volume, const ExportRequest& request, int fd,
              const std::function<void(double)>& tell) {
  VolumeSender sender(volume.bricks(), volume.metadata());
  double fraction = 0.0;
  const auto on_line = [&](std::string_view line) {
    std::string_view stage;
    ParseProgress(line, fraction, stage);
  };
  const ChildEnd end =
      RunChild({.arguments = {request.save_program.string(), "--progress",
                              "--save-to-descriptor=" + std::to_string(kChildDescriptor), "--",
                              request.path.string()},
                .descriptor = fd,
                .input = [&] { return sender.Next(); },
                .on_line = on_line,
                .check = [&] { tell(fraction); }});
  ThrowUnlessSuccess(
      end, request.path.string(),
      "there is not enough memory to write it; save it as .nrrd, which needs none",
      "what writes .vdb crashed, for lack of memory or by a fault; save it as .nrrd");
}

}  // namespace

std::uint64_t ExportBytes(const VolumeSnapshot& volume, const std::filesystem::path& path) {
  if (SuffixOf(path) != ".vdb") return 0;
  const BrickDirectory& bricks = volume.bricks();
  const VolumeMetadata& metadata = volume.metadata();
  const GridForm* const form = metadata.grid_form.get();
  const auto background = static_cast<float>(metadata.Background());
  // A leaf of OpenVDB; its type is as wide as the file's.
  const bool is_wide = form && (form->type == "double" || form->type == "int64");
  const std::uint64_t leaf_bytes = Leaf::Bytes(LeafType::kFloat) * (is_wide ? 2 : 1);
  std::uint64_t bytes = form ? leaf_bytes * form->outer_leaves.size() : 0;
  for (std::uint64_t number = 0, end = bricks.brick_count().cast<std::int64_t>().prod();
       number < end; ++number) {
    const Leaf& leaf = *bricks.At(bricks.BrickOf(number));
    // In a grid, these leaves are tiles.
    const bool is_left_out = leaf.is_constant() && (form || leaf[0] == background);
    if (!is_left_out) bytes += leaf_bytes;
  }
  return bytes;
}

std::uint64_t ExportVolume(const VolumeSnapshot& volume, const ExportRequest& request,
                           const ExportProgress& progress, const ExportCancelled& cancelled) {
  const Format format = CheckedFormat(request);
  double told = -1.0;
  const auto tell = [&](double fraction) {
    if (cancelled()) {
      throw Error(ErrorKind::kCancelled, "saving was cancelled; there is no new file");
    }
    if (std::exchange(told, fraction) != fraction) progress("writing", fraction);
  };
  tell(0.0);
  const IfThere if_there = ReplacesIf(request.overwrite);
  if (format == Format::kVdb) {
    CheckVolumeMetadata(volume.metadata());
    NewFile file(request.path, if_there, 0666, Links::kRefused);
    WriteVdb(volume, request, file.descriptor(), tell);
    tell(1.0);
    file.TakeName();
  } else {
    const auto write = [&](const std::filesystem::path& partial) {
      WriteNrrd(partial, volume, tell);
      // Asks once more, so that a client that cancelled before the last moment finds no file.
      tell(1.0);
    };
    WriteWhole(request.path, write, if_there, Durable::kYes, Links::kRefused);
  }
  progress("done", 1.0);
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(request.path, error);
  return error ? 0 : bytes;
}

}  // namespace palpate
