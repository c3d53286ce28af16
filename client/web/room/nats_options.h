// How a gateway reaches its NATS server, and what it does in a room there.
//
// Threads: pure, but for reading files. Errors: as stated.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
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

bool UsesTls(const NatsServer& server);
// The first word of the file; empty if none is given. Errors: kInvalidArgument (not there, empty).
std::string ReadPassword(const NatsServer& server);

// A NATS user whose guests may change settings here.
struct RemoteSite {
  std::string name;                    // of the NATS user
  std::vector<std::string> may_steer;  // keys of settings
};

struct RoomOptions {
  NatsServer server{};
  std::string room{};
  std::string version{};
  std::vector<RemoteSite> sites{};  // for a publisher
  // On the network thread; one line each.
  std::function<void(const std::string& line)> log{};
  std::function<void(bool is_accepted)> steered{};
};

}  // namespace palpate::web
