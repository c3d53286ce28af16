#include "server/import/file_start.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/sendfile.h>
#include <unistd.h>

#include <cerrno>
#include <string>

#include "server/import/image_header.h"

namespace palpate {
namespace {

bool Copy(int from, int to, std::int64_t bytes) {
  while (bytes > 0) {
    const ssize_t count = sendfile(to, from, nullptr, static_cast<std::size_t>(bytes));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    bytes -= count;
  }
  return true;
}

int FileInMemory() {
  static const int file = memfd_create("palpate-import", MFD_CLOEXEC);
  return file;
}

void Empty() { [[maybe_unused]] const int result = ftruncate(FileInMemory(), 0); }

}  // namespace

void FileStart::Reserve() { FileInMemory(); }

FileStart::FileStart(const std::filesystem::path& file, std::int64_t bytes) {
  const int from = open(file.c_str(), O_RDONLY | O_CLOEXEC);
  const int copy = FileInMemory();
  const bool copied = from >= 0 && lseek(copy, 0, SEEK_SET) == 0 && Copy(from, copy, bytes);
  if (from >= 0) close(from);
  if (copied) return;
  Empty();
  Refuse("the file cannot be read to its end; copy or export it again");
}

FileStart::~FileStart() { Empty(); }

std::filesystem::path FileStart::path() const {
  return "/proc/self/fd/" + std::to_string(FileInMemory());
}

}  // namespace palpate
