// TLS of the server, and the files that it and the policy come from.
#pragma once

#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/door/access.h"
#include "server/security/certificates.h"
#include "server/security/policy.h"

namespace palpate {

struct TlsOptions {
  // PEM, with the certificates between this one and the authority
  std::filesystem::path certificate{};
  std::filesystem::path key{};  // PEM
};

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

// Keeps the policy and the TLS pair in step with their files while the server runs.
//
// Threads: Start, Stop and Prepare on the main thread. A thread of its own checks the files.
class SecurityFiles {
 public:
  // Borrows both; `tls` may be null.
  SecurityFiles(Access& access, TlsFiles* tls) : access_(access), tls_(tls) {}
  ~SecurityFiles() { Stop(); }

  // Reads the files, and checks every second whether they have changed. Errors: Error; then
  // nothing has started.
  void Start(const PolicyOptions& policy, const TlsOptions& pair);
  void Stop();
  // Reads the files of these options. Errors: Error; then nothing has changed. Call the returned
  // function to apply the new policy and read the pair again.
  std::function<void()> Prepare(const PolicyOptions& policy);

 private:
  std::string Stamps() const;
  void ReadPolicy();
  void ReadPair();
  void Run();

  Access& access_;
  TlsFiles* const tls_;
  TlsOptions pair_;
  std::mutex mutex_;  // guards the members below
  std::condition_variable changed_;
  PolicyOptions options_;
  std::shared_ptr<const Policy> policy_;
  std::string stamps_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace palpate
