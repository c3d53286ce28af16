#include "client/sdk/words.h"

#include <array>
#include <cstdio>

namespace palpate::client {
std::string UnsavedInWords(std::uint64_t edits) {
  return edits == 1 ? "1 edit is not saved" : std::to_string(edits) + " edits are not saved";
}

std::string InWords(const std::optional<RunningReplay>& replay) {
  const std::string what =
      replay ? " of " + replay->path.substr(replay->path.rfind('/') + 1) + " by " + replay->by : "";
  return "replay" + what + ": forces are off";
}

std::string BallInWords(const Settings& settings) {
  const BallState& ball = settings.ball;
  const bool has_tool = !settings.tool.ball.empty();
  if (!ball.problem.empty()) {
    return (has_tool ? "the tool is not felt: " : "the ball of the settings is not felt: ") +
           ball.problem;
  }
  if (!ball.is_awaited) return {};
  if (has_tool) return "the fields of the tool's balls are being made";
  std::array<char, 120> text{};
  std::snprintf(text.data(), text.size(), "%s is felt; a ball of %.3g mm is being made (%.0f %%)",
                ball.felt_radius_mm == 0.0 ? "a point" : "the ball before", settings.tool_radius_mm,
                100.0 * ball.share_done.value_or(0.0));
  return text.data();
}

}  // namespace palpate::client
