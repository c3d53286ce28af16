#include "server/rpc/access.h"

#include <grpc/grpc_security_constants.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "common/wire/status.h"
#include "server/log/log.h"
#include "server/realtime/tick_timer.h"
#include "server/security/methods.h"

namespace palpate {
namespace {

constexpr char kAuthorization[] = "authorization";

std::string Joined(const std::vector<grpc::string_ref>& values) {
  std::string text;
  for (const grpc::string_ref& value : values) text.append(value.data(), value.size());
  return text;
}

std::string AuthorizationOf(const std::multimap<grpc::string_ref, grpc::string_ref>& metadata) {
  const auto [first, last] = metadata.equal_range(kAuthorization);
  if (first == last) return "";
  // Nobody knows which of two tokens is meant. "several" is a token that nobody has.
  if (std::next(first) != last) return "several";
  return {first->second.data(), first->second.size()};
}

Credentials TlsCredentialsOf(const std::multimap<grpc::string_ref, grpc::string_ref>& metadata,
                             const grpc::AuthContext& context) {
  // On the server's side, OpenSSL leaves the first certificate out of the chain.
  return {.transport = Transport::kTls,
          .certificate_chain =
              Joined(context.FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME)) +
              Joined(context.FindPropertyValues(GRPC_X509_PEM_CERT_CHAIN_PROPERTY_NAME)),
          .authorization = AuthorizationOf(metadata)};
}

Credentials CredentialsOf(const grpc::ServerContextBase& context, const std::string& peer) {
  const auto auth = context.auth_context();
  if (auth && Joined(auth->FindPropertyValues(GRPC_TRANSPORT_SECURITY_TYPE_PROPERTY_NAME)) ==
                  GRPC_TLS_TRANSPORT_SECURITY_TYPE) {
    return TlsCredentialsOf(context.client_metadata(), *auth);
  }
  return {.transport = peer.starts_with("unix:") ? Transport::kSocket : Transport::kPlain,
          .authorization = AuthorizationOf(context.client_metadata())};
}

std::string RoleProblem(const Identity& identity, Role least) {
  return "it needs the role " + std::string(NameOf(least)) + ", and '" + identity.name + "' is " +
         std::string(NameOf(identity.role));
}

// The name of the method without its service.
std::string_view NameOf(std::string_view method) { return method.substr(method.rfind('/') + 1); }

std::int64_t After(std::chrono::nanoseconds time) { return MonotonicNowNs() + time.count(); }

}  // namespace

void Admission::Leave() {
  Access* const access = std::exchange(access_, nullptr);
  if (!access) return;
  const Running& call = *running_;
  if (!call.is_answered) {
    access->limits_.Leave(call.caller.name, call.rule->kind, call.request_bytes);
  }
  if (call.samples_per_s > 0) access->limits_.LeaveSamples(call.caller.name, call.samples_per_s);
  if (call.is_noted) {
    access->activity_.Left(call.caller, call.peer, call.rule->kind == CallKind::kPoseStream,
                           MonotonicNowNs());
  }
  const std::lock_guard lock(access->mutex_);
  access->running_.erase(running_);
}

// Does not take the lock: Review holds it while it ends streams.
grpc::Status Admission::TakeSamples(int samples_per_s) {
  if (!access_) return grpc::Status::OK;
  Running& call = *running_;
  const bool is_local = call.credentials.transport == Transport::kSocket;
  if (const auto problem =
          access_->limits_.EnterSamples(call.caller.name, is_local, samples_per_s)) {
    return access_
        ->Refuse(grpc::StatusCode::RESOURCE_EXHAUSTED, call.peer, call.caller.name,
                 call.rule->method, *problem)
        .status();
  }
  call.samples_per_s = samples_per_s;
  return grpc::Status::OK;
}

std::string Admission::Who() const { return WhoInWords(running_->caller, running_->peer); }

void Admission::Changed(std::string_view what) const {
  if (access_) access_->activity_.Changed(what, Who(), MonotonicNowNs());
}

void Admission::Answered() {
  if (!access_) return;
  running_->is_answered = true;
  access_->limits_.Leave(running_->caller.name, running_->rule->kind, running_->request_bytes);
  SetPatience(After(access_->options_.read_patience), "it does not read its answer");
}

void Admission::WaitForMore(bool begins) {
  if (!access_) return;
  SetPatience(begins ? After(access_->options_.send_patience) : 0, "it sends nothing");
}

void Admission::SetPatience(std::int64_t ends_ns, const char* with) const {
  const std::lock_guard lock(access_->mutex_);
  running_->patience_ends_ns = ends_ns;
  running_->patience_with = with;
}

