// Ends connections of a Unix socket whose clients call on and on and wait for no answer.
//
// gRPC 1.51 reads on as long as calls come, and keeps 17 KB for each until its answer is written.
// It allows 100 calls at once only to clients that have confirmed this limit: of the others 20 000
// calls a second were seen, and palpated grew to 3 GB. It names all clients of a socket alike, so
// no count of calls tells who they are. The kernel does: while more than kManyCalls calls of the
// socket are not over, connections end that are full at kFullLooks looks in turn: with answers that
// the client does not read, or with calls that gRPC has not read.
//
// Threads: any; a thread of its own looks while there are connections.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace palpate {

class DeafWatch {
 public:
  static constexpr int kManyCalls = 1000;
  static constexpr int kFullLooks = 3;
  static constexpr int kFullBytes = 32 << 10;  // more than 100 ordinary calls have
  static constexpr std::chrono::milliseconds kLookTime{50};

  // first_file: lowest number for duplicated descriptors; see FirstSecondFile.
  DeafWatch(std::string socket, int first_file)
      : socket_(std::move(socket)), first_file_(first_file) {}
  ~DeafWatch();
  DeafWatch(const DeafWatch&) = delete;
  DeafWatch& operator=(const DeafWatch&) = delete;

  // A call came, or is over for gRPC.
  void Began() { ++calls_; }
  void Ended() { --calls_; }

  // Adds a connection. The caller keeps `fd`; the watch duplicates it. Returns false if no file
  // number or thread is left: the caller must then close the connection.
  bool Enter(int fd);

 private:
  struct Connection {
    int fd;  // a duplicate; owned
    int full_looks = 0;
  };

  void Run();
  // Forgets connections that have ended, and returns how many it has ended itself.
  std::size_t Look();

  const std::string socket_;
  const int first_file_;
  std::atomic<int> calls_{0};
  std::mutex mutex_;
  std::vector<Connection> connections_;
  bool stop_ = false;
  std::condition_variable changed_;
  std::thread thread_;
};

}  // namespace palpate
