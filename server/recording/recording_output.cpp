#include "server/recording/recording_output.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <string>
#include <system_error>
#include <utility>

#include "common/error/error.h"
#include "server/volume/whole_file.h"

namespace palpate {
namespace {

constexpr std::chrono::seconds kSyncPeriod{1};

class RecordingFile final : public RecordingOutput {
 public:
  RecordingFile(std::filesystem::path path, bool overwrite,
                std::function<std::chrono::steady_clock::time_point()> now)
      : path_(std::move(path)),
        partial_(path_.string() + ".partial"),
        overwrite_(overwrite),
        now_(std::move(now)) {
    std::error_code ignored;
    if (!overwrite_ && std::filesystem::exists(path_, ignored)) RefuseToOverwrite();
    RefuseLink(partial_);
    file_ = open(partial_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (file_ < 0) Fail();
  }

  ~RecordingFile() override {
    close(file_);
    if (!named_) unlink(partial_.c_str());
  }
  RecordingFile(const RecordingFile&) = delete;
  RecordingFile& operator=(const RecordingFile&) = delete;

  void Append(std::string_view bytes) override {
    std::string_view rest = bytes;
    while (!rest.empty()) {
      const ssize_t written = write(file_, rest.data(), rest.size());
      if (written >= 0) {
        rest.remove_prefix(static_cast<std::size_t>(written));
      } else if (errno != EINTR) {
        TakeBackAndFail();
      }
    }
    const auto now = now_();
    if (!named_ || now - synced_ > kSyncPeriod) {
      if (fdatasync(file_) != 0) TakeBackAndFail();
      synced_ = now;
    }
    size_ += static_cast<off_t>(bytes.size());
    if (!named_) TakeName();
  }

  void Sync() override {
    if (fdatasync(file_) != 0) Fail();
  }

 private:
  void TakeName() {
    if (overwrite_) {
      if (rename(partial_.c_str(), path_.c_str()) != 0) Fail();
    } else if (renameat2(AT_FDCWD, partial_.c_str(), AT_FDCWD, path_.c_str(), RENAME_NOREPLACE) !=
               0) {
      if (errno == EEXIST) RefuseToOverwrite();
      if (errno != EINVAL) Fail();
      ClaimAndRename();
    }
    named_ = true;
    SyncFolder();
  }

  // Where the file system (NFS) cannot rename without replacing.
  void ClaimAndRename() {
    const int claim = open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (claim < 0 && errno == EEXIST) RefuseToOverwrite();
    if (claim < 0) Fail();
    close(claim);
    if (rename(partial_.c_str(), path_.c_str()) != 0) Fail();
  }

  // So that the name outlives a power cut, too, where the file system can do that.
  void SyncFolder() const {
    const std::filesystem::path folder = std::filesystem::absolute(path_).parent_path();
    const int directory = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (directory < 0) return;
    fsync(directory);
    close(directory);
  }

  // Leaves the file with its last whole chunk.
  [[noreturn]] void TakeBackAndFail() {
    const int reason = errno;
    // Where this fails too, readers see by its checksum that a chunk is cut.
    if (ftruncate(file_, size_) == 0) lseek(file_, size_, SEEK_SET);
    errno = reason;
    Fail();
  }

  [[noreturn]] void Fail() const {
    const int reason = errno;
    const bool full = reason == ENOSPC || reason == EDQUOT || reason == EFBIG;
    throw Error(ErrorKind::kUnavailable,
                "cannot write " + path_.string() + ": " + std::generic_category().message(reason) +
                    (full ? "; make space, or record elsewhere" : "; may this user write there?"));
  }

  [[noreturn]] void RefuseToOverwrite() const {
    throw Error(ErrorKind::kConflict,
                path_.string() + " is there already: give another name, or ask to overwrite it");
  }

  const std::filesystem::path path_;
  const std::filesystem::path partial_;
  const bool overwrite_;
  const std::function<std::chrono::steady_clock::time_point()> now_;
  int file_ = -1;
  off_t size_ = 0;
  std::chrono::steady_clock::time_point synced_{};
  bool named_ = false;
};

}  // namespace

std::unique_ptr<RecordingOutput> CreateRecordingFile(
    const std::filesystem::path& path, bool overwrite,
    std::function<std::chrono::steady_clock::time_point()> now) {
  return std::make_unique<RecordingFile>(path, overwrite, std::move(now));
}

}  // namespace palpate
