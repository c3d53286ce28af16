#include "common/files/text_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "common/error/error.h"
#include "common/files/descriptor.h"

namespace palpate {
namespace {

Error CannotRead(const std::filesystem::path& path) {
  const ErrorKind kind = errno == ENOENT || errno == ENOTDIR ? ErrorKind::kNotFound
                         : errno == EACCES                   ? ErrorKind::kPermissionDenied
                                                             : ErrorKind::kUnavailable;
  return {kind, path.string() + " cannot be read: " + std::strerror(errno)};
}

}  // namespace

std::string ReadTextFile(const std::filesystem::path& path, std::size_t most_bytes) {
  // O_NONBLOCK: opening a pipe would wait for its writer.
  const Descriptor file(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  struct stat status {};
  if (file.get() < 0 || fstat(file.get(), &status) != 0) throw CannotRead(path);
  if (!S_ISREG(status.st_mode)) {
    throw Error(ErrorKind::kInvalidArgument, path.string() + " is no regular file");
  }
  std::string text(most_bytes + 1, '\0');
  std::size_t size = 0;
  while (size < text.size()) {
    const ssize_t got = read(file.get(), text.data() + size, text.size() - size);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw CannotRead(path);
    if (got == 0) break;
    size += static_cast<std::size_t>(got);
  }
  if (size > most_bytes) {
    throw Error(ErrorKind::kInvalidArgument,
                path.string() + " is longer than " + std::to_string(most_bytes >> 10) + " KiB");
  }
  text.resize(size);
  return text;
}

}  // namespace palpate
