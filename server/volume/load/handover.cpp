#include "server/volume/load/handover.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <thread>

#include "common/error/error.h"
#include "server/volume/load/tree_handover.h"
#include "server/volume/load/value_range.h"

namespace palpate {

void RefuseHandover(const std::string& what) {
  throw Error(ErrorKind::kInvalidArgument,
              "the importer's result is not a valid volume (" + what + "): the file is damaged");
}

void FailHandover(const char* what) {
  const bool no_room = errno == ENOMEM || errno == ENOSPC || errno == EFBIG;
  const bool no_files = errno == EMFILE || errno == ENFILE;
  throw Error(no_room || no_files ? ErrorKind::kTooLarge : ErrorKind::kInternal,
              std::string(what) + ": " + std::strerror(errno) +
                  (no_room ? "; crop the volume or raise the limit of memory" : ""));
}

void WriteHandoverAt(int fd, const void* data, std::size_t size, std::int64_t offset) {
  const char* bytes = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t count = pwrite(fd, bytes, size, offset);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) FailHandover("cannot hand the volume over");
    bytes += count;
    offset += count;
    size -= static_cast<std::size_t>(count);
  }
}

void ReadHandoverAt(int fd, void* data, std::size_t size, std::int64_t offset) {
  char* bytes = static_cast<char*>(data);
  while (size > 0) {
    const ssize_t count = pread(fd, bytes, size, offset);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) FailHandover("cannot take the volume over");
    bytes += count;
    offset += count;
    size -= static_cast<std::size_t>(count);
  }
}

namespace {

template <std::size_t kSize>
void PutText(const std::string& text, char (&out)[kSize]) {
  std::memcpy(out, text.data(), std::min(text.size(), kSize - 1));
}

template <std::size_t kSize>
std::string TextOf(const char (&text)[kSize]) {
  const auto* const end = static_cast<const char*>(std::memchr(text, 0, kSize));
  if (!end) RefuseHandover("a text without an end");
  return {text, end};
}

// -0 counts as 0.
bool IsOf(LeafType type, double value) {
  return std::abs(value) <= std::numeric_limits<float>::max() &&
         Holds(type, static_cast<float>(value) + 0.0f);
}

HandoverHeader ReadHeader(int fd) {
  struct stat status {};
  if (fstat(fd, &status) != 0) FailHandover("cannot look at the hand-over");
  HandoverHeader header;
  if (status.st_size < kHandoverVoxels) RefuseHandover("no header");
  ReadHandoverAt(fd, &header, sizeof header, 0);
  if (std::memcmp(header.magic, HandoverHeader::kMagic, sizeof header.magic) != 0) {
    RefuseHandover("another format");
  }
  if (header.type >= std::size(kLeafTypes)) RefuseHandover("an unknown type of voxels");
  return header;
}

struct Contents {
  VolumeMetadata metadata;
  LeafType type = LeafType::kFloat;
  std::int64_t layer_bytes = 0;  // of one layer of z
};

Contents CheckDense(int fd, const HandoverHeader& header, VolumeMetadata metadata,
                    std::int64_t max_voxels) {
  Contents contents{.metadata = std::move(metadata), .type = kLeafTypes[header.type]};
  CheckVolumeMetadata(contents.metadata);
  const auto size = contents.metadata.size.cast<std::int64_t>().eval();
  std::int64_t voxels = 0;
  if (__builtin_mul_overflow(size.x() * size.y(), size.z(), &voxels) || voxels > max_voxels) {
    throw Error(ErrorKind::kTooLarge, "there are more than " + std::to_string(max_voxels) +
                                          " voxels; crop or resample the volume");
  }
  const auto voxel_bytes = static_cast<std::int64_t>(VoxelBytes(contents.type));
  contents.layer_bytes = size.x() * size.y() * voxel_bytes;
  struct stat status {};
  if (fstat(fd, &status) != 0) FailHandover("cannot look at the hand-over");
  if (status.st_size != kHandoverVoxels + voxels * voxel_bytes) {
    RefuseHandover("not as many voxels as stated");
  }
  if (!IsOf(contents.type, contents.metadata.value_min) ||
      !IsOf(contents.type, contents.metadata.value_max)) {
    RefuseHandover("a range that its type cannot hold");
  }
  return contents;
}

class RangeCheck {
 public:
  explicit RangeCheck(const VolumeMetadata& metadata) : metadata_(metadata) {}

  template <class T>
  void Add(const T* voxels, std::size_t count) {
    if constexpr (std::is_floating_point_v<T>) {
      const bool finite =
          std::all_of(voxels, voxels + count, [](T voxel) { return std::isfinite(voxel); });
      if (!finite) RefuseHandover("voxels that are no finite numbers");
    }
    const auto [least, greatest] = RangeOf(voxels, count);
    least_ = std::min(least_, static_cast<double>(least));
    greatest_ = std::max(greatest_, static_cast<double>(greatest));
  }

  void Finish() const {
    if (least_ != metadata_.value_min || greatest_ != metadata_.value_max) {
      RefuseHandover("a range other than the voxels' range");
    }
  }

