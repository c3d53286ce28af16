#include "server/door/access.h"

#include <grpc/grpc.h>
#include <grpc/grpc_security_constants.h>

#include <algorithm>
#include <ctime>
#include <iterator>
#include <utility>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/door/entrance.h"
#include "server/log/log.h"
#include "server/realtime/tick_timer.h"
#include "server/security/methods.h"

namespace palpate {
namespace {

constexpr char kAuthorization[] = "authorization";
// Calls of those who have one bound of unread answers together end if their answers stay unread:
// else one of them could keep all others out.
constexpr std::int64_t kReadPatienceNs = 10'000'000'000;
constexpr char kStrangers[] = "a stranger";

// Of the calling thread.
double ThreadTimeS() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

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

// The value of a header that came once and can be shown to people; otherwise empty.
std::string PlainHeader(const std::multimap<grpc::string_ref, grpc::string_ref>& metadata,
                        const char* header) {
  constexpr std::size_t kLongest = 128;
  const auto [first, last] = metadata.equal_range(header);
  if (first == last || std::next(first) != last) return "";
  const std::string word(first->second.data(), first->second.size());
  const bool is_plain =
      std::all_of(word.begin(), word.end(), [](char c) { return c >= ' ' && c <= '~'; });
  return is_plain && word.size() <= kLongest ? word : "";
}

std::shared_ptr<const std::string> ChainOf(const grpc::AuthContext& context) {
  // On the server's side, OpenSSL leaves the first certificate out of the chain.
  std::string chain = Joined(context.FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME)) +
                      Joined(context.FindPropertyValues(GRPC_X509_PEM_CERT_CHAIN_PROPERTY_NAME));
  return chain.empty() ? nullptr : std::make_shared<const std::string>(std::move(chain));
}

Credentials CredentialsOf(const grpc::ServerContextBase& context) {
  const auto& metadata = context.client_metadata();
  const Entry& entry = Entrance::Of(context).entry();
  return {.entry = entry,
          .certificate_chain =
              entry.transport == Transport::kTls ? ChainOf(*context.auth_context()) : nullptr,
          .authorization = AuthorizationOf(metadata),
          .names_caller = metadata.count(kCallerHeader) + metadata.count(kAddressHeader) > 0,
          .caller = PlainHeader(metadata, kCallerHeader)};
}

// gRPC names all clients of a socket alike.
std::string PeerOf(const grpc::ServerContextBase& context) {
  const bool is_door = Entrance::Of(context).entry().transport == Transport::kDoor;
  const std::string address = is_door ? PlainHeader(context.client_metadata(), kAddressHeader) : "";
  return address.empty() ? context.peer() : address;
}

std::string RoleProblem(const Identity& identity, Role least) {
  return "it needs the role " + std::string(NameOf(least)) + ", and '" + identity.name + "' is " +
         std::string(NameOf(identity.role));
}

// The name of the method without its service.
std::string_view NameOf(std::string_view method) { return method.substr(method.rfind('/') + 1); }

}  // namespace

void Admission::Leave() {
  Access* const access = std::exchange(access_, nullptr);
  if (!access) return;
  const Running& call = *running_;
  if (call.answer_bytes) {
    access->unread_.Sent(call.unread_key, *call.answer_bytes, !ok());
  } else {
    access->limits_.Leave(call.caller.name, call.rule->kind, call.request_bytes);
  }
  if (call.samples_per_s > 0) {
    access->limits_.LeaveSamples(call.caller.name, call.samples_per_s);
    if (access->connections_)
      access->connections_->TakesSamples(call.connection, -call.samples_per_s);
  }
  if (call.is_noted) {
    access->activity_.Left(call.caller, call.peer, call.rule->kind == CallKind::kPoseStream,
                           MonotonicNowNs());
  }
  const std::lock_guard lock(access->running_mutex_);
  access->running_.erase(running_);
}

