#include "server/stop/stop_door.h"

#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <ctime>
#include <exception>
#include <utility>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "common/files/bound_socket.h"
#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

// Who comes in a flood waits for those before: at kAtOnce in each 1 to 2 ms, at most 20 ms.
constexpr int kWaiting = 512;
constexpr std::int64_t kPatienceNs = 1'000'000'000;
constexpr std::int64_t kFullPatienceNs = 100'000'000;  // if there is no place
constexpr std::string_view kWaits = "waits\n";
constexpr timespec kPause{0, 1'000'000};
constexpr int kNice = -5;  // where real-time scheduling is not permitted

// Adds to a line that is long enough.
char* Add(char* to, char* end, std::string_view text) {
  return std::copy_n(text.data(), std::min<std::size_t>(text.size(), end - to), to);
}
template <class Number>
char* AddNumber(char* to, char* end, Number number) {
  return std::to_chars(Add(to, end, " "), end, number).ptr;
}

}  // namespace

void StopDoor::OpenAll(const std::vector<StopSocket>& sockets) {
  for (const StopSocket& socket : sockets) {
    const mode_t mode = socket.is_door && !socket.group ? 0600 : 0660;
    Listener& one = listeners_.emplace_back(
        Listener{socket.path, BindSocket(socket.path, mode), socket.is_door});
    if (one.fd >= 0 && socket.group) GiveToGroup(socket.path, *socket.group);
    if (one.fd >= 0 && listen(one.fd, kWaiting) == 0) continue;
    throw Error(ErrorKind::kConflict, "cannot listen on " + socket.path + ": " +
                                          std::strerror(errno) +
                                          "; name another socket with --socket");
  }
}

void StopDoor::Open(const std::vector<StopSocket>& sockets) {
  OpenAll(sockets);
  end_ = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (end_ < 0) throw Error(ErrorKind::kInternal, "no file is left: raise LimitNOFILE (ulimit -n)");
  ends_ = false;
  teller_ = std::thread([this] {
    pthread_setname_np(pthread_self(), "palpate-told");
    while (!ends_) {
      untold_.acquire();
      TellStops();
      CloseDropped();
    }
  });
  thread_ = std::thread([this] { Run(); });
}

void StopDoor::Close() noexcept {
  if (listeners_.empty()) return;
  ends_ = true;
  if (end_ >= 0) eventfd_write(end_, 1);
  if (thread_.joinable()) thread_.join();
  untold_.release();
  if (teller_.joinable()) teller_.join();
  TellStops();
  CloseDropped();
  for (const Listener& one : std::exchange(listeners_, {})) {
    if (one.fd < 0) continue;
    unlink(one.path.c_str());
    close(one.fd);
  }
  if (end_ >= 0) close(std::exchange(end_, -1));
}

void StopDoor::SetOnStop(std::function<void(const StopCaller&)> call) {
  const std::lock_guard lock(tell_mutex_);
  on_stop_ = std::move(call);
}

void StopDoor::TellStops() noexcept {
  const std::lock_guard lock(tell_mutex_);
  StopCaller caller;
  while (stops_.TryPop(caller)) {
    try {
      if (on_stop_) on_stop_(caller);
    } catch (const std::exception&) {
      // Without memory for its words. It has acted.
    }
  }
}

void StopDoor::Run() noexcept {
  RealtimeGrant grant;
  SetupRealtimeThread({.priority = priority_, .lock_memory = false}, grant);
  pthread_setname_np(pthread_self(), "palpate-stop");
  if (!grant.fifo) SetThreadNice(kNice);
  std::array<pollfd, kMostOpen + kMostSockets + 1> files{};
  while (!ends_) {
    std::size_t count = 0;
    for (const Listener& one : listeners_) files[count++] = {one.fd, POLLIN, 0};
    files[count++] = {end_, POLLIN, 0};
    bool is_awaited = false;
    for (const Connection& one : connections_) {
      if (one.tick != 0) is_awaited = true;
      if (one.fd >= 0 && one.tick == 0) files[count++] = {one.fd, POLLIN, 0};
    }
    if (!is_awaited) poll(files.data(), count, -1);
    for (Connection& one : connections_) {
      if (one.fd >= 0 && one.tick == 0) Look(one);
    }
    AnswerAll();
    for (const Listener& one : listeners_) {
      for (int n = 0; n < kAtOnce && Accept(one); ++n) {
      }
    }
    // Real-time, the thread must sleep: see LimitRTTIME= of the unit.
    clock_nanosleep(CLOCK_MONOTONIC, 0, &kPause, nullptr);
  }
  for (Connection& one : connections_) Drop(one);
}

