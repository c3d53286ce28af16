// The emergency stop's own door: Unix sockets beside palpated's, on which nothing else is asked:
// one, one for each group that has a socket of its own for its role, and one of a door
// (server/door/entrance.h).
//
// Whoever may open one of them may stop. The request is "stop\n", in one write; the answer is one
// line:
//   stopped stop-call 120334 3.3 0
// State and reason of the forces, the first tick with zero force, and the limits of force (N) and
// torque (N mm). Another state: somebody has enabled the forces again.
//   waits
// The loop does not tick, and the stop acts in its next tick. After a second; in a flood, after a
// tenth of one.
// A loop that has ended has written zero force: "off operator" and the tick after its last one.
//
// A door asks as a proxy of HTTP can, in one write, and says who calls from where:
//   stop /192.0.2.7:51544/token ada HTTP/1.0
// Its answer is one of HTTP with the same line, with the protocol's numbers for state and reason.
//
// One thread, "palpate-stop", serves the sockets: below the servo's and the device's threads, and
// above all others where the system permits. It takes no lock, allocates nothing, writes no log and
// shares nothing but atomic values, so that it works whatever the rest of palpated does: with all
// other threads standing, and while the gRPC server shuts down. It works for at most kAtOnce
// connections, then sleeps for 1 ms, so that a flood leaves the processor to others. Of more than
// kMostOpen connections the oldest that has not asked is closed. A connection is served once.
//
// A second thread tells who has stopped (SetOnStop), as that takes locks, and closes connections: a
// peer may have sent a file with its bytes, whose end takes long. So the bytes are only looked at.
//
// Threads: construct, Open and Close on the main thread; SetOnStop and TellStops on any ordinary
// one. Ownership: borrows all. Errors: Open throws Error (kConflict).
#pragma once

#include <sys/types.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <semaphore>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/pump/tick_outbox.h"
#include "server/realtime/spsc_ring.h"
#include "server/servo/servo_loop.h"

namespace palpate {

// As the kernel tells.
struct StopCaller {
  uid_t user = 0;
  pid_t process = 0;
  std::array<char, 128> by_door{};  // "192.0.2.7:51544/token ada", ends with 0; empty: by no door
};

struct StopSocket {
  std::string path{};            // of no other file
  std::optional<gid_t> group{};  // owns it; none: as every file that the process makes
  bool is_door = false;
};

class StopDoor {
 public:
  static constexpr std::size_t kMostOpen = 128;
  static constexpr int kAtOnce = 64;
  static constexpr std::size_t kMostSockets = 5;

  // `priority`: of SCHED_FIFO, 1 to 99.
  StopDoor(ServoLoop& servo, LastTickBoard& board, HapticDevice& device, int priority)
      : servo_(servo), board_(board), device_(device), priority_(priority) {}
  ~StopDoor() { Close(); }
  StopDoor(const StopDoor&) = delete;
  StopDoor& operator=(const StopDoor&) = delete;

  // At most kMostSockets.
  void Open(const std::vector<StopSocket>& sockets);
  // Tells of the stops so far, and removes the sockets. A second call does nothing.
  void Close() noexcept;

  // Called once for each stop, after it has acted; one call at a time. Empty: nobody is told.
  void SetOnStop(std::function<void(const StopCaller&)> call);
  // Tells of the stops that are not told yet. One that is answered is told afterwards.
  void TellStops() noexcept;

 private:
  struct Connection {
    int fd = -1;
    std::uint64_t number = 0;  // rises in the order in which they came
    std::uint64_t tick = 0;    // knows of the stop; 0: not asked yet
    std::int64_t asked_ns = 0;
    bool is_door = false;
  };

  void Run() noexcept;
  struct Listener {
    std::string path{};
    int fd = -1;
    bool is_door = false;
  };

  // False if nobody waits, or there is no place.
  bool Accept(const Listener& listener) noexcept;
  // The oldest of those that have asked, or have not; null: there is none. A free place is the
  // oldest of those that have not.
  Connection* Oldest(bool has_asked) noexcept;
  void DropASilentOne() noexcept;
  // Looks at what came. Acts if it is the request.
  void Look(Connection& connection) noexcept;
  void Act(Connection& connection, std::string_view by_door) noexcept;
  // Answers those whose tick has come, and those who waited for too long.
  void AnswerAll() noexcept;
  void Answer(Connection& connection, const LastTick& last) noexcept;
  void Send(Connection& connection, std::string_view line) noexcept;
  void Drop(Connection& connection) noexcept;
  // On the teller's thread, too.
  void CloseDropped() noexcept;

  ServoLoop& servo_;
  LastTickBoard& board_;
  HapticDevice& device_;
  const int priority_;

  void OpenAll(const std::vector<StopSocket>& sockets);

  std::vector<Listener> listeners_;  // do not change while the threads run
  int end_ = -1;
  std::atomic<bool> ends_{false};
  std::thread thread_, teller_;

  // The stop's thread's.
  std::array<Connection, kMostOpen> connections_{};
  std::uint64_t came_ = 0;

  SpscRing<StopCaller, 256> stops_;
  // Files that the teller closes. With kMostOpen, they fit into those that palpated keeps free for
  // itself (server/door/open_files.cpp).
  SpscRing<int, 64> dropped_;
  std::counting_semaphore<> untold_{0};
  std::mutex tell_mutex_;  // guards on_stop_; held to read stops_
  std::function<void(const StopCaller&)> on_stop_;
};

}  // namespace palpate