grpc::Status Admission::TakeSamples(int samples_per_s) {
  if (!access_) return grpc::Status::OK;
  Running& call = *running_;
  const bool is_preferred = call.credentials.entry.IsPreferred();
  if (const auto problem =
          access_->limits_.EnterSamples(call.caller.name, is_preferred, samples_per_s)) {
    return access_
        ->Refuse(call, call.rule->method, {grpc::StatusCode::RESOURCE_EXHAUSTED, *problem})
        .status();
  }
  call.samples_per_s = samples_per_s;
  if (access_->connections_) access_->connections_->TakesSamples(call.connection, samples_per_s);
  return grpc::Status::OK;
}

std::string Admission::Who() const { return WhoInWords(running_->caller, running_->peer); }

bool Admission::is_question() const { return running_->rule->kind == CallKind::kQuestion; }

void Admission::MayHaveChanged(std::string_view what) const {
  if (access_) access_->activity_.MayHaveChanged(what);
}

void Admission::Changed(std::string_view what) const {
  if (access_) access_->activity_.Changed(what, Who(), MonotonicNowNs());
}

grpc::Status Admission::Answered(const grpc::Status& status, std::size_t answer_bytes) {
  if (!access_ || !ok()) return status;
  Running& call = *running_;
  const std::int64_t now_ns = MonotonicNowNs();
  access_->limits_.Leave(call.caller.name, call.rule->kind, call.request_bytes);
  access_->unread_.Waits(call.unread_key, answer_bytes, now_ns);
  call.answer_bytes = answer_bytes;
  if (call.shares_bound()) MustSendBy(now_ns + kReadPatienceNs);
  // Whoever stops the forces must learn that they are off. In a flood of others, gRPC may be late
  // to say that answers were read.
  const bool is_stop = call.rule->kind == CallKind::kStop;
  if (is_stop || !status.ok() || !access_->unread_.IsAbove(call.unread_key, now_ns)) return status;
  return {grpc::StatusCode::RESOURCE_EXHAUSTED,
          std::string(NameOf(call.rule->method)) +
              " is done, but its answer is left out: too many answers wait to be read"};
}

void Admission::SendsVoxels(std::size_t bytes) const {
  if (!access_ || !access_->connections_) return;
  access_->connections_->Credit(
      running_->connection, kBytesPerCall + static_cast<std::int64_t>(bytes) / kVoxelBytesPerByte);
}

void Admission::MustSendBy(std::int64_t time_ns) const {
  if (!access_) return;
  const std::lock_guard lock(access_->running_mutex_);
  running_->must_go_on_by_ns = time_ns;
}

grpc::Status Admission::Failed(const std::exception& error) const {
  const Running& call = *running_;
  // Counts by identity, so that strangers at the same address do not use up its lines of the log.
  const auto* known = dynamic_cast<const Error*>(&error);
  const bool is_loading = known && known->kind() == ErrorKind::kLoading;
  const bool is_logged = !is_loading && (call.rule->kind == CallKind::kTransfer ||
                                         call.rule->least >= Role::kOperator);
  if (is_logged) {
    LogOfClient(LogLevel::kWarning, call.caller.name, "{} of {} at {} failed: {}",
                NameOf(call.rule->method), call.caller.name, call.peer, error.what());
  }
  return ToStatus(error);
}

Access::Work::Work(Access& access, const Admission& admission)
    : access_(access),
      question_of_(admission.is_question() ? admission.caller().name : ""),
      began_s_(ThreadTimeS()) {}

Access::Work::~Work() {
  if (question_of_.empty()) return;
  access_.limits_.Worked(question_of_, ThreadTimeS() - began_s_, MonotonicNowNs());
}

void Access::Work::Begin() const {
  if (question_of_.empty()) return;
  if (const auto problem = access_.limits_.MayWork(question_of_, MonotonicNowNs())) {
    throw Error(ErrorKind::kTooLarge, *problem);
  }
}

