// The first bytes of a file as a file of their own, in memory: for a library that opens files by
// name and must not see the rest.
//
// Threads: any; one object at a time. Errors: palpate::Error without the file's name.
#pragma once

#include <cstdint>
#include <filesystem>

namespace palpate {

class FileStart {
 public:
  // Makes the file in memory that the objects use in turn. Confine() forbids to make one: call this
  // before it. Without Confine() there is no need to.
  static void Reserve();

  FileStart(const std::filesystem::path& file, std::int64_t bytes);
  ~FileStart();
  FileStart(const FileStart&) = delete;
  FileStart& operator=(const FileStart&) = delete;

  // To be opened by this process, for as long as this object lives.
  std::filesystem::path path() const;
};

}  // namespace palpate
