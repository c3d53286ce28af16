#include "server/volume/load/handover_file.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "common/error/error.h"

namespace palpate {

void RefuseHandover(const std::string& what) {
  throw Error(ErrorKind::kInvalidArgument,
              "the importer's result is not a valid volume (" + what + "): the file is damaged");
}

void FailHandover(const char* what) {
  const bool no_room = errno == ENOMEM || errno == ENOSPC || errno == EFBIG;
  const bool no_files = errno == EMFILE || errno == ENFILE;
  throw Error(no_room || no_files ? ErrorKind::kTooLarge : ErrorKind::kInternal,
              std::string(what) + ": " + std::strerror(errno) +
                  (no_room ? "; crop the volume or raise the limit of memory" : ""));
}

void WriteHandoverAt(int fd, const void* data, std::size_t size, std::int64_t offset) {
  const char* bytes = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t count = pwrite(fd, bytes, size, offset);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) FailHandover("cannot hand the volume over");
    bytes += count;
    offset += count;
    size -= static_cast<std::size_t>(count);
  }
}

void ReadHandoverAt(int fd, void* data, std::size_t size, std::int64_t offset) {
  char* bytes = static_cast<char*>(data);
  while (size > 0) {
    const ssize_t count = pread(fd, bytes, size, offset);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) FailHandover("cannot take the volume over");
    bytes += count;
    offset += count;
    size -= static_cast<std::size_t>(count);
  }
}

}  // namespace palpate
