#include "common/files/bound_socket.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr int kPassRights = 83;  // SO_PASSRIGHTS

}  // namespace

int BindSocket(const std::string& path, mode_t mode) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof(address.sun_path) - 1);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  // A file that a peer passes would be closed here, which can take as long as the peer wants. Linux
  // before 6.16 does not know the option.
  const int no = 0;
  if (fd >= 0) setsockopt(fd, SOL_SOCKET, kPassRights, &no, sizeof(no));
  // Nobody can connect before the mode is set, because the socket does not listen yet.
  if (fd >= 0 && bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0 &&
      chmod(path.c_str(), mode) == 0) {
    return fd;
  }
  const int error = errno;
  if (fd >= 0) close(fd);
  errno = error;
  return -1;
}

void GiveToGroup(const std::string& path, gid_t group) {
  if (chown(path.c_str(), static_cast<uid_t>(-1), group) == 0) return;
  const std::string why = std::strerror(errno);
  unlink(path.c_str());
  throw Error(ErrorKind::kPermissionDenied,
              "cannot give " + path + " to its group: " + why +
                  "; palpated's user must be in the group (usermod --append --groups GROUP USER), "
                  "and its unit must allow chown (SystemCallFilter=@chown)");
}

}  // namespace palpate
