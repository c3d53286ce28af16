// How a gateway reaches its NATS server, and the one connection to it, which comes back by itself.
//
// Nothing waits for the server to come: what is published meanwhile is dropped, and whoever
// publishes begins anew when `connected` is called. A thread of the link connects, every 250 to
// 500 ms; libnats 3.4.1 by itself gives up after two refusals of a password, and queues messages
// while it reconnects. A server that does not answer for 6 s is lost.
//
// Threads: methods on any after Start; Publish and Request may wait for up to 5 s on a slow
// server, so not on the network thread. Callbacks run on threads of the link: one per subscription,
// one for `connected` and `lost`, and one of libnats, which all links share, for the other events.
// They may call methods, but not destroy the link.
// Errors: the constructor throws kInvalidArgument as Check does.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace palpate::web {

struct NatsServer {
  std::string url{};   // nats://HOST:PORT or tls://HOST:PORT; the port is 4222 unless given
  std::string user{};  // of NATS; letters, digits, '_' and '-'. Empty: the server asks for none
  std::filesystem::path password_file{};
  // ca_file alone makes the connection use TLS, too. libnats 3.4.1 trusts the system's authorities
  // beside it. The server's certificate must be for the host of the URL.
  std::filesystem::path ca_file{}, certificate_file{}, key_file{};
};

// Refuses a server that cannot be used, and plain text to other machines. Looks for the files.
// Errors: kInvalidArgument.
void Check(const NatsServer& server);

// A NATS user whose guests may change settings here.
struct RemoteSite {
  std::string name;                    // of the NATS user
  std::vector<std::string> may_steer;  // keys of settings
};

// What a gateway does in a room of its NATS server.
struct RoomOptions {
  NatsServer server{};
  std::string room{};
  std::string version{};
  std::vector<RemoteSite> sites{};  // for a publisher
  // On the network thread; one line each.
  std::function<void(const std::string& line)> log{};
  std::function<void(bool is_accepted)> steered{};
};

struct NatsMessage {
  std::string_view subject, reply, bytes;
  int status = 0;  // header Status: 404 (not kept), 503 (nobody there); 0: none
};

class NatsLink {
 public:
  using Receive = std::function<void(const NatsMessage&)>;
  struct Events {
    std::function<void()> connected{};  // every time; the subscriptions are there
    // Once per connection that is lost, and whenever the reason for none is another one.
    std::function<void(const std::string& why)> lost{};
    std::function<void()> missed{};  // messages came faster than `Receive` took them, and are gone
    std::function<void(const std::string& why)> refused{};  // the server lacks permission for it
  };

  // `name`: what the server's operator sees.
  NatsLink(NatsServer server, std::string name, Events events);
  // Waits for callbacks that run, and for an attempt to connect.
  ~NatsLink();
  NatsLink(const NatsLink&) = delete;
  NatsLink& operator=(const NatsLink&) = delete;

  // Before Start. Messages wait in memory up to kMostWaiting bytes.
  void Subscribe(std::string subject, Receive receive);
  void Start();
  // No callback runs afterwards, and nothing is sent. Waits as the destructor does, which calls it.
  void End();

  // False: not connected, or the server takes nothing; dropped.
  // `reply`: a subject for the answer; empty: none.
  bool Publish(const std::string& subject, std::string_view bytes, const std::string& reply = {});
  // None: no answer, or nobody is there to answer.
  std::optional<std::string> Request(const std::string& subject, std::string_view text,
                                     std::chrono::milliseconds timeout);

  // A subject prefix of this link's own, to subscribe to as NewInbox() + ".*".
  std::string NewInbox() const;
  bool is_connected() const { return is_connected_; }

  static constexpr int kMostWaiting = 64 << 20;

 private:
  struct Session;
  struct Subscription {
    std::string subject;
    Receive receive;
  };
  void Run();
  void Tell(const std::string& why);
  bool WaitFor(std::chrono::milliseconds time);

  const NatsServer server_;
  const std::string name_;
  const Events events_;
  std::vector<Subscription> subscriptions_;
  std::atomic<bool> is_connected_{false};
  std::shared_mutex session_mutex_;  // held to use the session, exclusively to change it
  std::unique_ptr<Session> session_;
  std::string last_why_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace palpate::web
