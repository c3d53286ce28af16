// Keeps the policy and the TLS pair equal to their files while the server runs.
//
// Threads: Start, Stop and Prepare on the main one; it looks at the files on its own.
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/rpc/access.h"
#include "server/rpc/tls.h"
#include "server/security/policy.h"

namespace palpate {

class SecurityFiles {
 public:
  // Borrows both; `tls` may be null.
  SecurityFiles(Access& access, TlsFiles* tls) : access_(access), tls_(tls) {}
  ~SecurityFiles() { Stop(); }

  // Reads the files and looks every two seconds whether they changed. Errors: Error, and
  // nothing has started.
  void Start(const PolicyOptions& policy, const TlsOptions& pair);
  void Stop();
  // Reads the files of these roles. Errors: Error, and nothing has changed; otherwise what
  // is returned takes them, and reads the pair again.
  std::function<void()> Prepare(const PolicyOptions& policy);

 private:
  std::string Stamps() const;
  void ReadPolicy();
  void ReadPair();
  void Run();

  Access& access_;
  TlsFiles* const tls_;
  TlsOptions pair_;
  std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  PolicyOptions options_;
  std::shared_ptr<const Policy> policy_;
  std::string stamps_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace palpate
