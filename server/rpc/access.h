// The door of every call: who calls, may they, and how much do they have already.
//
// Each service asks first:
//   const Admission admission = access_.Admit(context, "/palpate.v1.XService/Y");
//   if (!admission.ok()) return admission.status();
// and keeps the admission while it works. A stranger gets UNAUTHENTICATED, too low a
// role PERMISSION_DENIED, too much RESOURCE_EXHAUSTED; each with a line of what to do,
// and each in the log with its peer.
//
// Threads: any. Ownership: outlives the server and all admissions.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <exception>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "server/rpc/connection_watch.h"
#include "server/security/identity_limits.h"
#include "server/security/policy.h"
#include "server/security/refusal_log.h"

namespace palpate {

class Access;

// Not longer than the call's context.
class Admission {
 public:
  ~Admission() { Leave(); }
  Admission(Admission&& other) noexcept { *this = std::move(other); }
  Admission& operator=(Admission&& other) noexcept;

  bool ok() const { return status_.ok(); }
  const grpc::Status& status() const { return status_; }
  // Of a stream of poses, once, before it begins: OK, or too many samples per second.
  grpc::Status TakeSamples(int samples_per_s);
  // A message of a streaming answer, of a call that is kTransfer. Waits until gRPC takes it; a
  // client that reads nothing for Access::kWritePatience loses its call, and whoever writes goes
  // on.
  template <class Message>
  void Write(grpc::ServerWriter<Message>& writer, const Message& message) const {
    Writing(true);
    writer.Write(message);
    Writing(false);
  }
  // Who calls; the process itself where there is no context.
  const Identity& caller() const { return caller_; }
  // The call is over.
  void Leave();
  // The status of a call that was admitted and failed: where that is of a client's doing,
  // such as the path of a file, it is in the log with its peer.
  grpc::Status Failed(const std::exception& error) const;

 private:
  friend class Access;
  struct Running {
    grpc::ServerContextBase* context = nullptr;
    const MethodRule* rule = nullptr;
    Credentials credentials{};
    Identity caller{};
    std::string peer{};
    bool ended = false;
    std::int64_t writing_since_ns = 0;  // a message of its answer; 0: none
  };
  void Writing(bool begins) const;

  explicit Admission(grpc::Status status = {}) : status_(std::move(status)) {}

  grpc::Status status_;
  Access* access_ = nullptr;  // null: nothing to give back
  grpc::ServerContextBase* context_ = nullptr;
  const MethodRule* rule_ = nullptr;
  Identity caller_{.name = "palpated", .role = Role::kAdmin};
  int samples_per_s_ = 0;  // that it has taken
  bool is_listed_ = false;
  std::list<Running>::iterator running_;
};

class Access {
 public:
  static constexpr std::chrono::seconds kWritePatience{10};

  // A policy of strangers but on the socket and on loopback.
  Access() : Access(LimitOptions{}) {}
  // connections: told which ones belong to a known client; outlives this one. now: the clock by
  // which certificates are judged; tests bring their own.
  explicit Access(const LimitOptions& limits, ConnectionWatch* connections = nullptr,
                  std::function<CertificateTime()> now = std::chrono::system_clock::now)
      : limits_(limits), connections_(connections), now_(std::move(now)) {}

  // `method`: as in MethodRules. Without a context, the caller is this process.
  Admission Admit(grpc::ServerContextBase* context, std::string_view method);

  // From the next call on; streams and transfers that it would refuse end now.
  void SetPolicy(std::shared_ptr<const Policy> policy);
  // Ends those whose certificate has expired meanwhile, and those that read nothing. Every two
  // seconds.
  void Review();

 private:
  friend class Admission;

  std::shared_ptr<const Policy> policy() const;
  bool Holds(const Admission::Running& call) const;
  // Why a call is to end; empty: it goes on.
  std::string WhyEnd(const Admission::Running& call) const;
  void LogFailure(const Admission& admission, const char* what);
  grpc::Status TakeSamples(const Admission& admission, int samples_per_s);
  Admission Refuse(grpc::StatusCode code, const std::string& peer, const std::string& who,
                   std::string_view method, const std::string& problem);
  // Empty, with neither access nor refusal: `judge` is not the policy any more.
  Admission Enter(const Admission::Running& call, const std::shared_ptr<const Policy>& judge);

  IdentityLimits limits_;
  ConnectionWatch* const connections_;
  const std::function<CertificateTime()> now_;
  RefusalLog refusals_;
  // Taken again within TryCancel, which may end a call on the same thread.
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
