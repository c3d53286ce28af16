#include "server/security/policy.h"

#include <algorithm>

#include "common/error/error.h"
#include "server/security/token.h"

namespace palpate {
namespace {

constexpr char kAskForToken[] = ": ask the operator for a new token ('palpated token add')";
constexpr std::string_view kBearer = "Bearer ";

// Not one of our own names for those who have none, which have limits of their own.
bool CanBeCaller(const std::string& name) {
  return !name.empty() && name.front() != ' ' && name.back() != ' ' && name != "loopback" &&
         !name.ends_with(" socket");
}

Recognised Stranger(const std::string& problem) { return {.problem = problem}; }

}  // namespace

Policy::Policy(const PolicyOptions& options) : options_(options) {
  if (!options.client_ca.empty()) {
    authority_ = std::make_shared<const ClientAuthority>(options.client_ca);
  }
  if (!options.tokens.empty()) tokens_ = ReadTokenFile(options.tokens);
}

// Reads each file on its own: a damaged authority must not keep a revoked token valid.
Policy::Policy(const PolicyOptions& options, const Policy& before,
               std::vector<std::string>& problems)
    : options_(options) {
  try {
    if (!options.client_ca.empty()) {
      authority_ = std::make_shared<const ClientAuthority>(options.client_ca);
    }
  } catch (const Error& error) {
    authority_ = before.authority_;
    problems.push_back("the authority of clients stays as it was: " + std::string(error.what()));
  }
  try {
    if (!options.tokens.empty()) tokens_ = ReadTokenFile(options.tokens);
  } catch (const Error& error) {
    // If the file was removed, its tokens are revoked.
    std::error_code unknown;
    if (std::filesystem::exists(options.tokens, unknown) || unknown) tokens_ = before.tokens_;
    problems.push_back((tokens_.empty() ? "no token is known: " : "tokens stay as they were: ") +
                       std::string(error.what()));
  }
}

Recognised Policy::Recognise(const Credentials& credentials, CertificateTime now) const {
  const Entry& entry = credentials.entry;
  if (entry.transport != Transport::kTls && !credentials.authorization.empty()) {
    return Stranger(
        "a token came without TLS, where others may have read it: revoke it, and send tokens over "
        "TLS only");
  }
  if (entry.transport != Transport::kDoor && credentials.names_caller) {
    return Stranger(std::string(kCallerHeader) + " and " + kAddressHeader +
                    " are for the sockets of a door alone");
  }
  switch (entry.transport) {
    case Transport::kSocket:
      return {.identity = OfSocket(entry), .kept = credentials};
    case Transport::kDoor:
      if (CanBeCaller(credentials.caller)) {
        return {.identity = Identity{credentials.caller, entry.role}, .kept = credentials};
      }
      return Stranger("this is a door's socket, and " + std::string(kCallerHeader) +
                      " does not say who calls, as in 'token ada'");
    case Transport::kPlain:
      return {.identity = Identity{"loopback", options_.loopback_role}, .kept = credentials};
    case Transport::kTls:
      break;
  }
  // If a token came, only the token counts: a client with a wrong token must learn about it.
  if (!credentials.authorization.empty() || !credentials.token_sha256_hex.empty()) {
    return ByToken(credentials, now);
  }
  if (credentials.certificate_chain) return ByCertificate(credentials, now);
  return Stranger("neither a token nor a certificate came: give one of them");
}

Identity Policy::OfSocket(const Entry& entry) const {
  const bool is_usual = entry.role == Role::kAdmin;
  return {is_usual ? "local socket" : std::string(NameOf(entry.role)) + " socket",
          entry.has_group ? entry.role : std::min(entry.role, options_.socket_role)};
}

Recognised Policy::ByToken(const Credentials& credentials, CertificateTime now) const {
  const StoredToken* found = nullptr;
  if (!credentials.token_sha256_hex.empty()) {
    const auto same = [&](const StoredToken& token) {
      return token.sha256_hex == credentials.token_sha256_hex;
    };
    const auto at = std::find_if(tokens_.begin(), tokens_.end(), same);
    if (at != tokens_.end()) found = &*at;
  } else {
    const std::string_view header = credentials.authorization;
    if (header.starts_with(kBearer)) found = FindToken(tokens_, header.substr(kBearer.size()));
  }
  if (!found) return Stranger(std::string("its token is unknown, or was revoked") + kAskForToken);
  if (found->expires && now >= *found->expires) {
    return Stranger("its token expired at " + ToText(*found->expires) + kAskForToken);
  }
  return {.identity = Identity{"token " + found->name, found->role},
          .kept = {.entry = {Transport::kTls}, .token_sha256_hex = found->sha256_hex}};
}

Recognised Policy::ByCertificate(const Credentials& credentials, CertificateTime now) const {
  if (!authority_) return Stranger("certificates of clients are not accepted here: send a token");
  const ClientAuthority::Verdict verdict = authority_->Check(credentials.certificate_chain, now);
  if (!verdict.problem.empty()) {
    return Stranger(verdict.problem + ": ask the operator for a new certificate");
  }
  const CertificateRole* best = nullptr;
  for (const CertificateRole& client : options_.clients) {
    const bool is_named =
        std::find(verdict.names.begin(), verdict.names.end(), client.san) != verdict.names.end();
    if (is_named && (!best || client.role > best->role)) best = &client;
  }
  if (best) {
    return {.identity = Identity{"certificate " + best->san, best->role},
            .kept = {.entry = {Transport::kTls}, .certificate_chain = verdict.chain}};
  }
  std::string names;
  for (const std::string& name : verdict.names) names += (names.empty() ? "" : ", ") + name;
  return Stranger("its certificate's names (" + (names.empty() ? "none" : names) +
                  ") have no role: add a [[tls.client]]");
}

}  // namespace palpate
