#include "client/cli/set_command.h"

#include <fmt/core.h>

#include <cctype>
#include <chrono>
#include <memory>
#include <thread>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/isovalues.h"
#include "client/cli/output.h"
#include "client/cli/progress.h"
#include "client/sdk/words.h"
#include "common/error/error.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kLook(100);

std::vector<std::string> Names() {
  std::vector<std::string> names;
  for (const Setting& setting : client::kSettings) names.emplace_back(setting.name);
  return names;
}

// The values of the options.
struct SetValues {
  std::string key;
  std::string value;
  bool normalized = false;
  client::SettingsUpdate update;
};

const Setting& Named(const std::string& key) {
  if (const Setting* setting = FindSetting(key)) return *setting;
  throw arguments::UsageError("there is no setting '" + key + "'" +
                              arguments::DidYouMean(key, Names()));
}

void StoreValue(const Setting& setting, const std::string& value, client::SettingsUpdate& update) {
  if (StoreSetting(setting, value, update)) return;
  throw arguments::UsageError(
      fmt::format("{} cannot be '{}': give {}", setting.name, value, ValuesOf(setting)));
}

const Setting& TakeSetting(SetValues& values) {
  const Setting* setting = &Named(values.key);
  if (values.normalized) {
    if (setting != &client::kIsovalue) {
      throw arguments::UsageError("--normalized is for the isovalue");
    }
    setting = &client::kNormalizedIsovalue;
  }
  // A word is one of the volume's, which only the daemon knows.
  const bool is_word =
      !values.value.empty() && std::isalpha(static_cast<unsigned char>(values.value.front())) != 0;
  if (setting == &client::kIsovalue && is_word) return *setting;
  StoreValue(*setting, values.value, values.update);
  return *setting;
}

// Returns when the ball of `asked` is felt, from its side: its field is made in the background.
void WaitForBall(client::Calls& palpated, const client::Settings& asked, bool asks_for_ball) {
  client::Settings now = asked;
  WithProgress([&](const client::ProgressFunction& progress) {
    while (now.ball.is_awaited && now.tool_radius_mm == asked.tool_radius_mm) {
      if (!progress({.stage = "making the ball's field",
                     .fraction = now.ball.share_done.value_or(0.0)})) {
        throw Error(ErrorKind::kCancelled, "it goes on; the ball is felt when it is made");
      }
      std::this_thread::sleep_for(kLook);
      now = palpated.GetSettings();
    }
  });
  RequireLive(now);
  if (now.tool_radius_mm != asked.tool_radius_mm) {
    throw Error(ErrorKind::kConflict,
                fmt::format("somebody else has set tool_radius to {:g} mm", now.tool_radius_mm));
  }
  // A point has the side that was asked for.
  const bool has_side = !asks_for_ball && now.ball.felt_radius_mm == 0.0;
  if (now.ball.problem.empty() || has_side) return;
  throw Error(ErrorKind::kTooLarge, client::BallInWords(now));
}

void Change(client::Calls& palpated, const Setting& setting, const SetValues& values, bool json) {
  client::SettingsUpdate update = values.update;
  if (&setting == &client::kIsovalue && !update.isovalue) {
    update.isovalue = SuggestedIsovalueOf(palpated.GetVolume(), values.value);
  }
  const client::SettingsResult result = palpated.Set(update);
  PrintNotKept(result.not_kept);
  if (update.tool_radius_mm || update.free_side) {
    WaitForBall(palpated, result.settings, update.tool_radius_mm.has_value());
  }
  if (!json) return WriteOutput(DescribeChange(setting, result) + "\n");
  Json object = ToJson(result.settings);
  object["applied_tick"] = result.applied_tick;
  object["receipt_to_applied_ns"] = result.receipt_to_applied_ns;
  WriteOutput(ToText(object));
}

std::string DescribeValue(const Setting& setting, const client::Settings& settings) {
  if (&setting == &client::kNormalizedIsovalue) {
    return fmt::format("isovalue {:.9g} (normalised {:.9g})", settings.isovalue,
                       settings.normalized_isovalue);
  }
  return DescribeSetting(setting, settings);
}

}  // namespace

void AddSet(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand("set", "Changes what is felt, at one tick");
  SetFooter(*command, "KEY, with or without its unit (stiffness, stiffness_n_per_mm):\n" +
                          ListOfSettings() +
                          "Examples: palpate set isovalue -200\n"
                          "          palpate set isovalue bone    (palpate info lists the names)\n"
                          "          palpate set isovalue --normalized 0.4\n"
                          "          palpate set stiffness 0.8");
  const auto values = std::make_shared<SetValues>();
  command->add_option("key", values->key, "What to change, see below")
      ->required()
      ->option_text("KEY")
      ->suggest(Names());
  command->add_option("value", values->value, "Its new value")->required()->option_text("VALUE");
  command->add_flag("--normalized", values->normalized,
                    "The isovalue is given over the volume's range at load, 0 to 1");
  command->add_option("--expected-revision", values->update.expected_revision,
                      "Change it only on top of this settings revision, else exit with 7");
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    const Setting& setting = TakeSetting(*values);
    invocation.command = [values, &setting, &invocation](client::Calls& palpated) {
      Change(palpated, setting, *values, invocation.json);
    };
  });
}

void StoreNamedSetting(const std::string& text, client::SettingsUpdate& update) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) {
    throw arguments::UsageError("'" + text + "' is no setting: give KEY=VALUE");
  }
  StoreValue(Named(text.substr(0, equals)), text.substr(equals + 1), update);
}

std::string DescribeChange(const Setting& setting, const client::SettingsResult& result) {
  return fmt::format("{} applied at tick {}, settings revision {}, {:.1f} ms after receipt",
                     DescribeValue(setting, result.settings), result.applied_tick,
                     result.settings.revision,
                     static_cast<double>(result.receipt_to_applied_ns) * 1e-6);
}

}  // namespace palpate::cli
