#include "server/app/security_config.h"

#include <algorithm>

#include "common/error/error.h"

namespace palpate {
namespace {

Role ParseRole(const ConfigEntry& entry) {
  if (const auto role = RoleNamed(entry.Text())) return *role;
  entry.Fail("must be \"viewer\", \"editor\", \"operator\" or \"admin\"");
}

std::filesystem::path ParseFile(const ConfigEntry& entry) {
  const std::filesystem::path path = entry.Text();
  if (!path.is_absolute()) entry.Fail("must be an absolute path");
  return path;
}

CertificateRole ParseClient(const ConfigEntry& client) {
  const toml::table* table = client.node.as_table();
  if (!table) client.Fail("must be [[tls.client]] with san and role");
  CertificateRole parsed;
  bool has_role = false;
  for (const auto& [name, node] : *table) {
    const ConfigEntry entry{node};
    if (name == "san") {
      parsed.san = entry.Text();
    } else if (name == "role") {
      parsed.role = ParseRole(entry);
      has_role = true;
    } else {
      entry.Fail("has san and role, and no " + std::string(name.str()));
    }
  }
  if (parsed.san.empty() || !has_role) client.Fail("needs san and role");
  return parsed;
}

void ParseClients(const ConfigEntry& entry, SecurityOptions& options) {
  const toml::array* array = entry.node.as_array();
  if (!array) entry.Fail("must be [[tls.client]] with san and role");
  options.policy.clients.clear();
  for (const toml::node& node : *array) {
    options.policy.clients.push_back(ParseClient({node}));
  }
}

}  // namespace

std::map<std::string, std::function<void(const ConfigEntry&, SecurityOptions&)>> SecuritySetters() {
  using E = const ConfigEntry&;
  using S = SecurityOptions&;
  constexpr int kMost = 1'000'000;
  return {
      {"server.socket_role", [](E e, S s) { s.policy.socket_role = ParseRole(e); }},
      {"server.loopback_role", [](E e, S s) { s.policy.loopback_role = ParseRole(e); }},
      {"tls.certificate", [](E e, S s) { s.tls.certificate = ParseFile(e); }},
      {"tls.key", [](E e, S s) { s.tls.key = ParseFile(e); }},
      {"tls.client_ca", [](E e, S s) { s.policy.client_ca = ParseFile(e); }},
      {"tls.tokens", [](E e, S s) { s.policy.tokens = ParseFile(e); }},
      {"tls.client", ParseClients},
      {"limits.connections", [](E e, S s) { s.connections = e.Integer(1, kMost); }},
      {"limits.calls_per_s", [](E e, S s) { s.limits.calls_per_s = e.Integer(1, kMost); }},
      {"limits.pose_streams", [](E e, S s) { s.limits.pose_streams = e.Integer(1, kMost); }},
      // At least one stream at 1 kHz of a network client. Network clients get half of the limit.
      {"limits.pose_samples_per_s",
       [](E e, S s) { s.limits.pose_samples_per_s = e.Integer(2000, kMost); }},
      {"limits.volume_streams", [](E e, S s) { s.limits.volume_streams = e.Integer(1, kMost); }},
      {"limits.transfers", [](E e, S s) { s.limits.transfers = e.Integer(1, kMost); }},
  };
}

void AppendSecurityFaults(const SecurityOptions& options, ConfigReading& reading) {
  const auto is_tls = [](const ConfigFault& fault) { return fault.key.starts_with("tls"); };
  if (std::any_of(reading.faults.begin(), reading.faults.end(), is_tls)) return;
  // Blames the key that is in the file.
  const auto append = [&](const char* key, const char* other, const std::string& what) {
    const char* given = reading.keys.contains(key) ? key : other;
    reading.faults.push_back({given, reading.keys.at(given).line, what});
  };
  const bool has_pair = !options.tls.certificate.empty();
  const PolicyOptions& policy = options.policy;
  if (has_pair != !options.tls.key.empty()) {
    append("tls.certificate", "tls.key",
           "tls.certificate and tls.key come together: set both, or none");
  } else if (!has_pair && (!policy.tokens.empty() || !policy.client_ca.empty())) {
    append("tls.tokens", "tls.client_ca",
           "tls.tokens and tls.client_ca are of no use without TLS: set tls.certificate and "
           "tls.key");
  }
  if (policy.client_ca.empty() != policy.clients.empty()) {
    append("tls.client_ca", "tls.client",
           "tls.client_ca and [[tls.client]] come together: the one says which certificates "
           "are genuine, the other what their names may do");
  }
}

}  // namespace palpate
