#include "server/session/series/series.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include "common/error/error.h"
#include "server/client_paths/series_files.h"
#include "server/volume/snapshot/brick_pool.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate {
namespace {

std::string Text(const Vec3i& size) {
  return std::to_string(size.x()) + "x" + std::to_string(size.y()) + "x" + std::to_string(size.z());
}

// Reads the frames one after the other.
class Reader {
 public:
  Reader(const VolumeLoader& loader, std::span<const std::filesystem::path> files,
         const LoadRequest& request, const LoadProgress& progress, const LoadCancelled& cancelled,
         std::vector<std::string>& warnings, const BrickWork& work)
      : loader_(loader),
        files_(files),
        request_(request),
        progress_(progress),
        cancelled_(cancelled),
        warnings_(warnings),
        work_(work) {}

  LoadedSeries Read() {
    count_ = files_.size();
    claim_ = loader_.budget->Claim("the series", 0);
    ReadFrame(0);
    if (files_.size() == 1) {
      count_ = static_cast<std::size_t>(metadata_.frames);
      if (count_ < 2) {
        Refuse(files_[0].string() + ": there is one frame in it; a series needs two or more");
      }
      CheckFrames(count_);
      Claim(frame_memory_);
    }
    while (frames_.size() < count_) ReadFrame(frames_.size());
    return Finish();
  }

 private:
  // Claims memory for all later frames and the one being read, each as large as the largest so far.
  void Claim(const LoadMemory& frame) {
    frame_memory_.volume_bytes = std::max(frame_memory_.volume_bytes, frame.volume_bytes);
    frame_memory_.passing_bytes = std::max(frame_memory_.passing_bytes, frame.passing_bytes);
    ClaimRest(0);
  }

  // Reduces the claim by the bytes that the next frame has already made.
  void ClaimRest(std::uint64_t made_bytes) {
    claim_.Resize((count_ - frames_.size() + 1) * frame_memory_.volume_bytes +
                  frame_memory_.passing_bytes - std::min(made_bytes, frame_memory_.volume_bytes));
  }

  void ReadFrame(std::size_t frame) {
    LoadRequest request{.source = files_[files_.size() == 1 ? 0 : frame],
                        .spacing_mm = request_.spacing_mm,
                        .raw = request_.raw,
                        .grid = request_.grid,
                        .component = request_.component};
    request.frame = files_.size() == 1 ? static_cast<std::int64_t>(frame) : 0;
    const std::uint64_t before = work_.most_bytes();
    const auto progress = [&](std::string_view stage, double fraction) {
      ClaimRest(work_.most_bytes() - before);
      progress_("frame " + std::to_string(frame + 1) + ": " + std::string(stage),
                (static_cast<double>(frame) + fraction) / static_cast<double>(count_));
    };
    std::vector<std::string> warnings;
    LoadedVolume volume = loader_.Load(request, progress, cancelled_, warnings,
                                       [&](const Vec3i& size, const LoadMemory& memory) {
                                         CheckSize(request.source, size);
                                         Claim(memory);
                                       });
    // Keeps only the first frame's warnings: all frames have about the same.
    if (frame == 0) warnings_.insert(warnings_.end(), warnings.begin(), warnings.end());
    Take(volume, request.source);
    ClaimRest(0);
  }

  // Called before the voxels are read.
  void CheckSize(const std::string& source, const Vec3i& size) {
    if (!frames_.empty() && size != metadata_.size) RefuseSize(source, size);
  }

  [[noreturn]] void RefuseSize(const std::string& source, const Vec3i& size) const {
    Refuse(source + ": " + Text(size) + " voxels where the first frame has " +
           Text(metadata_.size) + "; all frames must have one size");
  }

  void Take(const LoadedVolume& volume, const std::string& source) {
    if (files_.size() > 1 && volume.metadata.frames != 1) {
      Refuse(source + ": the file has several frames; give only this file, or files with one " +
             "frame each");
    }
    if (frames_.empty()) {
      metadata_ = volume.metadata;
      // Frames share one lattice. A frame is saved like a volume that did not come from a .vdb
      // file.
      metadata_.grid_form = nullptr;
    } else if (volume.metadata.is_level_set != metadata_.is_level_set) {
      Refuse(source + ": level sets and densities cannot be frames of one series");
    } else if (volume.metadata.size != metadata_.size) {
      RefuseSize(source, volume.metadata.size);
    }
    metadata_.value_min = std::min(metadata_.value_min, volume.metadata.value_min);
    metadata_.value_max = std::max(metadata_.value_max, volume.metadata.value_max);
    // Finish sets the final background beyond the lattice, when the range of all frames is known.
    frames_.push_back(pool_->Share(volume.bricks, metadata_.size,
                                   static_cast<float>(volume.metadata.Background())));
    if (cancelled_()) throw Error(ErrorKind::kCancelled, "loading was cancelled");
  }

  LoadedSeries Finish() {
    pool_.emplace();
    const auto background = static_cast<float>(metadata_.Background());
    for (BrickDirectory& frame : frames_) frame = pool_->Share(frame, metadata_.size, background);
    metadata_.frames = static_cast<int>(frames_.size());
    const std::uint64_t bytes = MemoryBytes(frames_, metadata_.size);
    return {metadata_, std::move(frames_), bytes};
  }

  const VolumeLoader& loader_;
  const std::span<const std::filesystem::path> files_;
  const LoadRequest& request_;
  const LoadProgress& progress_;
  const LoadCancelled& cancelled_;
  std::vector<std::string>& warnings_;
  const BrickWork& work_;

  std::size_t count_ = 0;
  VolumeMetadata metadata_;
  std::vector<BrickDirectory> frames_;
  std::optional<BrickPool> pool_{std::in_place};
  LoadMemory frame_memory_;
  MemoryClaim claim_;
};

}  // namespace

LoadedSeries LoadSeries(const VolumeLoader& loader, std::span<const std::filesystem::path> files,
                        const LoadRequest& request, const LoadProgress& progress,
                        const LoadCancelled& cancelled, std::vector<std::string>& warnings,
                        const BrickWork& work) {
  return Reader(loader, files, request, progress, cancelled, warnings, work).Read();
}

BrickDirectory Blend(const BrickDirectory& from, const BrickDirectory& to, double share,
                     const std::function<void(std::uint64_t bytes)>& bytes_known) {
  std::vector<BrickChange> changes = from.ChangesTo(to);
  if (bytes_known) {
    const Vec3i last = from.brick_count() - Vec3i::Ones();
    bytes_known(changes.size() * Leaf::Bytes(LeafType::kFloat) +
                BrickDirectory::BlockBytes(Vec3i::Zero(), last));
  }
  for (BrickChange& change : changes) {
    const Brick start = from.At(change.brick)->Floats();
    const Brick end = change.values->Floats();
    Brick blended;
    for (int n = 0; n < kBrickVoxels; ++n) {
      blended[n] = static_cast<float>((1.0 - share) * start[n] + share * end[n]);
    }
    change.values = Leaf::Of(LeafType::kFloat, blended);
  }
  return from.With(changes, 1);
}

}  // namespace palpate
