// Decides who a client is and which role it has: by the socket it came by, by a token or a
// certificate, or by the word of a door.
//
// Threads: a policy is made once and then only read, from any thread. When files or settings
// change, a new policy replaces it (PolicyBoard). Recognise never waits.
#pragma once

#include <atomic>
#include <compare>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/security/certificates.h"
#include "server/security/methods.h"
#include "server/security/token.h"

namespace palpate {

// A name in a client's certificate, and its role.
struct CertificateRole {
  std::string san{};  // a DNS name, a URI or a mail address; must match exactly
  Role role = Role::kViewer;
};

struct PolicyOptions {
  // The role of everybody who may open the usual socket. The socket's file mode decides who may.
  Role socket_role = Role::kAdmin;
  // The role for loopback TCP without TLS, which every account of the machine can reach.
  Role loopback_role = Role::kViewer;
  std::filesystem::path client_ca{};  // empty: no certificates
  std::vector<CertificateRole> clients{};
  std::filesystem::path tokens{};  // empty: no tokens
};

enum class Transport {
  kSocket,  // of a role
  kDoor,    // a socket whose client, such as a proxy, knows who calls and says it
  kPlain,   // loopback TCP
  kTls,
};

// The way by which a call came.
struct Entry {
  Transport transport = Transport::kPlain;
  Role role = Role::kUnknown;  // of a socket
  // The socket has a group of its own. Otherwise those who may open the usual socket may open it,
  // and its role is not above socket_role.
  bool has_group = false;

  // The workstation's own users, whom the others must not hinder.
  bool IsPreferred() const { return transport == Transport::kSocket && role >= Role::kOperator; }
  auto operator<=>(const Entry&) const = default;
};

// The headers in which a door says who calls and from where: "token ada", "192.0.2.7".
inline constexpr char kCallerHeader[] = "palpate-caller";
inline constexpr char kAddressHeader[] = "palpate-address";

// The credentials that came with a call.
struct Credentials {
  Entry entry{};
  // PEM; null: none. Calls with the same chain share it: a chain may have 32 KiB.
  std::shared_ptr<const std::string> certificate_chain{};
  std::string authorization{};  // the header; empty: none
  // Replaces the header for a call that was already admitted: the hash that found its token. So the
  // token itself is not kept.
  std::string token_sha256_hex{};
  bool names_caller = false;  // a door's headers came
  std::string caller{};       // what they say; empty: it cannot be used

  auto operator<=>(const Credentials&) const = default;
};

struct Recognised {
  std::optional<Identity> identity{};  // none: a stranger
  std::string problem{};               // why the client is a stranger
  // What stands for the credentials when the client is judged again.
  Credentials kept{};
};

class Policy {
 public:
  // Trusts only peers on the sockets and on loopback.
  Policy() = default;
  // Reads the files. Errors: Error.
  explicit Policy(const PolicyOptions& options);
  // Reads the files again while the daemon runs. If an authority's or tokens' file cannot be used,
  // keeps those of `before` and adds a line to `problems`. If the tokens' file is gone, there are
  // no tokens.
  Policy(const PolicyOptions& options, const Policy& before, std::vector<std::string>& problems);

  Recognised Recognise(const Credentials& credentials, CertificateTime now) const;

 private:
  Identity OfSocket(const Entry& entry) const;
  Recognised ByToken(const Credentials& credentials, CertificateTime now) const;
  Recognised ByCertificate(const Credentials& credentials, CertificateTime now) const;

  PolicyOptions options_;
  std::shared_ptr<const ClientAuthority> authority_;  // null: certificates are not accepted
  std::vector<StoredToken> tokens_;
};

// Holds the policy in force. Readers never wait, so that the emergency stop can ask it.
//
// gcc 12's atomic<shared_ptr> takes a lock. Here a reader counts itself and then loads a raw
// pointer. A replaced policy is freed when nobody reads: whoever counts itself later finds the new
// one.
//
// Threads: Read on any; Replace on one at a time.
class PolicyBoard {
 public:
  // The policy stays until this object ends.
  class Reading {
   public:
    explicit Reading(const PolicyBoard& board) : board_(board) {
      board.readers_.fetch_add(1);
      policy_ = board.newest_.load();
    }
    ~Reading() { board_.readers_.fetch_sub(1); }
    Reading(const Reading&) = delete;
    Reading& operator=(const Reading&) = delete;

    const Policy* operator->() const { return policy_; }
    // No other policy has come since.
    bool IsInForce() const { return board_.newest_.load() == policy_; }

   private:
    const PolicyBoard& board_;
    const Policy* policy_ = nullptr;
  };

  void Replace(std::shared_ptr<const Policy> policy) {
    newest_.store(policy.get());
    kept_.push_back(std::move(policy));
    // Beside a flood of calls it may take some replacements until nobody reads.
    if (readers_.load() == 0) kept_.erase(kept_.begin(), kept_.end() - 1);
  }

 private:
  std::vector<std::shared_ptr<const Policy>> kept_{std::make_shared<Policy>()};  // the newest last
  std::atomic<const Policy*> newest_{kept_.front().get()};
  mutable std::atomic<int> readers_{0};
};

}  // namespace palpate
