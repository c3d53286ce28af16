// Who is recognised, by what, and as what.
//
// Threads: a policy is made, and then only read, from any thread. It is replaced as a
// whole when files or settings change.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/security/certificates.h"
#include "server/security/role.h"
#include "server/security/token.h"

namespace palpate {

// A name of a client's certificate and what it may do.
struct CertificateRole {
  std::string san{};  // a DNS name, a URI or a mail address: equal, letter for letter
  Role role = Role::kViewer;
};

struct PolicyOptions {
  // Whoever may open the socket: its file mode is the guard.
  Role socket_role = Role::kAdmin;
  // Of loopback TCP without TLS, which every account of the machine can reach.
  Role loopback_role = Role::kViewer;
  std::filesystem::path client_ca{};  // empty: no certificates
  std::vector<CertificateRole> clients{};
  std::filesystem::path tokens{};  // empty: no tokens
};

enum class Transport { kSocket, kPlain, kTls };

// What a call came with.
struct Credentials {
  Transport transport = Transport::kPlain;
  std::string certificate_chain{};  // PEM; empty: none
  std::string authorization{};      // the header; empty: none
  // Instead of the header, for a call that was admitted before: the hash that its token
  // was found by, so that the token itself is not kept.
  std::string token_sha256_hex{};
};

struct Recognised {
  std::optional<Identity> identity{};  // none: a stranger
  std::string problem{};               // then
  std::string token_sha256_hex{};      // of a token
};

class Policy {
 public:
  // Strangers all, but on the socket and on loopback.
  Policy() = default;
  // Reads the files. Errors: Error.
  explicit Policy(const PolicyOptions& options);
  // The same while the daemon runs: an authority or tokens whose file cannot be used stay
  // as in `before`, and why is a line of `problems`. Without a file there are no tokens.
  Policy(const PolicyOptions& options, const Policy& before, std::vector<std::string>& problems);

  Recognised Recognise(const Credentials& credentials, CertificateTime now) const;

 private:
  Recognised ByToken(const Credentials& credentials, CertificateTime now) const;
  Recognised ByCertificate(const std::string& chain, CertificateTime now) const;

  PolicyOptions options_;
  std::shared_ptr<const ClientAuthority> authority_;  // null: none
  std::vector<StoredToken> tokens_;
};

}  // namespace palpate