grpc::Status Admission::Failed(const std::exception& error) const {
  const Running& call = *running_;
  // Counts by identity, so that strangers at the same address do not use up its lines of the log.
  const auto* known = dynamic_cast<const Error*>(&error);
  const bool is_loading = known && known->kind() == ErrorKind::kLoading;
  const bool is_logged = !is_loading && (call.rule->kind == CallKind::kTransfer ||
                                         call.rule->least >= Role::kOperator);
  const auto left_out =
      is_logged ? access_->refusals_.Take(call.caller.name, MonotonicNowNs()) : std::nullopt;
  if (left_out) {
    LogWarning("{} of {} at {} failed: {}{}", NameOf(call.rule->method), call.caller.name,
               call.peer, error.what(), LeftOutInWords(*left_out));
  }
  return ToStatus(error);
}

std::shared_ptr<const Policy> Access::policy() const {
  const std::lock_guard lock(mutex_);
  return policy_;
}

Admission Access::Admit(grpc::ServerContextBase* context, std::string_view method,
                        std::size_t request_bytes) {
  const std::string peer = context->peer();
  Admission::Running call{context, FindMethodRule(method), CredentialsOf(*context, peer), {},
                          peer,    request_bytes};
  while (true) {
    const std::shared_ptr<const Policy> judge = policy();
    const Recognised who = judge->Recognise(call.credentials, now_());
    if (!who.identity) {
      return Refuse(grpc::StatusCode::UNAUTHENTICATED, peer, "a stranger", method, who.problem);
    }
    call.caller = *who.identity;
    if (!call.rule || who.identity->role < call.rule->least) {
      return Refuse(grpc::StatusCode::PERMISSION_DENIED, peer, call.caller.name, method,
                    RoleProblem(*who.identity, call.rule ? call.rule->least : Role::kAdmin));
    }
    // Replaces the token by its hash, so that the token is not kept.
    call.credentials.token_sha256_hex = who.token_sha256_hex;
    if (!who.token_sha256_hex.empty()) call.credentials.authorization.clear();
    Admission admission = Enter(call, judge);
    if (admission.access_ && connections_ && call.credentials.transport == Transport::kTls) {
      connections_->Admitted(peer, call.credentials);
    }
    if (admission.access_ || !admission.ok()) return admission;
    // The policy was replaced in the meantime: judge again.
  }
}

Admission Access::Enter(const Admission::Running& call,
                        const std::shared_ptr<const Policy>& judge) {
  const CallKind kind = call.rule->kind;
  std::unique_lock lock(mutex_);
  if (judge != policy_) return Admission();
  if (const auto problem =
          limits_.Enter(call.caller.name, kind, call.request_bytes, MonotonicNowNs())) {
    lock.unlock();  // writing to a log that nobody reads blocks
    return Refuse(grpc::StatusCode::RESOURCE_EXHAUSTED, call.peer, call.caller.name,
                  call.rule->method, *problem);
  }
  Admission admission;
  admission.access_ = this;
  admission.running_ = running_.insert(running_.end(), call);
  admission.running_->is_noted =
      activity_.Came(call.caller, call.peer, kind == CallKind::kPoseStream, MonotonicNowNs());
  return admission;
}

void Access::SetPolicy(std::shared_ptr<const Policy> policy) {
  {
    const std::lock_guard lock(mutex_);
    policy_ = std::move(policy);
  }
  Review();
}

void Access::Review() {
  std::vector<std::string> lines;
  {
    const std::lock_guard lock(mutex_);
    const auto refused = [this](const Admission::Running& call) {
      return !call.ended && !WhyEnd(call).empty();
    };
    // Searches from the start after each call: ending a call may remove it from the list.
    for (auto at = running_.begin(); at != running_.end();) {
      at = std::find_if(running_.begin(), running_.end(), refused);
      if (at == running_.end()) break;
      lines.push_back("ended " + std::string(at->rule->method) + " of " + at->caller.name + " at " +
                      at->peer + ": " + WhyEnd(*at));
      at->ended = true;
      at->context->TryCancel();
    }
  }
  for (const std::string& line : lines) LogWarning("{}", line);
  if (!connections_) return;
  const std::shared_ptr<const Policy> judge = policy();
  const auto recognises = [&](const Credentials& credentials) {
    return judge->Recognise(credentials, now_()).identity.has_value();
  };
  connections_->ForgetUnless(recognises);
}

std::string Access::WhyEnd(const Admission::Running& call) const {
  if (!Holds(call)) return "it is no longer allowed";
  const bool is_over = call.patience_ends_ns != 0 && MonotonicNowNs() > call.patience_ends_ns;
  return is_over ? call.patience_with : "";
}

bool Access::Holds(const Admission::Running& call) const {
  const Recognised who = policy_->Recognise(call.credentials, now_());
  return who.identity && who.identity->role >= call.rule->least;
}

Admission Access::Refuse(grpc::StatusCode code, const std::string& peer, const std::string& who,
                         std::string_view method, const std::string& problem) {
  if (const auto left_out = refusals_.Take(peer, MonotonicNowNs())) {
    LogWarning("refused {} at {} to call {}: {}{}", who, peer, method, problem,
               LeftOutInWords(*left_out));
  }
  return Admission(
      grpc::Status(code, "palpated refuses " + std::string(NameOf(method)) + ": " + problem));
}

}  // namespace palpate
