// Judges every call: who calls, whether the caller may make the call, and whether the caller
// already uses too much.
//
// Each call asks first:
//   const Admission admission = access_.Admit(context, "/palpate.v1.XService/Y");
//   if (!admission.ok()) return admission.status();
// and keeps the admission until gRPC has finished with the call. A stranger gets UNAUTHENTICATED, a
// role that is too low PERMISSION_DENIED, too much use RESOURCE_EXHAUSTED. Each refusal says what
// to do, and is logged with its peer.
//
// Threads: any. Ownership: outlives the server and all admissions.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "server/rpc/activity.h"
#include "server/rpc/connection_watch.h"
#include "server/security/identity_limits.h"
#include "server/security/policy.h"
#include "server/security/refusal_log.h"

namespace palpate {

class Access;

// An admission must not outlive the call's context.
class Admission {
 public:
  ~Admission() { Leave(); }
  Admission(Admission&& other) noexcept
      : status_(std::move(other.status_)),
        access_(std::exchange(other.access_, nullptr)),
        running_(other.running_) {}

  bool ok() const { return status_.ok(); }
  const grpc::Status& status() const { return status_; }
  // Call it once, before a stream of poses begins. Returns OK, or refuses too many samples per
  // second.
  grpc::Status TakeSamples(int samples_per_s);
  // The call's work is done: it no longer counts against its caller's limits, and its client has
  // read_patience to read the answer.
  void Answered();
  // While an upload waits for its client: the client has send_patience to send more.
  void WaitForMore(bool begins);
  const Identity& caller() const { return running_->caller; }  // of an admitted call
  // "local socket", "token ada at ipv4:192.0.2.7:51544"; of an admitted call.
  std::string Who() const;
  // Where an admitted call came from, as gRPC names it.
  const std::string& peer() const { return running_->peer; }
  // The admitted call has changed this; see Activity. Call it after the change has succeeded.
  void Changed(std::string_view what) const;
  // Ends the admission: the call is over.
  void Leave();
  // Returns the status of an admitted call that failed. Logs the failures of transfers and of
  // operators' calls, with their peer: the client may be the cause, for example by a path.
  grpc::Status Failed(const std::exception& error) const;

 private:
  friend class Access;
  struct Running {
    grpc::ServerContextBase* context = nullptr;
    const MethodRule* rule = nullptr;
    Credentials credentials{};
    Identity caller{};
    std::string peer{};
    std::size_t request_bytes = 0;
    int samples_per_s = 0;  // what TakeSamples has taken
    bool is_noted = false;  // in the activity
    bool is_answered = false;
    bool ended = false;
    // when the call ends unless its client reads or sends; 0: the daemon does not wait for it
    std::int64_t patience_ends_ns = 0;
    const char* patience_with = "";
  };
  void SetPatience(std::int64_t ends_ns, const char* with) const;

  explicit Admission(grpc::Status status = {}) : status_(std::move(status)) {}

  grpc::Status status_;
  Access* access_ = nullptr;  // null: not admitted, or over
  std::list<Running>::iterator running_;
};

class Access {
 public:
  // Starts with a policy that trusts only peers on the socket and on loopback.
  Access() : Access(LimitOptions{}) {}
  // connections: learns which connections belong to a known client; must outlive this object. now:
  // the clock for the validity of certificates; tests pass their own.
  explicit Access(const LimitOptions& limits, ConnectionWatch* connections = nullptr,
                  std::function<CertificateTime()> now = std::chrono::system_clock::now)
      : options_(limits), limits_(limits), connections_(connections), now_(std::move(now)) {}

  // `method`: as in MethodRules. request_bytes: held until the call is answered.
  Admission Admit(grpc::ServerContextBase* context, std::string_view method,
                  std::size_t request_bytes = 0);

  const Activity& activity() const { return activity_; }

  // Applies from the next call on. Running calls that the new policy refuses end now.
  void SetPolicy(std::shared_ptr<const Policy> policy);
  // Ends running calls whose certificate has expired, and calls whose client lets the daemon wait.
  // Call it every two seconds.
  void Review();

 private:
  friend class Admission;

  std::shared_ptr<const Policy> policy() const;
  bool Holds(const Admission::Running& call) const;
  // Why a call must end; empty: it may continue.
  std::string WhyEnd(const Admission::Running& call) const;
  Admission Refuse(grpc::StatusCode code, const std::string& peer, const std::string& who,
                   std::string_view method, const std::string& problem);
  // Returns an admission with neither access nor refusal if `judge` is no longer the policy.
  Admission Enter(const Admission::Running& call, const std::shared_ptr<const Policy>& judge);

  const LimitOptions options_;
  IdentityLimits limits_;
  ConnectionWatch* const connections_;
  const std::function<CertificateTime()> now_;
  RefusalLog refusals_;
  Activity activity_;
  // Recursive: TryCancel may end a call on the same thread, which locks it again.
  mutable std::recursive_mutex mutex_;
  std::shared_ptr<const Policy> policy_ = std::make_shared<Policy>();
  std::list<Admission::Running> running_;
};

// The answer to a refused stream.
template <class Request, class Response>
class RefusedStream final : public grpc::ServerBidiReactor<Request, Response> {
 public:
  explicit RefusedStream(const grpc::Status& status) { this->Finish(status); }
  void OnDone() override { delete this; }
};

}  // namespace palpate
