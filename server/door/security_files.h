// Keeps the policy and the TLS pair in step with their files while the server runs.
//
// Threads: Start, Stop and Prepare on the main thread. A thread of its own checks the files.
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/door/access.h"
#include "server/door/tls.h"
#include "server/security/policy.h"

namespace palpate {

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
