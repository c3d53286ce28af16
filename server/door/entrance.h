// A way into palpated: the Unix socket of a role, a door's socket, or the TCP port.
//
// The socket is the permission: whoever may open it has its role. Each entrance has an acceptor, a
// gRPC server with a limit of memory, and threads for the work of its calls, so that the clients of
// one entrance do not use up what those of another need. All share the few threads on which gRPC
// 1.51 carries messages: it has one set of them for the process.
//
// A door is a program, such as a proxy, that knows who calls and passes the calls on. Its sockets
// are apart, and only on these palpated believes the door who the caller is (kCallerHeader).
// Without a group of their own only palpated's user may open them, who may do everything anyway.
//
// Threads: construct, Reserve, Start and Stop on the main thread.
// Errors: Error (kConflict, kPermissionDenied, kInvalidArgument) that says what to do.
#pragma once

#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>

#include "common/files/file_lock.h"
#include "common/wire/address.h"
#include "server/door/acceptor.h"
#include "server/door/call_threads.h"
#include "server/door/deaf_watch.h"
#include "server/security/policy.h"

namespace palpate {

// Holds the path of a socket against other daemons, and removes the socket of a killed one. While
// the lock is held, the path is ours.
void ClaimSocket(const std::string& path, FileLock& lock);

// Removes the socket that a killed daemon left at a path which this one may not use.
void RemoveLeftSocket(const std::string& path);

// Errors: kInvalidArgument (there is no such group).
gid_t GroupOf(const std::string& name);

class Entrance {
 public:
  // More file numbers than the port and viewers have, for operators and admins; half of them for
  // editors. So a flood at one entrance does not keep out those of a higher role.
  static constexpr int kKeptFiles = 64;

  // first_refused_file: of the port and of viewers; see Acceptor. first_second_file: see DeafWatch.
  Entrance(const Entry& entry, int first_refused_file, int first_second_file,
           ConnectionWatch& watch)
      : entry_(entry),
        first_second_file_(first_second_file),
        acceptor_(first_refused_file + KeptFiles(entry), watch) {}
  ~Entrance() { Stop({}); }
  Entrance(const Entrance&) = delete;
  Entrance& operator=(const Entrance&) = delete;

  // The entrance of a call. Throws std::bad_cast if the server has not the contexts of
  // MakeContexts.
  static Entrance& Of(const grpc::ServerContextBase& context);
  std::unique_ptr<grpc::ContextAllocator> MakeContexts();

  const Entry& entry() const { return entry_; }
  CallThreads& threads() { return threads_; }

  // One of these: claims the path, or the port. `group`: owns the socket's file; empty: the
  // process's own.
  void ReserveSocket(const std::string& path, const std::string& group);
  void ReservePort(const HostPort& address, std::optional<Role> loopback_role);
  // Serves. The services may serve at several entrances. with_reflection: of gRPC, which does
  // not check the caller.
  void Start(std::span<grpc::Service* const> services,
             const std::shared_ptr<grpc::ServerCredentials>& credentials, bool with_reflection);
  // No new connections come from here on.
  void StopAccepting() { acceptor_.Stop(); }
  // Ends streams and calls, by `deadline` those that do not end by themselves, and removes the
  // socket. The path stays claimed.
  void Stop(std::chrono::system_clock::time_point deadline) noexcept;

 private:
  static int KeptFiles(const Entry& entry) {
    return entry.role >= Role::kOperator ? kKeptFiles
           : entry.role == Role::kEditor ? kKeptFiles / 2
                                         : 0;
  }

  const Entry entry_;
  const int first_second_file_;
  std::string path_;  // empty: the port
  std::optional<gid_t> group_;
  FileLock lock_;
  std::unique_ptr<DeafWatch> deaf_watch_;  // none: the port, and those who are trusted
  Acceptor acceptor_;
  CallThreads threads_;
  // Answers calls of methods that do not exist. gRPC itself would, without contexts to count.
  grpc::CallbackGenericService others_;
  // A thread that reads from connections when none of gRPC's own does. gRPC 1.51 reads on the
  // threads of its callback queue, and each of these sleeps for 100 ms after every second without
  // a call: every call would wait for up to 100 ms.
  std::unique_ptr<grpc::ServerCompletionQueue> standby_queue_;
  std::thread standby_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace palpate
