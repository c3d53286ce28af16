// TLS of the server: its own certificate, swapped in while it runs.
//
// gRPC reads the pair again from files by itself, and a pair that does not match
// refuses every handshake: it is given only pairs that were checked, in a private
// folder beside the socket.
//
// Certificates of clients are asked for in the handshake, where TLS makes sure that the
// client has the key, and are judged at each call (Policy): so that the log and the
// client learn who was refused and why, and that one that expires or loses its authority
// is refused also on a connection that is open already.
//
// Threads: Update from one at a time; the rest of gRPC's own.
// Errors: Error that names the file.
#pragma once

#include <grpcpp/grpcpp.h>

#include <filesystem>
#include <functional>
#include <memory>

#include "server/security/certificates.h"

namespace palpate {

struct TlsOptions {
  std::filesystem::path certificate{};  // PEM, with those between it and the authority
  std::filesystem::path key{};          // PEM
};

class TlsFiles {
 public:
  // Makes the folder (mode 0700), which goes with this object, and checks the pair.
  TlsFiles(const TlsOptions& options, const std::filesystem::path& folder);
  ~TlsFiles();
  TlsFiles(const TlsFiles&) = delete;
  TlsFiles& operator=(const TlsFiles&) = delete;

  // Checks the pair again and gives it to gRPC, which has it within a second or two.
  // Throws where it is not fit: the old one stays.
  void Update();

  // Warns in the log once a day while the certificate nears its end. One thread at a time,
  // with Update.
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
