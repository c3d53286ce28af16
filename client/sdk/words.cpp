#include "client/sdk/words.h"

namespace palpate::client {
std::string UnsavedInWords(std::uint64_t edits) {
  return edits == 1 ? "1 edit is not saved" : std::to_string(edits) + " edits are not saved";
}

std::string InWords(const std::optional<RunningReplay>& replay) {
  const std::string what =
      replay ? " of " + replay->path.substr(replay->path.rfind('/') + 1) + " by " + replay->by : "";
  return "replay" + what + ": forces are off";
}

}  // namespace palpate::client
