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
// The emergency stop asks May, acts, and is admitted afterwards: May waits for nothing.
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
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/door/activity.h"
#include "server/door/connection_watch.h"
#include "server/security/connection_limits.h"
#include "server/security/identity_limits.h"
#include "server/security/policy.h"

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
  // The call's work is done, and gRPC gets its answer of these bytes: the call no longer counts
  // against its caller's limits. The answer counts against its connection until the call is over.
  // Returns the status to finish with: if the connection leaves too much unread, the answer is left
  // out, but never a stop's.
  grpc::Status Answered(const grpc::Status& status, std::size_t answer_bytes);
  // The call sends the client so many bytes of voxels, for which the client has to answer now and
  // then.
  void SendsVoxels(std::size_t bytes) const;
  // Ends the call if its client has not sent more by then, ns of the monotonic clock; 0: never.
  void MustSendBy(std::int64_t time_ns) const;
  bool is_question() const;                                                 // of an admitted call
  const Identity& caller() const { return running_->caller; }               // of an admitted call
  const Credentials& credentials() const { return running_->credentials; }  // as caller()
  // "local socket", "token ada at ipv4:192.0.2.7:51544"; of an admitted call.
  std::string Who() const;
  // Where an admitted call came from, as gRPC names it.
  const std::string& peer() const { return running_->peer; }
  // The admitted call has changed this; see Activity. Call it after the change has succeeded.
  void Changed(std::string_view what) const;
  // For facts that are other ones now, without a change that others should be told of.
  void MayHaveChanged(std::string_view what) const;
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
    std::string connection{};  // the peer of TCP, for ConnectionWatch; empty: a socket
    std::string unread_key{};  // see UnreadLimit
    std::size_t request_bytes = 0;
    int samples_per_s = 0;                      // what TakeSamples has taken
    bool is_noted = false;                      // in the activity
    std::optional<std::size_t> answer_bytes{};  // of a call that is answered
    // Guarded by Access::running_mutex_.
    std::int64_t must_go_on_by_ns = 0;  // its client must have sent, or read; 0: never
    bool ended = false;

    bool shares_bound() const { return !unread_key.empty() && connection.empty(); }
  };

  explicit Admission(grpc::Status status = {}) : status_(std::move(status)) {}

  grpc::Status status_;
  Access* access_ = nullptr;  // null: not admitted, or over
  std::list<Running>::iterator running_{};
};

class Access {
 public:
  // The work of an admitted call on this thread, while this object lives: what a question takes
  // counts against its caller.
  class Work {
   public:
    Work(Access& access, const Admission& admission);
    ~Work();
    Work(const Work&) = delete;
    Work& operator=(const Work&) = delete;
    // Throws Error (kTooLarge) if the caller's questions have taken too much already.
    void Begin() const;

   private:
    Access& access_;
    const std::string question_of_;  // empty: the call is no question
    const double began_s_;
  };

  // Starts with a policy that trusts only peers on the sockets and on loopback.
  Access() : Access(LimitOptions{}) {}
  // connections: learns which connections belong to a known client; must outlive this object. now:
  // the clock for the validity of certificates; tests pass their own.
  explicit Access(const LimitOptions& limits, ConnectionWatch* connections = nullptr,
                  std::function<CertificateTime()> now = std::chrono::system_clock::now)
      : options_(limits), limits_(limits), connections_(connections), now_(std::move(now)) {}

  // Whether the caller may make this call, whatever it uses. Takes no lock, and logs nothing.
  bool May(const grpc::ServerContextBase& context, std::string_view method) const;
  // `method`: as in MethodRules. request_bytes: held until the call is answered.
  Admission Admit(grpc::ServerContextBase* context, std::string_view method,
                  std::size_t request_bytes = 0);

  // Whether who has these may make this call now. May take as long as verifying a certificate.
  bool MayStill(const Credentials& credentials, std::string_view method) const;

  const Activity& activity() const { return activity_; }
  // Somebody who made no call of gRPC has changed this; see Activity.
  void Changed(std::string_view what, const std::string& who);
  // See Activity::SetOnChange.
  void SetOnChange(Activity::OnChange call) { activity_.SetOnChange(std::move(call)); }
  const LimitOptions& limits() const { return options_; }

  // Applies from the next call on. Running calls that the new policy refuses end now. One thread at
  // a time.
  void SetPolicy(std::shared_ptr<const Policy> policy);
  // Ends running calls whose certificate has expired, and those that have not sent or read in time.
  // Call it
  // every second.
  void Review();
  // Ends the running calls of this identity. Returns how many there were.
  std::size_t EndCaller(const std::string& identity);
  // Called at the end of each review. Set it before the first.
  void SetOnReview(std::function<void()> call) { on_review_ = std::move(call); }

 private:
  friend class Admission;
  struct Judgement {
    Admission::Running call{};
    grpc::Status refusal{};  // with the bare problem
  };

  struct End {
    grpc_call* call;  // holds a reference
    std::string whose, line;
  };
  // Marks it. With running_mutex_.
  static End MarkEnd(Admission::Running& call, const std::string& why);
  // Without running_mutex_: an end writes to the connection, and gRPC may call OnDone at once.
  static void Carry(const std::vector<End>& ends);
  using Identities = std::map<Credentials, std::optional<Identity>>;
  using IdentityOf = std::function<std::optional<Identity>(const Credentials&)>;

  Judgement Judge(const grpc::ServerContextBase& context, std::string_view method,
                  const PolicyBoard::Reading& policy) const;
  Admission Refuse(const Admission::Running& call, std::string_view method,
                   const grpc::Status& problem) const;
  // None if the policy is no longer in force.
  std::optional<Admission> Enter(Admission::Running call, const PolicyBoard::Reading& policy);

  // Of the credentials of all running calls.
  Identities Judged(const IdentityOf& identity_of) const;
  // Marks the calls that must end.
  std::vector<End> MarkEnds(const Identities& judged, const PolicyBoard::Reading& policy);

  const LimitOptions options_;
  IdentityLimits limits_;
  UnreadLimit unread_;
  ConnectionWatch* const connections_;
  const std::function<CertificateTime()> now_;
  Activity activity_;
  PolicyBoard policy_;
  std::function<void()> on_review_;
  mutable std::mutex running_mutex_;  // nothing else is locked, called or written under it
  std::list<Admission::Running> running_;
};

// The answer to a refused stream.
template <class Request, class Response>
class RefusedStream final : public grpc::ServerBidiReactor<Request, Response> {
 public:
  explicit RefusedStream(Admission admission) : admission_(std::move(admission)) {
    this->Finish(admission_.status());
  }
  // Refuses a call that was admitted.
  RefusedStream(Admission admission, const grpc::Status& status)
      : admission_(std::move(admission)) {
    this->Finish(status);
  }
  void OnDone() override { delete this; }

 private:
  Admission admission_;
};

}  // namespace palpate
