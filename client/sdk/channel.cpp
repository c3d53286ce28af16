#include "client/sdk/channel.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include "common/wire/address.h"

namespace palpate::client {
namespace {

// The word in the first and last line of a PEM certificate.
constexpr char kCertificate[] = "CERTIFICATE";
constexpr char kPrivateKey[] = "PRIVATE KEY";
// palpated allows a probe each second; client/python/palpate/_link.py has the same times.
constexpr int kProbeMs = 1000;
constexpr int kProbePatienceMs = 2500;

std::string ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  // Unlike stream iterators, `<<` throws nothing if the path is a folder.
  text << file.rdbuf();
  if (text.view().empty()) {
    throw Error(ErrorKind::kNotFound, "cannot read " + path + ", or it is empty");
  }
  return text.str();
}

// Checks the text, because gRPC does not say what is wrong with a PEM file.
std::string ReadPem(const std::string& path, const std::string& what) {
  std::string text = ReadFile(path);
  if (text.find(what + "-----") == text.npos) Refuse(path + " holds no " + what + " in PEM");
  return text;
}

// Reads the one line that 'palpated token add' printed.
std::string ReadToken(const std::string& path) {
  std::string token = ReadFile(path);
  while (!token.empty() && (token.back() == '\n' || token.back() == '\r')) token.pop_back();
  const auto is_plain = [](char c) { return c > ' ' && c < 127; };
  if (token.empty() || token.size() > 128 || !std::all_of(token.begin(), token.end(), is_plain)) {
    Refuse(path + " holds no token: put into it the line that 'palpated token add' printed");
  }
  return token;
}

}  // namespace

Route::Route(const Server& server) : credentials_(server.credentials) {
  const Address& address = server.address;
  const Credentials& credentials = server.credentials;
  if (!address.socket_path.empty() && !address.host_port.empty()) {
    Refuse("name a socket, or a host and port, not both");
  }
  has_tls_ = !credentials.ca_file.empty() || !credentials.certificate_file.empty();
  if (credentials.certificate_file.empty() != credentials.key_file.empty()) {
    Refuse("a certificate and its key come together: name both, or none");
  }
  // Without TLS, others could read the token. Without the daemon's authority, another server could
  // pose as the daemon.
  if (!credentials.token_file.empty() && !has_tls_) {
    Refuse("a token is sent over TLS only: name the daemon's certificate authority too");
  }
  if (address.host_port.empty()) {
    if (has_tls_) Refuse("TLS is for a host and port: the socket has its file mode as guard");
    // The usual socket stays the same: where the default one is may change.
    const std::string& path = address.socket_path;
    socket_ = {.socket_path = std::filesystem::absolute(path.empty() ? DefaultSocketPath() : path),
               .role = address.role};
    UnixTarget(SocketPathOf(*socket_));
    return;
  }
  if (!address.role.empty()) {
    Refuse("a role is for the sockets of this machine: over the network, the token has one");
  }
  const HostPort host_port = ParseHostPort(address.host_port);
  target_ = TcpTarget(host_port);
  is_here_ = host_port.host == "localhost" || IsLoopback(host_port);
  host_port_ = host_port.ToString();
}

std::string Route::name() const { return socket_ ? UnixTarget(socket_path()) : host_port_; }

std::string Route::socket_path() const { return socket_ ? SocketPathOf(*socket_) : ""; }

bool Route::CanReadAgain() const {
  const std::string* const files[] = {&credentials_.ca_file, &credentials_.certificate_file,
                                      &credentials_.key_file, &credentials_.token_file};
  return std::none_of(std::begin(files), std::end(files), [](const std::string* file) {
    std::error_code error;
    return !file->empty() && std::filesystem::is_fifo(*file, error);
  });
}

