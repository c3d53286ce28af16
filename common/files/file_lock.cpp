#include "common/files/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>

#include <thread>

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kPause{20};

}  // namespace

LockResult FileLock::Take(const std::filesystem::path& path, LockOf kind,
                          std::chrono::milliseconds patience) {
  Descriptor fd(kind == LockOf::kFolder
                    ? open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)
                    : open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (fd.get() < 0) return LockResult::kCannotOpen;
  const auto end = Clock::now() + patience;
  while (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    if (Clock::now() >= end) return LockResult::kHeldByAnother;
    std::this_thread::sleep_for(kPause);
  }
  fd_ = std::move(fd);
  return LockResult::kTaken;
}

}  // namespace palpate
