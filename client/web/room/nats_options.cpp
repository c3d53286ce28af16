#include "client/web/room/nats_options.h"

#include <fstream>
#include <iterator>
#include <string_view>

#include "client/web/room/subjects.h"
#include "common/error/error.h"
#include "common/wire/address.h"

namespace palpate::web {
namespace {

constexpr std::string_view kPlainScheme = "nats://";
constexpr std::string_view kTlsScheme = "tls://";

HostPort AddressOf(const std::string& url) {
  // Before anything that shows the URL, which may hold a password.
  if (url.find('@') != std::string::npos) {
    Refuse("the NATS server's address holds a user: give nats.user and nats.password_file");
  }
  std::string address = url;
  if (url.starts_with(kPlainScheme)) {
    address.erase(0, kPlainScheme.size());
  } else if (url.starts_with(kTlsScheme)) {
    address.erase(0, kTlsScheme.size());
  } else {
    Refuse(url + " is no address of a NATS server: write nats://HOST:PORT or tls://HOST:PORT");
  }
  const bool has_port = address.find(':', address.rfind(']') + 1) != std::string::npos;
  return ParseHostPort(has_port ? address : address + ":4222");
}

void CheckFile(const char* key, const std::filesystem::path& file) {
  if (!file.empty() && !std::ifstream(file)) {
    Refuse(std::string(key) + ": cannot read " + file.string());
  }
}

}  // namespace

bool UsesTls(const NatsServer& server) {
  return server.url.starts_with(kTlsScheme) || !server.ca_file.empty() ||
         !server.certificate_file.empty();
}

std::string ReadPassword(const NatsServer& server) {
  if (server.password_file.empty()) return {};
  std::ifstream stream(server.password_file);
  std::string password, more;
  stream >> password >> more;
  const std::string file = server.password_file.string();
  if (password.empty()) Refuse("nats.password_file: no password in " + file);
  if (!more.empty()) Refuse("nats.password_file: " + file + " must hold the password alone");
  return password;
}

void Check(const NatsServer& server) {
  const HostPort address = AddressOf(server.url);
  if (!UsesTls(server) && address.host != "localhost" && !IsLoopback(address)) {
    Refuse("the NATS server " + address.ToString() +
           " is another machine: use tls:// or nats.tls_ca");
  }
  if (!server.user.empty() && !IsNatsUser(server.user)) {
    Refuse("nats.user: " + server.user + " is no user: use 1 to 64 letters, digits, _ and -");
  }
  if (server.user.empty() != server.password_file.empty()) {
    Refuse("nats.user and nats.password_file go together");
  }
  if (server.certificate_file.empty() != server.key_file.empty()) {
    Refuse("nats.tls_cert and nats.tls_key go together");
  }
  ReadPassword(server);
  CheckFile("nats.tls_ca", server.ca_file);
  CheckFile("nats.tls_cert", server.certificate_file);
  CheckFile("nats.tls_key", server.key_file);
}

}  // namespace palpate::web
