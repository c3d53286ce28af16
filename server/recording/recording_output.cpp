#include "server/recording/recording_output.h"

#include <sys/statvfs.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "server/recording/recording_reader.h"

namespace palpate {
namespace {

constexpr std::chrono::seconds kSyncPeriod{1};

class RecordingFile final : public RecordingOutput {
 public:
  RecordingFile(std::filesystem::path path, bool overwrite,
                std::function<std::chrono::steady_clock::time_point()> now)
      : file_(std::move(path), ReplacesIf(overwrite), 0666, Links::kRefused),
        now_(std::move(now)) {}

  void Append(std::string_view bytes) override {
    const auto now = now_();
    const bool had_name = file_.has_name();
    try {
      file_.Write(bytes);
      if (!file_.has_name()) {
        file_.TakeName();
        synced_ = now;
      } else if (now - synced_ > kSyncPeriod) {
        file_.Sync();
        synced_ = now;
      }
    } catch (const Error&) {
      // A file that got its name in this call is complete, even if a later step failed.
      if (had_name || !file_.has_name()) TakeBack();
      throw;
    }
    size_ += static_cast<off_t>(bytes.size());
  }

  void Sync() override { file_.Sync(); }

 private:
  // Cuts the file after its last complete chunk. If this fails, too, its length shows readers that
  // a chunk is cut.
  void TakeBack() {
    if (ftruncate(file_.descriptor(), size_) == 0) lseek(file_.descriptor(), size_, SEEK_SET);
  }

  NewFile file_;
  const std::function<std::chrono::steady_clock::time_point()> now_;
  off_t size_ = 0;
  std::chrono::steady_clock::time_point synced_{};
};

bool IsRecording(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return BeginsAsRecording(file);
}

// A recording that ends within seconds is of no use, and its client may notice too late.
void CheckRoom(const std::filesystem::path& path, std::uint64_t voxel_bytes) {
  struct statvfs disk {};
  const bool is_known =
      statvfs(std::filesystem::absolute(path).parent_path().c_str(), &disk) == 0 &&
      disk.f_blocks > 0;
  const std::uint64_t free_bytes = std::uint64_t{disk.f_bavail} * disk.f_frsize;
  if (!is_known || free_bytes >= kLeastRoomBytes + voxel_bytes) return;
  throw Error(
      ErrorKind::kDiskFull,
      "cannot record to " + path.string() + ": its disk has only " +
          std::to_string(free_bytes >> 20) + " MiB left, and a recording takes about 11 a " +
          "minute" +
          (voxel_bytes > 0 ? " and " + std::to_string(voxel_bytes >> 20) + " for the volume" : "") +
          "; make space, or name another folder");
}

}  // namespace

std::unique_ptr<RecordingOutput> CreateRecordingFile(
    const std::filesystem::path& path, bool overwrite, std::uint64_t voxel_bytes,
    std::function<std::chrono::steady_clock::time_point()> now) {
  if (overwrite && std::filesystem::exists(path) && !IsRecording(path)) {
    throw Error(ErrorKind::kConflict, path.string() +
                                          ": this is no recording, and stays; name "
                                          "another file");
  }
  CheckRoom(path, voxel_bytes);
  return std::make_unique<RecordingFile>(path, overwrite, std::move(now));
}

}  // namespace palpate
