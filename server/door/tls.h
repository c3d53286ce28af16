// TLS of the server: its own certificate, replaceable while the server runs.
//
// gRPC reads the pair again from files by itself, and refuses every handshake if the pair does not
// match. So gRPC only gets pairs that were checked. They lie in a private folder beside the socket.
//
// The handshake asks for clients' certificates, and TLS makes sure that the client has the key.
// Policy judges the certificates at each call. So the log and the client learn who was refused and
// why. Also, a certificate that expires or loses its authority is refused even on an open
// connection.
//
// Threads: Update from one at a time; gRPC's own threads do the rest.
// Errors: Error that names the file.
#pragma once

#include <grpcpp/grpcpp.h>

#include <filesystem>
#include <functional>
#include <memory>

#include "server/security/certificates.h"

namespace palpate {

struct TlsOptions {
  // PEM, with the certificates between this one and the authority
  std::filesystem::path certificate{};
  std::filesystem::path key{};  // PEM
};

class TlsFiles {
 public:
  // Makes the folder (mode 0700) and checks the pair. The destructor removes the folder.
  TlsFiles(const TlsOptions& options, const std::filesystem::path& folder);
  ~TlsFiles();
  TlsFiles(const TlsFiles&) = delete;
  TlsFiles& operator=(const TlsFiles&) = delete;

  // Checks the pair again and gives it to gRPC, which uses it within a second or two. Throws if the
  // pair cannot be used; the old pair stays then.
  void Update();

  // Logs a warning once a day while the certificate is about to expire. One thread at a time, also
  // for Update.
  void WarnBeforeEnd(CertificateTime now);

  std::shared_ptr<grpc::ServerCredentials> MakeCredentials() const;

 private:
  const TlsOptions options_;
  const std::filesystem::path folder_;
  const std::filesystem::path pair_;
  CertificateTime valid_until_{};
  CertificateTime next_warning_{};
};

}  // namespace palpate