 private:
  const VolumeMetadata& metadata_;
  double least_ = std::numeric_limits<double>::infinity();
  double greatest_ = -least_;
};

// Reports progress at most a hundred times, however many rows there are.
class StepwiseProgress {
 public:
  StepwiseProgress(const std::function<void(double)>& progress, std::int64_t rows)
      : progress_(progress), rows_(rows) {}

  // Call it before reading this many more rows.
  void Add(std::int64_t rows) {
    const std::int64_t percent = 100 * done_ / rows_;
    if (progress_ && percent != told_) progress_(static_cast<double>(percent) / 100.0);
    told_ = percent;
    done_ += rows;
  }

 private:
  const std::function<void(double)>& progress_;
  const std::int64_t rows_;
  std::int64_t done_ = 0;
  std::int64_t told_ = -1;
};

// The kernel refuses the seal while anybody may write, and also briefly while the kernel itself
// moves pages.
bool Seal(int fd) {
  constexpr int kTries = 40;
  for (int n = 0; n < kTries; ++n) {
    if (fcntl(fd, F_ADD_SEALS, F_SEAL_WRITE | F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) == 0) {
      return true;
    }
    if (errno != EBUSY) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

}  // namespace

Descriptor MakeHandoverFile() {
  Descriptor file(memfd_create("palpate-volume", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  if (file.get() < 0) FailHandover("cannot make a file in memory");
  return file;
}

HandoverHeader MakeHandoverHeader(const VolumeMetadata& metadata, LeafType type) {
  HandoverHeader header{};
  std::memcpy(header.magic, HandoverHeader::kMagic, sizeof header.magic);
  header.type = static_cast<std::uint32_t>(type);
  header.frames = metadata.frames;
  for (int row = 0; row < 3; ++row) {
    header.size[row] = metadata.size[row];
    header.spacing_mm[row] = metadata.spacing_mm[row];
    header.origin_W_mm[row] = metadata.origin_W_mm[row];
    for (int col = 0; col < 3; ++col)
      header.direction[3 * row + col] = metadata.direction(row, col);
  }
  header.value_min = metadata.value_min;
  header.value_max = metadata.value_max;
  header.window_level = metadata.window_level;
  header.window_width = metadata.window_width;
  header.tree.is_level_set = metadata.is_level_set;
  PutText(metadata.patient_axes, header.patient_axes);
  PutText(metadata.unit, header.unit);
  PutText(metadata.original_type, header.original_type);
  PutText(metadata.source, header.source);
  return header;
}

VolumeMetadata MetadataOf(const HandoverHeader& header) {
  VolumeMetadata metadata;
  metadata.frames = header.frames;
  for (int row = 0; row < 3; ++row) {
    metadata.size[row] = header.size[row];
    metadata.spacing_mm[row] = header.spacing_mm[row];
    metadata.origin_W_mm[row] = header.origin_W_mm[row];
    for (int col = 0; col < 3; ++col)
      metadata.direction(row, col) = header.direction[3 * row + col];
  }
  metadata.value_min = header.value_min;
  metadata.value_max = header.value_max;
  metadata.window_level = header.window_level;
  metadata.window_width = header.window_width;
  metadata.is_level_set = header.tree.is_level_set != 0;
  metadata.patient_axes = TextOf(header.patient_axes);
  metadata.unit = TextOf(header.unit);
  metadata.original_type = TextOf(header.original_type);
  metadata.source = TextOf(header.source);
  return metadata;
}

namespace {

LoadedVolume TakeDense(int fd, const Contents& contents, const TakeOptions& options) {
  const Vec3i& size = contents.metadata.size;
  if (options.on_size) options.on_size(size, DenseLoadMemory(size, contents.type));
  RangeCheck range(contents.metadata);
  StepwiseProgress progress(options.progress, std::int64_t{size.y()} * size.z());
  const auto read = [&](int z, int first_y, int end_y, void* rows) {
    progress.Add(end_y - first_y);
    const auto row_bytes = contents.layer_bytes / size.y();
    const auto bytes = static_cast<std::size_t>((end_y - first_y) * row_bytes);
    ReadHandoverAt(fd, rows, bytes,
                   kHandoverVoxels + z * contents.layer_bytes + first_y * row_bytes);
    VisitType(contents.type, [&](auto voxel) {
      range.Add(static_cast<const decltype(voxel)*>(rows), bytes / sizeof voxel);
    });
  };
  LoadedVolume volume{
      contents.metadata,
      MakeBricks(size, contents.type, read, static_cast<float>(contents.metadata.Background()))};
  range.Finish();
  return volume;
}

}  // namespace

LoadedVolume TakeHandover(int fd, const TakeOptions& options) {
  // Seals first, so that checked data cannot change afterwards. Fails if somebody may still write.
  if (!Seal(fd)) RefuseHandover("it can still be changed");
  const HandoverHeader header = ReadHeader(fd);
  VolumeMetadata metadata = MetadataOf(header);
  switch (static_cast<HandoverForm>(header.form)) {
    case HandoverForm::kDense:
      return TakeDense(fd, CheckDense(fd, header, std::move(metadata), options.max_voxels),
                       options);
    case HandoverForm::kTree:
      return TakeTree(fd, header, std::move(metadata), options);
  }
  RefuseHandover("an unknown form");
}

}  // namespace palpate
