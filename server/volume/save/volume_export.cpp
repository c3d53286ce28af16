#include "server/volume/save/volume_export.h"

#include <algorithm>
#include <cctype>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "server/volume/load/importer.h"
#include "server/volume/save/nrrd_writer.h"
#include "server/volume/save/volume_pipe.h"
#include "server/volume/snapshot/grid_form.h"

namespace palpate {
namespace {

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
