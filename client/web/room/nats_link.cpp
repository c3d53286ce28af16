#include "client/web/room/nats_link.h"

#include <nats/nats.h>

#include <cstdlib>
#include <exception>
#include <fstream>
#include <iterator>
#include <random>
#include <string_view>
#include <utility>

#include "client/web/logins/secret.h"
#include "client/web/room/room_protocol.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "common/wire/address.h"

namespace palpate::web {
namespace {

constexpr std::string_view kPlainScheme = "nats://";
constexpr std::string_view kTlsScheme = "tls://";

HostPort AddressOf(const std::string& url) {
  // Before anything that shows the URL, which may hold a password.
  if (url.find('@') != std::string::npos) {
    Refuse("the NATS server's address holds a user: give nats.user and nats.password_file");
  }
  std::string address = url;
  if (url.starts_with(kPlainScheme)) {
    address.erase(0, kPlainScheme.size());
  } else if (url.starts_with(kTlsScheme)) {
    address.erase(0, kTlsScheme.size());
  } else {
    Refuse(url + " is no address of a NATS server: write nats://HOST:PORT or tls://HOST:PORT");
  }
  const bool has_port = address.find(':', address.rfind(']') + 1) != std::string::npos;
  return ParseHostPort(has_port ? address : address + ":4222");
}

void CheckFile(const char* key, const std::filesystem::path& file) {
  if (!file.empty() && !std::ifstream(file)) {
    Refuse(std::string(key) + ": cannot read " + file.string());
  }
}

bool UsesTls(const NatsServer& server) {
  return server.url.starts_with(kTlsScheme) || !server.ca_file.empty() ||
         !server.certificate_file.empty();
}

// The first word of the file; empty if none is given. Errors: kInvalidArgument (not there, empty).
std::string ReadPassword(const NatsServer& server) {
  if (server.password_file.empty()) return {};
  std::ifstream stream(server.password_file);
  std::string password, more;
  stream >> password >> more;
  const std::string file = server.password_file.string();
  if (password.empty()) Refuse("nats.password_file: no password in " + file);
  if (!more.empty()) Refuse("nats.password_file: " + file + " must hold the password alone");
  return password;
}

}  // namespace

void Check(const NatsServer& server) {
  const HostPort address = AddressOf(server.url);
  if (!UsesTls(server) && address.host != "localhost" && !IsLoopback(address)) {
    Refuse("the NATS server " + address.ToString() +
           " is another machine: use tls:// or nats.tls_ca");
  }
  if (!server.user.empty() && !IsNatsUser(server.user)) {
    Refuse("nats.user: " + server.user + " is no user: use 1 to 64 letters, digits, _ and -");
  }
  if (server.user.empty() != server.password_file.empty()) {
    Refuse("nats.user and nats.password_file go together");
  }
  if (server.certificate_file.empty() != server.key_file.empty()) {
    Refuse("nats.tls_cert and nats.tls_key go together");
  }
  ReadPassword(server);
  CheckFile("nats.tls_ca", server.ca_file);
  CheckFile("nats.tls_cert", server.certificate_file);
  CheckFile("nats.tls_key", server.key_file);
}

namespace {

using namespace std::chrono_literals;

constexpr int kConnect_ms = 2000;
constexpr int kPing_ms = 2000;
constexpr int kPingsOut = 2;
constexpr int kWrite_ms = 5000;

struct DestroyOptions {
  void operator()(natsOptions* options) const { natsOptions_Destroy(options); }
};
using Options = std::unique_ptr<natsOptions, DestroyOptions>;
struct DestroyMessage {
  void operator()(natsMsg* message) const { natsMsg_Destroy(message); }
};
using Message = std::unique_ptr<natsMsg, DestroyMessage>;

void Must(natsStatus status) {
  if (status == NATS_OK) return;
  if (status == NATS_NO_SERVER) {
    // libnats says no more of a name that nobody knows, a port that is shut, or silence.
    throw Error(
        ErrorKind::kUnavailable,
        "no server answers: check name and port, firewalls, and IPAddressAllow= of the unit");
  }
  const char* const detail = nats_GetLastError(nullptr);
  std::string text = detail != nullptr ? detail : "";
  // It begins with libnats's file and line.
  if (text.starts_with('(')) text.erase(0, text.find("): ") + 3);
  throw Error(ErrorKind::kUnavailable, text.empty() ? natsStatus_GetText(status) : OneLine(text));
}

std::string TextOf(const char* text) { return text != nullptr ? text : ""; }

std::string HeaderOf(natsMsg* message, const char* key) {
  const char* value = nullptr;
  return natsMsgHeader_Get(message, key, &value) == NATS_OK ? TextOf(value) : std::string();
}

Options OptionsFor(const NatsServer& server, const std::string& name) {
  natsOptions* made = nullptr;
  Must(natsOptions_Create(&made));
  Options options(made);
  Must(natsOptions_SetURL(made, server.url.c_str()));
  Must(natsOptions_SetName(made, name.c_str()));
  Must(natsOptions_SetIgnoreDiscoveredServers(made, true));
  Must(natsOptions_SetAllowReconnect(made, false));
  Must(natsOptions_SetTimeout(made, kConnect_ms));
  Must(natsOptions_SetPingInterval(made, kPing_ms));
  Must(natsOptions_SetMaxPingsOut(made, kPingsOut));
  Must(natsOptions_SetWriteDeadline(made, kWrite_ms));
  if (!server.user.empty()) {
    Must(natsOptions_SetUserInfo(made, server.user.c_str(), ReadPassword(server).c_str()));
    Must(natsOptions_SetCustomInboxPrefix(made, InboxPrefix(server.user).c_str()));
  }
  if (!UsesTls(server)) return options;
  Must(natsOptions_SetSecure(made, true));
  if (!server.ca_file.empty()) {
    Must(natsOptions_LoadCATrustedCertificates(made, server.ca_file.c_str()));
  }
  if (!server.certificate_file.empty()) {
    Must(natsOptions_LoadCertificatesChain(made, server.certificate_file.c_str(),
                                           server.key_file.c_str()));
  }
  return options;
}

}  // namespace

// One connection of libnats, from its beginning to the end of the last callback.
struct NatsLink::Session {
  explicit Session(NatsLink& owner) : link(owner) {}
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void Connect();
  void SubscribeTo(Subscription& subscription);
  void Break(natsStatus status);
  static void OnClosed(natsConnection*, void* session);
  static void OnError(natsConnection*, natsSubscription*, natsStatus, void* session);
  static void OnMessage(natsConnection*, natsSubscription*, natsMsg*, void* subscription);
  static void OnComplete(void* session);