Access::Judgement Access::Judge(const grpc::ServerContextBase& context, std::string_view method,
                                const PolicyBoard::Reading& policy) const {
  Judgement judgement;
  Admission::Running& call = judgement.call;
  call.rule = FindMethodRule(method);
  call.peer = PeerOf(context);
  Recognised who = policy->Recognise(CredentialsOf(context), now_());
  if (!who.identity) {
    judgement.refusal = {grpc::StatusCode::UNAUTHENTICATED, who.problem};
    return judgement;
  }
  call.caller = *std::move(who.identity);
  call.credentials = std::move(who.kept);
  const Entry& entry = call.credentials.entry;
  const bool is_tcp = entry.transport == Transport::kPlain || entry.transport == Transport::kTls;
  if (is_tcp) call.connection = call.peer;
  if (!entry.IsPreferred()) {
    call.unread_key = is_tcp ? call.connection : "all of " + call.caller.name;
  }
  if (!call.rule || call.caller.role < call.rule->least) {
    judgement.refusal = {grpc::StatusCode::PERMISSION_DENIED,
                         RoleProblem(call.caller, call.rule ? call.rule->least : Role::kAdmin)};
  }
  return judgement;
}

bool Access::May(const grpc::ServerContextBase& context, std::string_view method) const {
  return Judge(context, method, PolicyBoard::Reading(policy_)).refusal.ok();
}

bool Access::MayStill(const Credentials& credentials, std::string_view method) const {
  const PolicyBoard::Reading policy(policy_);
  const std::optional<Identity> identity = policy->Recognise(credentials, now_()).identity;
  return identity && identity->role >= FindMethodRule(method)->least;
}

void Access::Changed(std::string_view what, const std::string& who) {
  activity_.Changed(what, who, MonotonicNowNs());
}

Admission Access::Admit(grpc::ServerContextBase* context, std::string_view method,
                        std::size_t request_bytes) {
  while (true) {
    const PolicyBoard::Reading policy(policy_);
    auto [call, refusal] = Judge(*context, method, policy);
    if (!refusal.ok()) return Refuse(call, method, refusal);
    call.context = context;
    call.request_bytes = request_bytes;
    if (std::optional<Admission> admission = Enter(call, policy)) return *std::move(admission);
    // The policy was replaced in the meantime: judge again.
  }
}

std::optional<Admission> Access::Enter(Admission::Running call,
                                       const PolicyBoard::Reading& policy) {
  const CallKind kind = call.rule->kind;
  const std::int64_t now_ns = MonotonicNowNs();
  std::optional<std::string> problem;
  if (kind != CallKind::kStop && unread_.IsAbove(call.unread_key, now_ns)) {
    problem = "too many answers wait to be read: read them before you go on";
  } else {
    problem = limits_.Enter(call.caller.name, kind, call.request_bytes, now_ns);
  }
  Admission admission;
  admission.access_ = this;
  if (problem) {
    admission.status_ =
        Refuse(call, call.rule->method, {grpc::StatusCode::RESOURCE_EXHAUSTED, *problem}).status_;
    // A refusal, too, waits in gRPC until its client reads.
    call.answer_bytes = 0;
    if (call.shares_bound()) call.must_go_on_by_ns = now_ns + kReadPatienceNs;
    unread_.Waits(call.unread_key, 0, now_ns, /*is_refusal=*/true);
    if (connections_ && unread_.IsDeaf(call.unread_key, now_ns)) connections_->Cut(call.connection);
  }
  {
    const std::lock_guard lock(running_mutex_);
    admission.running_ = running_.insert(running_.end(), call);
  }
  if (problem) return admission;
  // Else the review that follows a new policy finds the call in the list.
  if (!policy.IsInForce()) return std::nullopt;
  admission.running_->is_noted =
      activity_.Came(call.caller, call.peer, kind == CallKind::kPoseStream, now_ns);
  if (connections_) {
    connections_->Admitted(call.connection, call.credentials, call.caller.role,
                           /*is_credited=*/kind != CallKind::kStop);
  }
  return admission;
}

