// A lock that programs take on a file or a folder, until its owner goes or the program ends.
//
// Threads: any.
#pragma once

#include <chrono>
#include <filesystem>
#include <utility>

#include "common/files/descriptor.h"

namespace palpate {

enum class LockOf {
  kFile,  // which is made if need be, for its owner alone; no symbolic link
  kFolder,
};

enum class LockResult {
  kTaken,
  kHeldByAnother,
  kCannotOpen,  // errno says why
};

class FileLock {
 public:
  FileLock() = default;

  // Waits for the lock as long as `patience`.
  LockResult Take(const std::filesystem::path& path, LockOf kind,
                  std::chrono::milliseconds patience = {});

 private:
  Descriptor fd_;
};

}  // namespace palpate
