// The first bytes of a file as a file of their own, in memory: for a library that opens files by
// name and must not see the rest.
//
// Threads: any, one at a time. Errors: palpate::Error without the file's name.
#pragma once

#include <cstdint>
#include <filesystem>

namespace palpate {

class FileStart {
 public:
  FileStart(const std::filesystem::path& file, std::int64_t bytes);
  ~FileStart();
  FileStart(const FileStart&) = delete;
  FileStart& operator=(const FileStart&) = delete;

  // To be opened by this process, for as long as this object lives.
  std::filesystem::path path() const;

 private:
  int copy_ = -1;
};

}  // namespace palpate