std::shared_ptr<grpc::ChannelCredentials> Route::MakeCredentials() const {
  if (!has_tls_) return grpc::InsecureChannelCredentials();
  grpc::SslCredentialsOptions options;
  // Without an authority file, gRPC uses the authorities that the system trusts.
  if (!credentials_.ca_file.empty()) {
    options.pem_root_certs = ReadPem(credentials_.ca_file, kCertificate);
  }
  if (!credentials_.certificate_file.empty()) {
    options.pem_cert_chain = ReadPem(credentials_.certificate_file, kCertificate);
    options.pem_private_key = ReadPem(credentials_.key_file, kPrivateKey);
  }
  auto tls = grpc::SslCredentials(options);
  if (credentials_.token_file.empty()) return tls;
  return grpc::CompositeChannelCredentials(
      tls, grpc::AccessTokenCredentials(ReadToken(credentials_.token_file)));
}

std::shared_ptr<grpc::Channel> Route::MakeChannel(
    const std::shared_ptr<grpc::ChannelCredentials>& credentials,
    const grpc::ChannelArguments& arguments) const {
  grpc::ChannelArguments all = arguments;
  // A proxy for web pages must not carry haptic streams.
  all.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  if (!socket_) {
    // Finds within 4 s that the network is gone, and ends the calls.
    all.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kProbeMs);
    all.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kProbePatienceMs);
    all.SetInt(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    all.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // no limit
  }
  return grpc::CreateCustomChannel(socket_ ? name() : target_, credentials, all);
}

Error Route::WhyUnreached(const std::string& details) const {
  if (socket_) return WhySocketUnreached();
  return {ErrorKind::kUnavailable, WhyServerUnreached(details)};
}

// client/python/palpate/_unreached.py has the same causes and texts.
std::string Route::WhyServerUnreached(const std::string& details) const {
  const auto says = [&](const char* part) { return details.find(part) != details.npos; };
  const std::string host = host_port_.substr(0, host_port_.rfind(':'));
  const std::string none = "no palpated at " + host_port_;
  if (says("DNS resolution failed")) {
    return none + ": the host " + host + " is not known: check the address";
  }
  // For a host name with several addresses, gRPC reports only the last address. Another address may
  // have refused the connection.
  const bool is_name = host.find_first_not_of("0123456789.") != host.npos && host.front() != '[';
  if (says("Connection refused") && !(is_name && has_tls_)) {
    return none + ": nothing listens there: start it there with --listen, or check the address";
  }
  if (!has_tls_) {
    return none +
           " that answers without TLS: start it there, or name the certificate authority of one "
           "that has TLS";
  }
  if (says("certificate verify failed")) {
    const std::string authority = credentials_.ca_file.empty()
                                      ? "an authority that this machine trusts"
                                      : "the authority in " + credentials_.ca_file;
    return none + " that proves itself: its certificate is not signed by " + authority +
           ", or is not valid today: name the authority that signed it";
  }
  if (says("is not in peer certificate")) {
    return none + " that proves itself: its certificate does not name " + host +
           ": use a host name that it has, or have one made that names " + host;
  }
  if (says("wrong version number")) {
    return "what answers at " + host_port_ +
           " has no TLS: check the address, or leave out the certificate authority";
  }
  return none +
         " that proves itself to the given authority over TLS: check the address, that its "
         "certificate names this host, and that it has TLS";
}

Error Route::WhySocketUnreached() const {
  struct stat info {};
  const std::string path = socket_path();
  const bool found = stat(path.c_str(), &info) == 0;
  if (found ? access(path.c_str(), W_OK) != 0 : errno == EACCES) {
    return {ErrorKind::kPermissionDenied,
            "no permission to use " + name() +
                ": ask for membership of the group that owns the socket"};
  }
  if (found && !S_ISSOCK(info.st_mode)) {
    return {ErrorKind::kUnavailable, name() + " is not a socket"};
  }
  return {ErrorKind::kUnavailable, "no palpated at " + name() + ": start it with 'palpated'"};
}

}  // namespace palpate::client
