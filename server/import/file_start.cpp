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

}  // namespace

FileStart::FileStart(const std::filesystem::path& file, std::int64_t bytes)
    : copy_(memfd_create("palpate-import", MFD_CLOEXEC)) {
  const int from = open(file.c_str(), O_RDONLY | O_CLOEXEC);
  const bool copied = from >= 0 && copy_ >= 0 && Copy(from, copy_, bytes);
  if (from >= 0) close(from);
  if (copied) return;
  if (copy_ >= 0) close(copy_);
  Refuse("the file cannot be read to its end; copy or export it again");
}

FileStart::~FileStart() { close(copy_); }

std::filesystem::path FileStart::path() const { return "/proc/self/fd/" + std::to_string(copy_); }

}  // namespace palpate