void Access::SetPolicy(std::shared_ptr<const Policy> policy) {
  policy_.Replace(std::move(policy));
  Review();
}

std::size_t Access::EndCaller(const std::string& identity) {
  std::vector<End> ends;
  {
    const std::lock_guard lock(running_mutex_);
    for (Admission::Running& call : running_) {
      if (call.caller.name == identity && !call.ended) {
        ends.push_back(MarkEnd(call, "an admin ended it"));
      }
    }
  }
  Carry(ends);
  return ends.size();
}

Access::End Access::MarkEnd(Admission::Running& call, const std::string& why) {
  call.ended = true;
  // Stays valid without the lock, also if the call is over in the meantime.
  grpc_call_ref(call.context->c_call());
  return {call.context->c_call(), call.caller.name,
          "ended " + std::string(call.rule->method) + " of " + call.caller.name + " at " +
              call.peer + ": " + why};
}

void Access::Carry(const std::vector<End>& ends) {
  for (const End& end : ends) {
    grpc_call_cancel(end.call, nullptr);
    grpc_call_unref(end.call);
    LogOfClient(LogLevel::kWarning, end.whose, "{}", end.line);
  }
}

void Access::Review() {
  const PolicyBoard::Reading policy(policy_);
  const auto identity_of = [&](const Credentials& credentials) {
    return policy->Recognise(credentials, now_()).identity;
  };
  Carry(MarkEnds(Judged(identity_of), policy));
  if (on_review_) on_review_();
  if (!connections_) return;
  connections_->Judge([&](const Credentials& credentials) {
    const auto identity = identity_of(credentials);
    return identity ? std::optional(identity->role) : std::nullopt;
  });
}

// Verifying a chain of certificates takes long, so it happens once for all calls, and without the
// lock.
Access::Identities Access::Judged(const IdentityOf& identity_of) const {
  Identities judged;
  {
    const std::lock_guard lock(running_mutex_);
    for (const Admission::Running& call : running_) judged.try_emplace(call.credentials);
  }
  for (auto& [credentials, identity] : judged) identity = identity_of(credentials);
  return judged;
}

std::vector<Access::End> Access::MarkEnds(const Identities& judged,
                                          const PolicyBoard::Reading& policy) {
  std::vector<End> ends;
  const std::lock_guard lock(running_mutex_);
  // Another policy may have admitted some of them. Its own review follows.
  if (!policy.IsInForce()) return ends;
  const std::int64_t now_ns = MonotonicNowNs();
  for (Admission::Running& call : running_) {
    const auto found = judged.find(call.credentials);
    if (call.ended || found == judged.end()) continue;
    const bool is_allowed = found->second && found->second->role >= call.rule->least;
    // Who follows the facts was told its role when it began.
    const bool holds = is_allowed && (call.rule->kind != CallKind::kFactStream ||
                                      found->second->role == call.caller.role);
    const bool is_late = call.must_go_on_by_ns != 0 && now_ns > call.must_go_on_by_ns;
    if (holds && !is_late) continue;
    ends.push_back(MarkEnd(call, holds        ? "it sends or reads too slowly"
                                 : is_allowed ? "its caller has another role now"
                                              : "it is no longer allowed"));
  }
  return ends;
}

Admission Access::Refuse(const Admission::Running& call, std::string_view method,
                         const grpc::Status& problem) const {
  // Strangers share one budget of lines: a flood may come from many addresses.
  const std::string who = call.caller.name.empty() ? kStrangers : call.caller.name;
  LogOfClient(LogLevel::kWarning, call.caller.name.empty() ? who : call.peer,
              "refused {} at {} to call {}: {}", who, call.peer, method, problem.error_message());
  return Admission(grpc::Status(
      problem.error_code(),
      "palpated refuses " + std::string(NameOf(method)) + ": " + problem.error_message()));
}

}  // namespace palpate
