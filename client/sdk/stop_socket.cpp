#include "client/sdk/stop_socket.h"

#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <sstream>
#include <string_view>

#include "common/error/error.h"

namespace palpate::client {
namespace {

// palpated answers within a second. In a flood it may close a connection: the next one may pass.
constexpr timeval kPatience{1, 500'000};
constexpr int kTries = 3;

// Returns the answer. Empty: the connection was closed. None: nobody answers.
std::optional<std::string> Ask(const sockaddr_un& address) {
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return std::nullopt;
  setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &kPatience, sizeof(kPatience));
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof(kPatience));
  constexpr std::string_view kRequest = "stop\n";
  std::optional<std::string> answer;
  if (connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
    send(fd, kRequest.data(), kRequest.size(), MSG_NOSIGNAL);
    char text[256];
    // The answer is one write.
    const ssize_t length = recv(fd, text, sizeof(text), 0);
    if (length >= 0) answer.emplace(text, static_cast<std::size_t>(length));
    if (length < 0 && errno == ECONNRESET) answer.emplace();
  }
  close(fd);
  return answer;
}

}  // namespace

std::optional<ForceResult> StopBySocket(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) return std::nullopt;
  std::memcpy(address.sun_path, path.data(), path.size());
  for (int n = 0; n < kTries; ++n) {
    const std::optional<std::string> said = Ask(address);
    if (!said) return std::nullopt;
    std::istringstream answer(*said);
    std::string state, reason;
    ForceResult result;
    answer >> state;
    if (state == "waits") {
      throw Error(ErrorKind::kUnavailable,
                  "the haptic loop did not tick within 1 s: the stop holds from its next tick on; "
                  "look at palpated's log, or end it");
    }
    result.forces.state = Named<ForceState>(state).value_or(ForceState::kUnknown);
    if (result.forces.state != ForceState::kUnknown && answer >> reason >> result.applied_tick >>
                                                           result.forces.limit_n >>
                                                           result.forces.torque_limit_n_mm) {
      result.forces.reason = Named<ForceReason>(reason).value_or(ForceReason::kUnknown);
      return result;
    }
  }
  return std::nullopt;
}

}  // namespace palpate::client
