#include "server/recording/recording_output.h"

#include <unistd.h>

#include <chrono>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "server/recording/chunk_frame.h"

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
  // Cuts the file after its last complete chunk. If this fails, too, the checksum shows readers
  // that a chunk is cut.
  void TakeBack() {
    if (ftruncate(file_.descriptor(), size_) == 0) lseek(file_.descriptor(), size_, SEEK_SET);
  }

  NewFile file_;
  const std::function<std::chrono::steady_clock::time_point()> now_;
  off_t size_ = 0;
  std::chrono::steady_clock::time_point synced_{};
};

bool IsRecording(const std::filesystem::path& path) {
  std::string start(kRecordingMagic.size(), '\0');
  std::ifstream file(path, std::ios::binary);
  return file.read(start.data(), static_cast<std::streamsize>(start.size())) &&
         start == kRecordingMagic;
}

}  // namespace

std::unique_ptr<RecordingOutput> CreateRecordingFile(
    const std::filesystem::path& path, bool overwrite,
    std::function<std::chrono::steady_clock::time_point()> now) {
  if (overwrite && std::filesystem::exists(path) && !IsRecording(path)) {
    throw Error(ErrorKind::kConflict, path.string() +
                                          ": this is no recording, and stays; name "
                                          "another file");
  }
  return std::make_unique<RecordingFile>(path, overwrite, std::move(now));
}

}  // namespace palpate
