// A file with the bytes of a fuzz target, for code that needs a path. In memory if the system has a
// folder in memory.
#pragma once

#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string>

#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {

class ScratchFile {
 public:
  // The file is alone in its folder. The folder has no digits in its name; the destructor removes
  // it.
  explicit ScratchFile(const std::string& name) {
    std::string folder = std::filesystem::is_directory("/dev/shm") ? "/dev/shm" : P_tmpdir;
    folder += "/palpate-fuzz-XXXXXX";
    FUZZ_CHECK(mkdtemp(folder.data()));
    folder_ = folder;
    path_ = folder_ / name;
  }
  ~ScratchFile() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  // Replaces the contents.
  void Write(std::span<const std::uint8_t> bytes) const {
    const int file = open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    FUZZ_CHECK(file >= 0);
    FUZZ_CHECK(write(file, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()));
    close(file);
  }

  std::string Read() const {
    std::ifstream in(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path folder_;
  std::filesystem::path path_;
};

}  // namespace palpate::fuzz
