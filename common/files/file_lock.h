// A lock on a file or a folder. It lasts until the owner is destroyed or the program ends.
//
// Threads: any.
#pragma once

#include <chrono>
#include <filesystem>
#include <utility>

#include "common/files/descriptor.h"

namespace palpate {

enum class LockOf {
  kFile,  // made if missing, accessible only to its owner; not a symbolic link
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

  // Waits for the lock for at most `patience`.
  LockResult Take(const std::filesystem::path& path, LockOf kind,
                  std::chrono::milliseconds patience = {});

 private:
  Descriptor fd_;
};

}  // namespace palpate