  NatsLink& link;
  natsConnection* connection = nullptr;
  std::vector<natsSubscription*> subscriptions;
  // Guarded by the link's mutex_.
  bool is_closed = false;   // OnClosed was called
  bool is_over = false;     // the link has to make another one
  std::size_t threads = 0;  // of subscriptions that deliver
  std::string why;
};

NatsLink::Session::~Session() {
  if (connection == nullptr) return;
  natsConnection_Close(connection);
  {
    std::unique_lock lock(link.mutex_);
    link.wake_.wait(lock, [this] { return is_closed && threads == 0; });
  }
  for (natsSubscription* one : subscriptions) natsSubscription_Destroy(one);
  natsConnection_Destroy(connection);
}

void NatsLink::Session::Connect() {
  const Options options = OptionsFor(link.server_, link.name_);
  Must(natsOptions_SetClosedCB(options.get(), OnClosed, this));
  Must(natsOptions_SetErrorHandler(options.get(), OnError, this));
  Must(natsConnection_Connect(&connection, options.get()));
  for (Subscription& subscription : link.subscriptions_) SubscribeTo(subscription);
}

void NatsLink::Session::SubscribeTo(Subscription& subscription) {
  natsSubscription* made = nullptr;
  Must(natsConnection_Subscribe(&made, connection, subscription.subject.c_str(), OnMessage,
                                &subscription));
  subscriptions.push_back(made);
  {
    const std::lock_guard lock(link.mutex_);
    ++threads;
  }
  if (natsSubscription_SetOnCompleteCB(made, OnComplete, this) != NATS_OK) OnComplete(this);
  natsSubscription_SetPendingLimits(made, -1, kMostWaiting);
}

// After a write that did not end, what follows would be taken for its rest.
void NatsLink::Session::Break(natsStatus status) {
  const std::lock_guard lock(link.mutex_);
  if (why.empty()) why = natsStatus_GetText(status);
  is_over = true;
  link.is_connected_ = false;
  link.wake_.notify_all();
}

void NatsLink::Session::OnClosed(natsConnection* connection, void* session) {
  Session& self = *static_cast<Session*>(session);
  const char* text = nullptr;
  natsConnection_GetLastError(connection, &text);
  const std::lock_guard lock(self.link.mutex_);
  if (self.why.empty()) self.why = OneLine(TextOf(text));
  self.is_closed = self.is_over = true;
  self.link.is_connected_ = false;
  self.link.wake_.notify_all();
}

void NatsLink::Session::OnError(natsConnection* connection, natsSubscription*, natsStatus status,
                                void* session) {
  const Events& events = static_cast<Session*>(session)->link.events_;
  if (status == NATS_SLOW_CONSUMER) {
    if (events.missed) events.missed();
    return;
  }
  const char* text = nullptr;
  natsConnection_GetLastError(connection, &text);
  if (events.refused) events.refused(OneLine(TextOf(text)));
}

void NatsLink::Session::OnMessage(natsConnection*, natsSubscription*, natsMsg* taken,
                                  void* subscription) {
  const Message message(taken);
  const std::string status = HeaderOf(taken, "Status");
  const char* const subject = natsMsg_GetSubject(taken);
  const char* const reply = natsMsg_GetReply(taken);
  try {
    static_cast<Subscription*>(subscription)
        ->receive({.subject = subject,
                   .reply = reply != nullptr ? reply : "",
                   .bytes = {natsMsg_GetData(taken),
                             static_cast<std::size_t>(natsMsg_GetDataLength(taken))},
                   .status = std::atoi(status.c_str())});
  } catch (const std::exception&) {
    // A message that makes no sense is dropped.
  }
}

void NatsLink::Session::OnComplete(void* session) {
  Session& self = *static_cast<Session*>(session);
  const std::lock_guard lock(self.link.mutex_);
  --self.threads;
  self.link.wake_.notify_all();
}

NatsLink::NatsLink(NatsServer server, std::string name, Events events)
    : server_(std::move(server)), name_(std::move(name)), events_(std::move(events)) {
  Check(server_);
}

NatsLink::~NatsLink() { End(); }

void NatsLink::End() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void NatsLink::Subscribe(std::string subject, Receive receive) {
  subscriptions_.push_back({std::move(subject), std::move(receive)});
}

void NatsLink::Start() {
  thread_ = std::thread([this] { Run(); });
}

void NatsLink::Run() {
  std::minstd_rand random(std::random_device{}());
  std::uniform_int_distribution<int> extra_ms(0, 250);
  do {
    auto session = std::make_unique<Session>(*this);
    std::string why;
    try {
      session->Connect();
    } catch (const Error& error) {
      why = error.what();
    }
    if (why.empty()) {
      {
        const std::unique_lock lock(session_mutex_);
        session_ = std::move(session);
      }
      {
        const std::lock_guard lock(mutex_);
        is_connected_ = !session_->is_over;
        last_why_.clear();
      }
      if (is_connected_ && events_.connected) events_.connected();
      {
        std::unique_lock lock(mutex_);
        wake_.wait(lock, [this] { return stopping_ || session_->is_over; });
        why = session_->why;
      }
      is_connected_ = false;
      const std::unique_lock lock(session_mutex_);
      session = std::move(session_);
    }
    session.reset();
    Tell(why.empty() ? "the connection ended" : why);
  } while (!WaitFor(250ms + std::chrono::milliseconds(extra_ms(random))));
}

void NatsLink::Tell(const std::string& why) {
  if (std::exchange(last_why_, why) != why && events_.lost) events_.lost(why);
}

// Returns whether the link ends.
bool NatsLink::WaitFor(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  return wake_.wait_for(lock, time, [this] { return stopping_; });
}

bool NatsLink::Publish(const std::string& subject, std::string_view bytes,
                       const std::string& reply) {
  const std::shared_lock lock(session_mutex_, std::try_to_lock);
  if (!lock || !is_connected_) return false;
  const int length = static_cast<int>(bytes.size());
  const natsStatus status =
      reply.empty()
          ? natsConnection_Publish(session_->connection, subject.c_str(), bytes.data(), length)
          : natsConnection_PublishRequest(session_->connection, subject.c_str(), reply.c_str(),
                                          bytes.data(), length);
  if (status == NATS_TIMEOUT || status == NATS_IO_ERROR) session_->Break(status);
  return status == NATS_OK;
}

std::optional<std::string> NatsLink::Request(const std::string& subject, std::string_view text,
                                             std::chrono::milliseconds timeout) {
  const std::shared_lock lock(session_mutex_, std::try_to_lock);
  if (!lock || !is_connected_) return std::nullopt;
  natsMsg* taken = nullptr;
  const natsStatus status =
      natsConnection_Request(&taken, session_->connection, subject.c_str(), text.data(),
                             static_cast<int>(text.size()), timeout.count());
  if (status != NATS_OK) return std::nullopt;
  const Message answer(taken);
  return std::string(natsMsg_GetData(taken),
                     static_cast<std::size_t>(natsMsg_GetDataLength(taken)));
}

std::string NatsLink::NewInbox() const {
  return (server_.user.empty() ? "_INBOX" : InboxPrefix(server_.user)) + "." + NewSecret(128);
}

}  // namespace palpate::web
