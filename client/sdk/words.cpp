#include "client/sdk/words.h"

#include <algorithm>
#include <cctype>
#include <string_view>

#include "common/wire/force_words.h"
#include "palpate/v1/device.pb.h"
#include "palpate/v1/pose.pb.h"

namespace palpate::client {
namespace {

// Returns the rest of a contract's name, in small letters.
std::string After(std::string_view prefix, const std::string& name) {
  std::string rest = name.substr(std::min(prefix.size(), name.size()));
  std::transform(rest.begin(), rest.end(), rest.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return rest == "unspecified" ? "unknown" : rest;
}

}  // namespace

std::string NameOf(ForceState state) {
  return After("FORCE_STATE_", v1::ForceState_Name(static_cast<v1::ForceState>(state)));
}
std::string NameOf(ForceReason reason) {
  return After("FORCE_REASON_", v1::ForceReason_Name(static_cast<v1::ForceReason>(reason)));
}
std::string NameOf(ProxyMode mode) {
  return After("PROXY_MODE_", v1::ProxyMode_Name(static_cast<v1::ProxyMode>(mode)));
}
std::string UnsavedInWords(std::uint64_t edits) {
  return edits == 1 ? "1 edit is not saved" : std::to_string(edits) + " edits are not saved";
}
std::string NameOf(FreeSide side) { return side == FreeSide::kAbove ? "above" : "below"; }
std::string NameOf(VerificationLevel level) {
  return After("VERIFICATION_LEVEL_",
               v1::VerificationLevel_Name(static_cast<v1::VerificationLevel>(level)));
}
std::string NameOf(DeviceConnection connection) {
  return After("DEVICE_CONNECTION_",
               v1::DeviceConnection_Name(static_cast<v1::DeviceConnection>(connection)));
}
std::string NameOf(Role role) { return After("ROLE_", v1::Role_Name(static_cast<v1::Role>(role))); }

std::string InWords(const std::optional<RunningReplay>& replay) {
  const std::string what =
      replay ? " of " + replay->path.substr(replay->path.rfind('/') + 1) + " by " + replay->by : "";
  return "replay" + what + ": forces are off";
}

std::string InWords(ForceReason reason) {
  return palpate::InWords(static_cast<v1::ForceReason>(reason));
}

}  // namespace palpate::client
