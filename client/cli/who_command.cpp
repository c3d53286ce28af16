#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <string>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/sdk/words.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

std::string Ago(double seconds) {
  if (seconds < 120.0) return fmt::format("{:.0f} s", seconds);
  if (seconds < 7200.0) return fmt::format("{:.0f} min", seconds / 60.0);
  return fmt::format("{:.0f} h", seconds / 3600.0);
}

// One object for each caller.
Json ActivityJson(const client::Activity& activity) {
  Json json = ToJson(activity);
  for (Json& caller : json["callers"]) {
    Json one = caller["caller"];
    caller.erase("caller");
    one.update(caller);
    caller = one;
  }
  return json;
}

std::string Describe(const client::Activity& activity) {
  std::size_t width = 0;
  for (const client::LastChange& change : activity.changes) {
    width = std::max(width, change.what.size());
  }
  std::string text;
  for (const client::ConnectedCaller& caller : activity.callers) {
    AppendLine(text, NameOf(caller.caller.role),
               fmt::format("{}{}{}, here for {}{}", OneLine(caller.caller.identity),
                           caller.is_you ? " (you)" : "",
                           caller.peer.empty() ? "" : " at " + OneLine(caller.peer),
                           Ago(caller.connected_s), caller.watches ? ", watches" : ""));
  }
  for (const client::LastChange& change : activity.changes) {
    AppendLine(text, &change == &activity.changes.front() ? "changes" : "",
               fmt::format("{:<{}}  {} ago by {}", OneLine(change.what), width, Ago(change.ago_s),
                           OneLine(change.by)));
  }
  return text;
}

}  // namespace

void AddWho(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command =
      app.add_subcommand("who",
                         "Shows who is connected, with which role, and who changed what last.\n"
                         "All programs on the daemon's socket are one caller.");
  SetFooter(*command,
            "Example: palpate who --json | jq '.changes[] | select(.what == \"isovalue\")'");
  AddJson(*command, invocation);
  const auto ended = std::make_shared<std::string>();
  command->add_option("--end", *ended,
                      "ends all calls of a caller, such as \"token ada\", instead");
  command->callback([&invocation, ended] {
    invocation.command = [&invocation, ended](client::Calls& palpated) {
      if (!ended->empty()) {
        return WriteOutput(
            fmt::format("ended {} calls of {}\n", palpated.EndCaller(*ended), OneLine(*ended)));
      }
      const client::Activity activity = palpated.GetActivity();
      WriteOutput(invocation.json ? ToText(ActivityJson(activity)) : Describe(activity));
    };
  });
}

}  // namespace palpate::cli