bool StopDoor::Accept(const Listener& listener) noexcept {
  Connection* place = Oldest(/*has_asked=*/false);
  if (place == nullptr) {
    place = Oldest(/*has_asked=*/true);
    // Within a tick or two it is answered, unless the loop stands.
    if (MonotonicNowNs() - place->asked_ns < kFullPatienceNs) return false;
  }
  const int fd = accept4(listener.fd, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (fd < 0) {
    // A silent one gives its file to the next.
    if (errno == EMFILE || errno == ENFILE) DropASilentOne();
    return false;
  }
  if (place->tick != 0) Send(*place, kWaits);
  Drop(*place);
  place->fd = fd;
  place->number = ++came_;
  place->is_door = listener.is_door;
  Look(*place);
  return true;
}

void StopDoor::DropASilentOne() noexcept {
  const auto silent =
      std::find_if(connections_.begin(), connections_.end(),
                   [](const Connection& one) { return one.fd >= 0 && one.tick == 0; });
  if (silent != connections_.end()) Drop(*silent);
}

StopDoor::Connection* StopDoor::Oldest(bool has_asked) noexcept {
  Connection* oldest = nullptr;
  for (Connection& one : connections_) {
    if ((one.tick != 0) != has_asked) continue;
    if (oldest == nullptr || one.number < oldest->number) oldest = &one;
  }
  return oldest;
}

void StopDoor::Look(Connection& connection) noexcept {
  constexpr std::string_view kRequest = "stop\n", kOfDoor = "stop /";
  std::array<char, 1024> bytes;
  // A door passes no files. Unread, its request would make the end of the connection an error.
  const int flags = connection.is_door ? 0 : MSG_PEEK;
  const ssize_t length = recv(connection.fd, bytes.data(), bytes.size(), flags);
  if (length < 0 && (errno == EAGAIN || errno == EINTR)) return;
  const std::string_view said(bytes.data(), std::max<ssize_t>(length, 0));
  if (!connection.is_door && said.starts_with(kRequest)) return Act(connection, {});
  if (!connection.is_door || !said.starts_with(kOfDoor)) return Drop(connection);
  Act(connection, said.substr(kOfDoor.size(), said.find(" HTTP/") - kOfDoor.size()));
}

void StopDoor::Act(Connection& connection, std::string_view by_door) noexcept {
  servo_.forces().Set(ForceCommand::kStop);
  device_.StopMoving();
  connection.tick = servo_.FirstTickThatKnows();
  connection.asked_ns = MonotonicNowNs();
  ucred who{};
  socklen_t length = sizeof(who);
  getsockopt(connection.fd, SOL_SOCKET, SO_PEERCRED, &who, &length);
  StopCaller caller{who.uid, who.pid};
  Add(caller.by_door.data(), caller.by_door.data() + caller.by_door.size() - 1, by_door);
  // Of a flood, some are not told.
  if (stops_.TryPush(caller)) untold_.release();
}

void StopDoor::AnswerAll() noexcept {
  const std::int64_t now_ns = MonotonicNowNs();
  const std::optional<LastTick> last = board_.NewestForStop();
  for (Connection& one : connections_) {
    if (one.tick == 0) continue;
    if (last && (last->ended || last->tick >= one.tick)) {
      Answer(one, *last);
    } else if (now_ns - one.asked_ns > kPatienceNs) {
      Send(one, kWaits);
    }
  }
}

void StopDoor::Answer(Connection& connection, const LastTick& last) noexcept {
  const ForceStatus& forces = last.forces;
  std::array<char, 160> line;
  char* const end = line.data() + line.size() - 1;
  char* at = line.data();
  if (connection.is_door) {
    at = std::to_chars(at, end, static_cast<int>(forces.state)).ptr;
    at = AddNumber(at, end, static_cast<int>(forces.reason));
  } else {
    at = Add(at, end, NameOf(forces.state));
    at = Add(Add(at, end, " "), end, NameOf(forces.reason));
  }
  // Somebody may have enabled the forces since.
  const bool acts = forces.state == ForceState::kRampIn || forces.state == ForceState::kOn ||
                    forces.state == ForceState::kHeld;
  at = AddNumber(at, end, acts ? last.stop_tick : last.forces_since_tick);
  at = AddNumber(at, end, forces.limit_n);
  at = AddNumber(at, end, forces.torque_limit_n_mm);
  *at++ = '\n';
  Send(connection, {line.data(), static_cast<std::size_t>(at - line.data())});
}

void StopDoor::Send(Connection& connection, std::string_view line) noexcept {
  std::array<char, 256> answer;
  char* const end = answer.data() + answer.size();
  char* at = answer.data();
  if (connection.is_door) {
    at = AddNumber(Add(at, end, "HTTP/1.0 200 OK\r\nContent-Length:"), end, line.size());
    at = Add(at, end, "\r\n\r\n");
  }
  at = Add(at, end, line);
  // A new connection has room for it.
  send(connection.fd, answer.data(), static_cast<std::size_t>(at - answer.data()), MSG_NOSIGNAL);
  Drop(connection);
}

void StopDoor::Drop(Connection& connection) noexcept {
  if (connection.fd >= 0) {
    shutdown(connection.fd, SHUT_RDWR);  // the peer learns it now
    if (dropped_.TryPush(connection.fd)) {
      untold_.release();
    } else {
      close(connection.fd);
    }
  }
  connection = {};
}

void StopDoor::CloseDropped() noexcept {
  for (int fd = -1; dropped_.TryPop(fd);) close(fd);
}

}  // namespace palpate
