// Copies the first bytes of a file into a file in memory, for a library that opens files by name
// and must not see the rest.
//
// Threads: any; one object at a time. Errors: palpate::Error without the file's name.
#pragma once

#include <cstdint>
#include <filesystem>

namespace palpate {

class FileStart {
 public:
  // Makes the file in memory that all objects use in turn. Call it before Confine(), which forbids
  // to make one. Without Confine() the call is not needed.
  static void Reserve();

  FileStart(const std::filesystem::path& file, std::int64_t bytes);
  ~FileStart();
  FileStart(const FileStart&) = delete;
  FileStart& operator=(const FileStart&) = delete;

  // A path that this process can open while this object lives.
  std::filesystem::path path() const;
};

}  // namespace palpate
